"""What came into a window of scans, and what went, between two looks at it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

from ogm_mcmc.geometry import PlacedScan

__all__ = ['WindowChange', 'taken_before']


class WindowChange(NamedTuple):
    """From scans that are taken to those that are wanted: some `gone`, some `new` at the end.

    stay  how many scans stay, in their order; 0 where the wanted ones do not begin with them
    """

    stay: int
    gone: list[PlacedScan]
    new: list[PlacedScan]

    @classmethod
    def between(cls, taken: Sequence[PlacedScan], wanted: Sequence[PlacedScan]) -> WindowChange:
        """Compare scans, which are the same where they are one object."""
        number = {id(one): n for n, one in enumerate(taken)}
        stay, last = 0, -1
        for one in wanted:
            at = number.get(id(one), -1)
            if at <= last:
                break
            stay, last = stay + 1, at
        new = list(wanted[stay:])
        if len(number) < len(taken) or any(id(one) in number for one in new):
            return cls(0, list(taken), list(wanted))
        staying = {id(one) for one in wanted[:stay]}
        return cls(stay, [one for one in taken if id(one) not in staying], new)

    @property
    def extends(self) -> bool:
        """Whether scans were added to those that there were."""
        return self.stay > 0 and not self.gone

    @property
    def small(self) -> bool:
        """Whether most scans stay: it is less to take out those that go than to begin anew."""
        return self.stay >= max(len(self.gone), 1)


def taken_before(
    taken: Sequence[PlacedScan], wanted: Sequence[PlacedScan]
) -> list[PlacedScan | None]:
    """Return for each wanted scan where the same one was taken, None where it was not.

    One that was bent for when its beams were taken is another object of the same sensor and
    stamp; it is found where no other has these.
    """
    by_scan = {id(one.scan): one for one in taken}
    by_stamp = _alone(taken)
    alone = _alone(wanted)
    found = []
    for one in wanted:
        before = by_scan.get(id(one.scan))
        if before is None and _stamp(one) in alone:
            before = by_stamp.get(_stamp(one))
        found.append(before)
    return found


def _alone(scans: Sequence[PlacedScan]) -> dict[tuple[str, int], PlacedScan]:
    """Return the scans that no other has sensor and stamp in common with, by these."""
    times = Counter(map(_stamp, scans))
    return {_stamp(one): one for one in scans if times[_stamp(one)] == 1}


def _stamp(placed: PlacedScan) -> tuple[str, int]:
    return placed.scan.frame_id, placed.scan.stamp_ns

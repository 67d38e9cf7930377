"""What came into a window of scans, and what went, between two looks at it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from ogm_mcmc.geometry import PlacedScan

__all__ = ['WindowChange']


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

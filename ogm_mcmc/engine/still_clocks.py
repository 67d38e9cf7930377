"""Clocks that stand still: one stamp that comes again and again says nothing of when.

Several messages of one stamp are nothing odd: the parts of a sweep, the lasers of one moment. They
come within that moment, and the next ones have another stamp. In a recording the times at which
they were recorded tell (`ogm_mcmc.engine.bag_survey`), in a node those at which they arrive.
"""

from __future__ import annotations

from typing import NamedTuple

from ogm_mcmc.engine.bag_survey import ONE_MOMENT_NS
from ogm_mcmc.engine.recent import Recent

__all__ = ['StillClocks']

MOMENT_S = ONE_MOMENT_NS / 1e9


class _Stamp(NamedTuple):
    stamp_ns: int
    first_s: float
    last_s: float


class StillClocks:
    """The newest stamp of each sender, and when it came first and last, by any steady clock."""

    def __init__(self) -> None:
        self._newest: Recent[_Stamp] = Recent()

    def add(self, name: str, stamp_ns: int, now_s: float) -> bool:
        """Take a stamp; return whether it is that of the message before it."""
        before = self._newest.get(name)
        again = before is not None and before.stamp_ns == stamp_ns
        first_s = before.first_s if before is not None and again else now_s
        self._newest[name] = _Stamp(stamp_ns, first_s, now_s)
        return again

    def stands(self, name: str, stamp_ns: int) -> bool:
        """Return whether a stamp is the newest one, and came over more than a moment."""
        newest = self._newest.get(name)
        if newest is None or newest.stamp_ns != stamp_ns:
            return False
        return newest.last_s - newest.first_s > MOMENT_S

    def may_stand(self, name: str, stamp_ns: int, now_s: float) -> bool:
        """Return whether more of a stamp may come: no other did, nor was there silence."""
        newest = self._newest.get(name)
        if newest is None or newest.stamp_ns != stamp_ns:
            return False
        return now_s - newest.last_s <= MOMENT_S

    def clear(self) -> None:
        """Forget all stamps."""
        self._newest.clear()

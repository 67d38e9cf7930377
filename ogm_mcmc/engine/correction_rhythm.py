"""When sampling goes on with scans that a trajectory placed anew, and when at joint poses.

A SLAM system may correct its trajectory every second. Each correction takes an index of its own
and ends what was estimated of poses, so chains go on with it every `CORRECTING_S` at most, and
joint poses wait until scans have lain still for `QUIET_S`: begun anew each time they would
never be there, and cost the map half of the processor.
"""

from __future__ import annotations

import math

__all__ = ['CORRECTING_S', 'QUIET_S', 'CorrectionRhythm']

CORRECTING_S = 10.0
QUIET_S = 20.0


class CorrectionRhythm:
    """What is due; all times on the monotonic clock, s."""

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Forget that any scan moved."""
        self._outdated = False  # scans in the window moved since sampling began
        self._waits = False  # joint poses wait until the trajectory is quiet
        self._moved_s = self._went_on_s = -math.inf

    def moved(self, now_s: float, *, sampling: bool) -> None:
        """Note that a trajectory placed scans anew, maybe while they were sampled."""
        self._outdated, self._moved_s = sampling, now_s

    def due(self, now_s: float) -> bool:
        """Whether to order what is sampled once more; said once, until more happens."""
        if self._outdated:
            due = now_s - self._went_on_s >= CORRECTING_S
        else:
            due = self._waits and self._is_quiet(now_s)
        if due:
            self.end()
        return due

    def goes_on(self, now_s: float) -> None:
        """Note that what is due is ordered."""
        self._went_on_s = now_s

    def ordered(self, now_s: float) -> bool:
        """Note an order of scans as they lie now; return whether poses may be estimated."""
        self._outdated, self._waits = False, not self._is_quiet(now_s)
        return not self._waits

    def end(self) -> None:
        """Note that sampling ended: nothing is due."""
        self._outdated = self._waits = False

    def _is_quiet(self, now_s: float) -> bool:
        return now_s - self._moved_s >= QUIET_S

"""Scans that never came, by the stamps of those that did.

A middleware that hands over messages too late throws the oldest of its queue away, and says so to
nobody: rclpy's `message_lost` event stays silent. A lidar turns steadily, so its stamps tell.
"""

from __future__ import annotations

from collections import Counter, deque

from ogm_mcmc.engine.recent import Recent

__all__ = ['NEVER_CAME', 'ScanRhythm']

NEVER_CAME = 'scan_never_came'
"""The reason under which such scans are counted."""

# So many steps of stamps are looked at, and so many of them must be as long as the middle one.
STEPS = 20
ALIKE = 15
TOLERANCE = 0.2

# A step of 1.7 usual ones holds a scan that never came.
SLACK = 0.3

# A longer step is a pause of the lidar or of the recording: nobody lost those scans.
LONGEST_NS = 5_000_000_000


class ScanRhythm:
    """Counts, for each frame, the scans that are missing between those that came.

    Only where stamps come at steady steps: most of the last 20 within a fifth of the middle one.
    """

    def __init__(self) -> None:
        self.missed: Counter[str] = Counter()
        self._seen: Recent[tuple[int, deque[int]]] = Recent()  # last stamp and steps, by frame

    def add(self, frame: str, stamp_ns: int) -> int:
        """Take the stamp of a scan; return how many are missing just before it."""
        last_ns, steps = self._seen.get(frame, (stamp_ns, deque(maxlen=STEPS)))
        self._seen[frame] = stamp_ns, steps
        step = stamp_ns - last_ns
        if not 0 < step <= LONGEST_NS:
            return 0
        missing = max(int(step / usual + SLACK) - 1, 0) if (usual := _usual(steps)) else 0
        steps.append(step)
        if missing:
            self.missed[NEVER_CAME] += missing
        return missing


def _usual(steps: deque[int]) -> int:
    """Return the step that most of `steps` have, ns, 0 where there is none."""
    if len(steps) < STEPS:
        return 0
    middle = sorted(steps)[STEPS // 2]
    alike = sum(abs(step - middle) <= TOLERANCE * middle for step in steps)
    return middle if alike >= ALIKE else 0

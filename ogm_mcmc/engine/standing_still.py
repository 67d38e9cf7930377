"""Whether a robot stands still, by what its laser sees: the same as before.

Localizers fall silent while nothing moves (amcl says nothing for the first 0.25 m, slam_toolbox
for 0.5 m). A scan that sees what the last placed one of its sensor saw was taken at the same
place: moved by a decimetre, most beams of a room change by more than is allowed here. Along a
bare corridor they do not, so what is seen must hold the robot in both directions.
"""

from __future__ import annotations

import numpy as np

from ogm_mcmc.arrays import BoolArray
from ogm_mcmc.engine.recent import Recent
from ogm_mcmc.geometry import PoseBelief, Scan

__all__ = ['StandingStill', 'same_view']

# Readings of one thing differ by so much and this share of the distance.
SLACK_M = 0.03
SLACK_SHARE = 0.01

# Whole scans are kept.
MAX_SENSORS = 20

# Something may move through the view.
ALIKE = 0.9
FEWEST_BEAMS = 30

# Neighbouring readings on one surface.
NEIGHBOURS_M = 0.3

# The share of surfaces that face across the others; 0.5 in a square room, 0 in a bare corridor.
LEAST_ACROSS = 0.1


class StandingStill:
    """Remembers the last scan of each sensor whose pose was known."""

    def __init__(self) -> None:
        self._last: Recent[tuple[Scan, PoseBelief]] = Recent(MAX_SENSORS)

    def placed(self, scan: Scan, belief: PoseBelief) -> None:
        """Note a scan at a known pose of the robot."""
        self._last[scan.frame_id] = scan, belief

    def belief(self, scan: Scan) -> PoseBelief | None:
        """Return where the robot still stands, None where it may have moved."""
        before = self._last.get(scan.frame_id)
        if before is None or scan.stamp_ns < before[0].stamp_ns:
            return None
        return before[1] if same_view(before[0], scan) else None

    def clear(self) -> None:
        """Forget everything."""
        self._last.clear()


def same_view(before: Scan, now: Scan) -> bool:
    """Return whether two scans of one sensor were taken at one place, beyond doubt."""
    if before.ranges_m.size != now.ranges_m.size or before.angle_min_rad != now.angle_min_rad:
        return False
    first, second = _returns(before), _returns(now)
    seen, both = first | second, first & second
    if np.count_nonzero(both) < FEWEST_BEAMS:
        return False
    with np.errstate(invalid='ignore', over='ignore'):
        off = np.abs(before.ranges_m - now.ranges_m)
        alike = both & (off <= SLACK_M + SLACK_SHARE * before.ranges_m)
    if np.count_nonzero(alike) < ALIKE * np.count_nonzero(seen):
        return False
    return _across(before, first) >= LEAST_ACROSS


def _returns(scan: Scan) -> BoolArray:
    ranges = scan.ranges_m
    hit: BoolArray = (ranges >= scan.range_min_m) & (ranges <= scan.range_max_m)
    return hit & np.isfinite(ranges)


def _across(scan: Scan, hit: BoolArray) -> float:
    """Return how evenly surfaces face in all directions: from 0 (all alike) to 0.5."""
    points = (scan.directions()[:, hit] * scan.ranges_m[hit]).T
    steps = np.diff(points, axis=0)
    lengths = np.hypot(steps[:, 0], steps[:, 1])
    surface = (lengths > 0.0) & (lengths < NEIGHBOURS_M)
    if not surface.any():
        return 0.0
    along = steps[surface] / lengths[surface, None]
    return float(np.linalg.eigvalsh(along.T @ along / along.shape[0])[0])

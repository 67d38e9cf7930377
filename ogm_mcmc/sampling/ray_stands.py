"""Poses as good as equal are one: a robot that stands, with a localizer that jitters.

Design note: how near is the same place
---------------------------------------
Context. Only beams along one line are one ray (`ray_merging`). Localizers rarely tell a robot
that stands the same pose to the last bit: interpolation rounds, filters settle.

Decision. Poses lie in a lattice of `GRAIN` of a cell, and as much of a turn as moves the end of
the longest beam by that; round numbers, where simulated robots stand, are the middle of a place.
The first scan of a place keeps its pose, as in a drive nearly all scans do; scans that come to
the same place later are taken from the very same pose. So the end of a beam moves by less than
sqrt(2) + 1 grains, and jitter of any kind costs as many scans as it has places.

Consequence. What is sampled is exact for the poses as taken. What that changes of the maps, and
what jitter costs: `docs/whole_drive.md`.
"""

from __future__ import annotations

from collections.abc import Sequence

from ogm_mcmc.config import WindowConfig
from ogm_mcmc.geometry import GridSpec, PlacedScan, Pose2D
from ogm_mcmc.geometry.rays import usable_range

__all__ = ['GRAIN', 'Stands', 'settled']

GRAIN = 1.0 / 16.0
"""Side of a place of the lattice, cells."""

Stands = dict[tuple[float, float, float, float], Pose2D]
"""By place of the lattice of poses and its side in yaw, rad, the pose its scans are taken from."""


def settled(
    scans: Sequence[PlacedScan], known: Stands, config: WindowConfig
) -> tuple[list[PlacedScan], Stands]:
    """Return the scans, each where the first one of its place is, and the places that are new.

    Raises GridError for a scan without a finite reach.
    """
    spec = GridSpec(config.resolution, 1, 1)
    grain_m = GRAIN * config.resolution
    new: Stands = {}
    taken = []
    for placed in scans:
        pose = placed.pose
        turn_rad = grain_m / max(usable_range(placed.scan, spec, config.max_range), grain_m)
        place = (
            (pose.x_m / grain_m + 0.5) // 1.0,
            (pose.y_m / grain_m + 0.5) // 1.0,
            (pose.yaw_rad / turn_rad + 0.5) // 1.0,
            turn_rad,  # sensors of another reach have a lattice of their own
        )
        first = known.get(place) or new.setdefault(place, pose)
        taken.append(placed if first == pose else PlacedScan.at(placed.scan, first))
    return taken, new

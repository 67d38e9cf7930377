"""Poses between those of a trajectory file, by the motion that was recorded.

Design note: what lies between two poses of a file
--------------------------------------------------
Context. SLAM systems keep poses of some scans only, half a metre or half a radian apart. A robot
that turns on the spot and goes on between two of them was never on the line from one to the
other: office, 2 scans a second, true poses every 0.5 m: by straight lines walls lay metres off.

Decision. As where a trajectory comes in on a topic: between two poses the recorded motion is kept
and the correction is interpolated (`corrections`). What was recorded may be another robot's, or of
a clock of its own. So every second pose is left out first, and foretold from the others: recorded
motion is used where it comes nearer (by the median) than straight lines do.
"""

from __future__ import annotations

import numpy as np

from ogm_mcmc.arrays import Float64Array, Int64Array
from ogm_mcmc.engine.corrections import Nodes, corrected_poses
from ogm_mcmc.engine.robot_track import RobotTrack, turned_back
from ogm_mcmc.geometry import Pose2D

__all__ = ['seldom', 'track_of', 'with_recorded_motion']

# A radian errs by as much as so many metres.
METRES_A_RADIAN = 1.0

# Less is no difference, m.
SLACK_M = 1e-3


# Recorded poses are looked at so often: wheels that tell a thousand a second need no more room.
EVERY_NS = 20_000_000


def seldom(stamps_ns: Int64Array) -> Int64Array:
    """Return the first of the stamps (N,) in every `EVERY_NS`, in rising order."""
    rising = np.unique(stamps_ns)
    _, first = np.unique(rising // EVERY_NS, return_index=True)
    found: Int64Array = rising[first]
    return found


def track_of(stamps_ns: Int64Array, poses: Float64Array) -> RobotTrack:
    """Return poses (N, 3) at stamps (N,) in rising order as a track."""
    track = RobotTrack(max(len(stamps_ns), 1))
    for stamp_ns, pose in zip(stamps_ns.tolist(), poses.tolist(), strict=True):
        track.add(stamp_ns, Pose2D(*pose))
    return track


def with_recorded_motion(nodes: Nodes, recorded: RobotTrack) -> Nodes | None:
    """Return the nodes and, between them, the recorded poses as these correct them.

    None where recorded motion says nothing of what lies between, or worse than straight lines.
    """
    stamps = recorded.stamps
    if len(recorded) < 2 or not _foretells(nodes, recorded):
        return None
    between = stamps[~np.isin(stamps, nodes.stamps_ns)]
    poses, covered = corrected_poses(recorded, nodes, between)
    if not covered.any():
        return None
    all_stamps = np.concatenate((nodes.stamps_ns, between[covered]))
    order = np.argsort(all_stamps, kind='stable')
    return Nodes(all_stamps[order], np.concatenate((nodes.poses, poses[covered]))[order])


def _foretells(nodes: Nodes, recorded: RobotTrack) -> bool:
    """Whether recorded motion tells nodes that were left out better than straight lines do."""
    kept = Nodes(nodes.stamps_ns[::2], nodes.poses[::2])
    asked, true = nodes.stamps_ns[1::2], nodes.poses[1::2]
    told, covered = corrected_poses(recorded, kept, asked)
    covered &= asked <= kept.stamps_ns[-1]
    if not covered.any():
        return True  # nothing speaks against it
    straight = track_of(*kept).at(asked[covered])
    return _error(told[covered], true[covered]) <= _error(straight, true[covered]) + SLACK_M


def _error(poses: Float64Array, true: Float64Array) -> float:
    away = poses - true
    turn = np.abs(turned_back(away[:, 2]))
    return float(np.median(np.hypot(away[:, 0], away[:, 1]) + METRES_A_RADIAN * turn))

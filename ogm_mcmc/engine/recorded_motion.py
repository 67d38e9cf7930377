"""Poses between those of a trajectory file, by the motion that was recorded.

Design note: what lies between two poses of a file
--------------------------------------------------
Context. SLAM systems keep poses of some scans only, half a metre or half a radian apart. A robot
that turns on the spot and goes on between two of them was never on the line from one to the
other: office, 2 scans a second, true poses every 0.5 m: by straight lines walls lay metres off.

Decision. As where a trajectory comes in on a topic: between two poses the recorded motion is kept
and the correction is interpolated (`corrections`). What was recorded may be another robot's, or of
a clock of its own. So every second pose is left out first, and foretold from the others: recorded
motion is used where it comes nearer (by the median) than straight lines do. Poses held beside the
ends of a file would be foretold by anything: they come afterwards (`bag_topics`).

Nothing is filled in where the file is silent for long, or where it and what was recorded disagree
on how the robot went from one pose to the next: it was carried, or found elsewhere. They agree if
they differ by no more than wheels may err: 0.1 m and 0.1 rad (as in `geometry.motion`), 30 % of
the way and of what was turned, and 0.1 rad a metre. Where they disagree the pose is interpolated
or missing, as without odometry. Office (`simulate office --drive --rate 2`), true poses kept every
0.5 m, 3 s and 8 s: scans lie 0.5, 1.1 and 2.9 cm off (median; at most 6, 8, 11) with bad wheels
(`--drift 1`), 1.5, 3.5 and 8.7 cm with wheels three times as bad; none between two poses is lost.
"""

from __future__ import annotations

import math

import numpy as np

from ogm_mcmc.arrays import BoolArray, Float64Array, Int64Array
from ogm_mcmc.engine.corrections import Nodes, corrected_poses
from ogm_mcmc.engine.robot_track import RobotTrack, turned_back
from ogm_mcmc.geometry import Pose2D
from ogm_mcmc.geometry.motion import SLACK_M, SLACK_RAD
from ogm_mcmc.trajectory.moves import relative_poses

__all__ = ['seldom', 'track_of', 'with_recorded_motion']

# A radian errs by as much as so many metres.
METRES_A_RADIAN = 1.0

# Less is no difference, m.
NO_MORE_M = 1e-3

# Wheels err by no more than this share of the way and of what the robot turned, and by so many
# radians a metre.
ERR_SHARE = 0.3
ERR_RAD_A_METRE = 0.1

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


def with_recorded_motion(
    nodes: Nodes, recorded: RobotTrack, longest_s: float = math.inf
) -> Nodes | None:
    """Return the nodes and, between them, the recorded poses as these correct them.

    Nodes more than `longest_s` apart, or that went another way than was recorded, have none
    between them. None where there is none at all, or where recorded motion foretells nodes worse
    than straight lines.
    """
    stamps = recorded.stamps
    if len(recorded) < 2 or not _foretells(nodes, recorded):
        return None
    between = stamps[~np.isin(stamps, nodes.stamps_ns)]
    poses, covered = corrected_poses(recorded, nodes, between)
    gap = np.searchsorted(nodes.stamps_ns, between) - 1
    covered[covered] = _agreed(nodes, recorded, longest_s)[gap[covered]]
    if not covered.any():
        return None
    all_stamps = np.concatenate((nodes.stamps_ns, between[covered]))
    order = np.argsort(all_stamps, kind='stable')
    return Nodes(all_stamps[order], np.concatenate((nodes.poses, poses[covered]))[order])


def _agreed(nodes: Nodes, recorded: RobotTrack, longest_s: float) -> BoolArray:
    """Whether recorded motion from each node to the next (N - 1,) is about theirs."""
    known = recorded.spans(nodes.stamps_ns)
    near = np.diff(nodes.stamps_ns) <= longest_s * 1e9
    theirs, ours = (
        relative_poses(poses[:-1], poses[1:])
        for poses in (nodes.poses, recorded.at(nodes.stamps_ns))
    )
    away = theirs - ours
    since = recorded.stamps - recorded.stamps[0]
    step = np.abs(np.diff(recorded.poses, axis=0))
    gone = np.stack((np.hypot(step[:, 0], step[:, 1]), np.abs(turned_back(step[:, 2]))))
    # How far it went and turned up to each node.
    way, turned = (
        np.diff(np.interp(nodes.stamps_ns - recorded.stamps[0], since, np.append(0.0, total)))
        for total in np.cumsum(gone, axis=1)
    )
    place = np.hypot(away[:, 0], away[:, 1]) <= SLACK_M + ERR_SHARE * way
    heading = np.abs(turned_back(away[:, 2])) <= (
        SLACK_RAD + ERR_SHARE * turned + ERR_RAD_A_METRE * way
    )
    agreed: BoolArray = known[:-1] & known[1:] & near & place & heading
    return agreed


def _foretells(nodes: Nodes, recorded: RobotTrack) -> bool:
    """Whether recorded motion tells nodes that were left out better than straight lines do."""
    kept = Nodes(nodes.stamps_ns[::2], nodes.poses[::2])
    asked, true = nodes.stamps_ns[1::2], nodes.poses[1::2]
    told, covered = corrected_poses(recorded, kept, asked)
    covered &= asked <= kept.stamps_ns[-1]
    if not covered.any():
        return True  # nothing speaks against it
    straight = track_of(*kept).at(asked[covered])
    return _error(told[covered], true[covered]) <= _error(straight, true[covered]) + NO_MORE_M


def _error(poses: Float64Array, true: Float64Array) -> float:
    away = poses - true
    turn = np.abs(turned_back(away[:, 2]))
    return float(np.median(np.hypot(away[:, 0], away[:, 1]) + METRES_A_RADIAN * turn))

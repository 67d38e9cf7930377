"""The past as a SLAM system sees it today: scans placed anew by a corrected trajectory.

A trajectory tells poses of the robot at some stamps, its nodes. Between two nodes the recorded
motion is kept and the *correction* is interpolated: a scan is carried along by the node before
it, and by the node after it, as it was seen from there at the time, and the mean of the two is
taken, weighted by time. So at a node the scan is where the node says, where both nodes moved
alike the motion between them is the recorded one, and a turn far from the origin does no harm.

Scans before the first node and after the last one stay: nothing is said of them. Where the
recorded poses jump between two nodes (the localizer found its place again), the scan goes with
the node on its own side of the jump.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import BoolArray, Float64Array, Int64Array
from ogm_mcmc.engine.robot_track import MOST_POSES, RobotTrack, turned_back
from ogm_mcmc.geometry import PlacedScan, Pose2D

__all__ = ['MOVED_CELLS', 'Corrected', 'Corrector', 'Nodes', 'corrected_poses', 'furthest_way']

MOVED_CELLS = 0.25
"""Scans that moved less are left where they are, and chains on them go on."""


class Nodes(NamedTuple):
    """Poses of the robot (N, 3), x, y, m, yaw, rad, at stamps (N,) in ns that increase."""

    stamps_ns: Int64Array
    poses: Float64Array


class Corrected(NamedTuple):
    """Scans as they are placed now, in their order; those that hardly moved are the same objects.

    `covered`: of how many the trajectory says something; `moved`: how many are placed anew.
    """

    scans: list[PlacedScan]
    covered: int
    moved: int
    furthest_m: float


class Corrector:
    """Notes every placed scan; places scans anew when a corrected trajectory comes.

    `most` poses of the robot are noted, beyond that every second one goes.
    """

    def __init__(self, most: int = MOST_POSES) -> None:
        self.track = RobotTrack(min(most, MOST_POSES))

    def note(self, placed: PlacedScan) -> None:
        """Note where the robot was said to be."""
        robot = placed.pose.compose(placed.belief.offset.inverse())
        self.track.add(placed.scan.stamp_ns, robot)

    def clear(self) -> None:
        """Forget everything."""
        self.track.clear()

    def copy(self) -> Corrector:
        """Return one that knows the same, for another thread."""
        copy = Corrector()
        copy.track = self.track.copy()
        return copy

    def applied(self, scans: Sequence[PlacedScan], nodes: Nodes, resolution_m: float) -> Corrected:
        """Place scans anew; `resolution_m` decides which moved at all."""
        stamps = np.array([placed.scan.stamp_ns for placed in scans], np.int64)
        poses, covered = corrected_poses(self.track, nodes, stamps)
        found, moved, furthest_m = list(scans), 0, 0.0
        nearly = MOVED_CELLS * resolution_m
        for index in map(int, _may_move(scans, poses, covered, nearly)):
            placed = scans[index]
            pose = Pose2D(*map(float, poses[index])).compose(placed.belief.offset)
            way_m = furthest_way(placed, pose)
            if way_m > nearly:
                found[index] = placed._replace(belief=placed.belief.carried_to(pose))
                moved += 1
                furthest_m = max(furthest_m, way_m)
        return Corrected(found, int(covered.sum()), moved, furthest_m)


def corrected_poses(
    track: RobotTrack, nodes: Nodes, stamps_ns: Int64Array
) -> tuple[Float64Array, BoolArray]:
    """Return the poses (M, 3) of the robot at stamps (M,), and where the nodes say something."""
    known = track.spans(nodes.stamps_ns)
    node_stamps, node_poses = nodes.stamps_ns[known], nodes.poses[known]
    poses = np.full((stamps_ns.size, 3), np.nan)
    if node_stamps.size == 0 or stamps_ns.size == 0:
        return poses, np.zeros(stamps_ns.size, bool)
    covered = (stamps_ns >= node_stamps[0]) & (stamps_ns <= node_stamps[-1])
    asked = stamps_ns[covered]
    after = np.clip(np.searchsorted(node_stamps, asked), 0, node_stamps.size - 1)
    before = np.where(node_stamps[after] == asked, after, np.maximum(after - 1, 0))
    recorded, at_nodes = track.at(asked), track.at(node_stamps)
    first = _carried(node_poses[before], at_nodes[before], recorded)
    second = _carried(node_poses[after], at_nodes[after], recorded)
    gap = np.maximum(node_stamps[after] - node_stamps[before], 1)
    share = (asked - node_stamps[before]) / gap
    own, of_nodes = track.pieces(asked), track.pieces(node_stamps)
    with_first, with_second = own == of_nodes[before], own == of_nodes[after]
    share = np.where(with_first & ~with_second, 0.0, share)
    share = np.where(with_second & ~with_first, 1.0, share)[:, None]
    step = second - first
    step[:, 2] = turned_back(step[:, 2])
    mean = first + share * step
    mean[:, 2] = turned_back(mean[:, 2])
    poses[covered] = mean[_first_of_standing(recorded)]
    return poses, covered


def _first_of_standing(recorded: Float64Array) -> Int64Array:
    """Return for each of recorded poses (M, 3) the first of those before that are the same.

    A robot that stood still stood in one place, whatever nodes say of the time.
    """
    moved = np.ones(len(recorded), np.bool_)
    moved[1:] = (np.diff(recorded, axis=0) != 0.0).any(axis=1)
    first: Int64Array = np.maximum.accumulate(np.where(moved, np.arange(len(recorded)), 0))
    return first


def _carried(node: Float64Array, at_node: Float64Array, recorded: Float64Array) -> Float64Array:
    """Return node o at_node^-1 o recorded, row by row (M, 3)."""
    turn = node[:, 2] - at_node[:, 2]
    cosine, sine = np.cos(turn), np.sin(turn)
    x, y = (recorded[:, :2] - at_node[:, :2]).T
    return np.stack(
        (
            node[:, 0] + cosine * x - sine * y,
            node[:, 1] + sine * x + cosine * y,
            turned_back(recorded[:, 2] + turn),
        ),
        axis=1,
    )


def _may_move(
    scans: Sequence[PlacedScan], poses: Float64Array, covered: BoolArray, nearly: float
) -> Int64Array:
    """Return the scans that may move by more than `nearly`, m, at robot poses (M, 3).

    A look at all of them at once: a SLAM system may tell its trajectory every second.
    """
    rows = [
        (pose.x_m, pose.y_m, pose.yaw_rad, at.x_m, at.y_m, at.yaw_rad, one.scan.range_max_m)
        for one in scans
        for pose, at in ((one.belief.mean, one.belief.offset),)
    ]
    old_x, old_y, old_yaw, at_x, at_y, at_yaw, reach = np.array(rows).reshape(-1, 7).T
    x, y, yaw = poses.T
    cosine, sine = np.cos(yaw), np.sin(yaw)
    way = np.hypot(
        x + cosine * at_x - sine * at_y - old_x, y + sine * at_x + cosine * at_y - old_y
    )
    turn = np.abs(turned_back(yaw + at_yaw - old_yaw))
    with np.errstate(invalid='ignore'):
        most = way + np.where(turn > 0.0, turn * reach, 0.0)
    candidates: Int64Array = np.flatnonzero(covered & ~(most <= nearly))
    return candidates


def furthest_way(placed: PlacedScan, pose: Pose2D) -> float:
    """Return an upper bound of how far any reading of a scan moves to another pose, m."""
    scan, old = placed.scan, placed.pose
    way_m = math.hypot(pose.x_m - old.x_m, pose.y_m - old.y_m)
    turn = abs(math.remainder(pose.yaw_rad - old.yaw_rad, 2.0 * math.pi))
    if turn < 1e-9:
        return way_m
    ranges = scan.ranges_m[np.isfinite(scan.ranges_m)]
    reach_m = float(ranges.max(initial=0.0))
    if (scan.ranges_m == np.inf).any() and math.isfinite(scan.range_max_m):
        reach_m = scan.range_max_m
    return way_m + turn * reach_m

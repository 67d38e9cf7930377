"""Whether poses on a topic can be those of the robot: they move as far as its odometry does.

A ball that is tracked, a dock or a target may be published as often as there are scans, in the
frame of the map. What tells them from the robot is that the robot drives and they do not, or go
elsewhere. A localizer and the odometry agree on how far the robot went, though not on where.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ogm_mcmc.arrays import Float64Array, Int64Array
from ogm_mcmc.engine.pose_choice import FILE, TF, PoseCandidate, PoseChoice, choose_poses
from ogm_mcmc.engine.transform_tree import TransformError, TransformTree
from ogm_mcmc.errors import BagError, PoseError
from ogm_mcmc.io import messages, ros_types
from ogm_mcmc.io.bags import BagReader

__all__ = ['choose_robot_poses', 'moves_alike', 'moves_like']

# Places are compared at so many stamps, spread over the recording.
STAMPS = 100

# Steps on which the odometry went at least so far count; fewer than so many tell nothing.
MOVED_M = 0.1
FEWEST_STEPS = 3

# A localizer corrects and wheels slip; more than this share of the way more or less is another.
ALIKE = 2.0


def choose_robot_poses(
    bag: BagReader,
    tree: TransformTree,
    scan_stamps: Int64Array,
    wanted: Sequence[PoseCandidate],
    *,
    unwanted: Sequence[PoseCandidate] = (),
    max_gap_s: float = 2.0,
    named: bool = False,
) -> tuple[PoseChoice, list[str]]:
    """Choose poses as `choose_poses` does, but none that odometry tells are not the robot's.

    named: the user said which; nothing is compared then. Returns lines about others, too.
    """
    lines: list[str] = []
    while True:
        poses = choose_poses(
            wanted, scan_stamps, max_gap_s=max_gap_s, unwanted=unwanted, any_place=named
        )
        if named or poses.chosen is None:
            return poses, lines
        best, odometry = poses.chosen.candidate, poses.odometry()
        sure = best.kind in (TF, FILE, ros_types.ODOMETRY) or best.elsewhere
        if sure or odometry is None or moves_like(bag, tree, best, odometry, scan_stamps):
            return poses, lines
        lines.append(f'{best.name} does not move as {odometry.name} does: not taken for the robot')
        wanted = [one._replace(elsewhere=True) if one is best else one for one in wanted]


def moves_like(
    bag: BagReader,
    tree: TransformTree,
    source: PoseCandidate,
    odometry: PoseCandidate,
    scan_stamps: Int64Array,
) -> bool:
    """Return whether poses on a topic go as far as odometry does between scans (S,) ns.

    True where the robot stands, or where they share too few stamps to tell.
    """
    every = max(1, -(-scan_stamps.size // STAMPS))
    stamps = np.sort(scan_stamps)[::every]
    return moves_alike(_places(bag, tree, source, stamps), _places(bag, tree, odometry, stamps))


def moves_alike(places: Float64Array, odometry: Float64Array) -> bool:
    """Return whether places (M, 2) go as far from one to the next as those of odometry (M, 2).

    nan: not known.
    """
    steps = np.hypot(*np.diff(places, axis=0).T)
    way = np.hypot(*np.diff(odometry, axis=0).T)
    counts = np.isfinite(steps) & (way >= MOVED_M)
    if np.count_nonzero(counts) < FEWEST_STEPS:
        return True
    share = float(np.median(steps[counts] / way[counts]))
    return 1.0 / ALIKE <= share <= ALIKE


def _places(
    bag: BagReader, tree: TransformTree, source: PoseCandidate, stamps: Int64Array
) -> Float64Array:
    """Return places (M, 2) at stamps (M,); nan before the first entry and after the last."""
    if source.kind == TF:
        return np.array([_place_in_tree(tree, source, int(stamp)) for stamp in stamps])
    known: dict[int, tuple[float, float]] = {}
    for record in bag.records((source.name,)):
        try:
            message: Any = bag.decode(record)
            stamp_ns = record.time_ns if source.unstamped else messages.stamp_of(message)
            known[stamp_ns] = _place(message)
        except (PoseError, BagError):
            continue
    if not known:
        return np.full((stamps.size, 2), np.nan)
    order = sorted(known)
    table = np.array([known[stamp] for stamp in order])
    # Nanoseconds of today do not fit into floats: from the first scan on they do.
    at, since = (stamps - stamps[0]).astype(float), np.array(order) - stamps[0]
    columns = [np.interp(at, since, column, np.nan, np.nan) for column in table.T]
    return np.stack(columns, axis=1)


def _place(message: Any) -> tuple[float, float]:
    if hasattr(message, 'poses') or hasattr(message, 'particles'):
        mean = messages.read_particles(message).mean
    else:
        mean = messages.read_pose(message, with_covariance=False).mean
    return mean.x_m, mean.y_m


def _place_in_tree(
    tree: TransformTree, source: PoseCandidate, stamp_ns: int
) -> tuple[float, float]:
    try:
        x, y, _ = tree.lookup(source.frame, source.child_frame, stamp_ns).translation
    except TransformError:
        return np.nan, np.nan
    return x, y

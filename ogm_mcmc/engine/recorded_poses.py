"""All poses that a bag holds of one source, and a trajectory file filled in by its odometry."""

from __future__ import annotations

import contextlib
from typing import Any

import numpy as np

from ogm_mcmc.arrays import Float64Array, Int64Array
from ogm_mcmc.engine.corrections import Nodes
from ogm_mcmc.engine.placing import PoseSource
from ogm_mcmc.engine.pose_choice import TF, PoseCandidate
from ogm_mcmc.engine.pose_history import PoseHistory, PoseLimits, Unplaceable, Waiting
from ogm_mcmc.engine.recorded_motion import seldom, track_of, with_recorded_motion
from ogm_mcmc.engine.tf_poses import TfPoses
from ogm_mcmc.engine.transform_tree import TransformTree
from ogm_mcmc.errors import BagError, PoseError
from ogm_mcmc.geometry import Pose2D
from ogm_mcmc.io import messages
from ogm_mcmc.io.bags import BagReader
from ogm_mcmc.io.trajectory_files import Trajectory

__all__ = ['LONGEST', 'filled_in', 'recorded_poses']

LONGEST = 10_000_000
"""Poses of a topic kept where all are asked for."""

# Between poses of a file so many times as far apart as `max_pose_gap` allows, recorded motion may
# fill in: SLAM systems keep a pose every few seconds.
FILLED_GAPS = 5


def recorded_poses(
    bag: BagReader, tree: TransformTree, source: PoseCandidate, limits: PoseLimits
) -> PoseSource:
    """Return all poses of a source in a bag; messages at fault are passed over."""
    if source.kind == TF:
        return TfPoses(tree, source.frame, source.child_frame, complete=True, **limits)
    history = PoseHistory(keep=LONGEST, **limits)
    for record in bag.records((source.name,)):
        with contextlib.suppress(PoseError, BagError):
            message: Any = bag.decode(record)
            belief = messages.read_pose(message, with_covariance=False)
            stamp_ns = record.time_ns if source.unstamped else messages.stamp_of(message)
            history.add(stamp_ns, belief)
    return history


def filled_in(
    bag: BagReader,
    tree: TransformTree,
    trajectory: Trajectory,
    odometry: PoseCandidate,
    limits: PoseLimits,
) -> Trajectory | None:
    """Return a trajectory with poses between its own, as odometry went from one to the next.

    None where odometry says nothing of that, or nothing that can be believed.
    """
    source, known, rows = recorded_poses(bag, tree, odometry, limits), [], []
    for stamp_ns in seldom(np.concatenate(odometry.stamps)).tolist():
        with contextlib.suppress(Waiting, Unplaceable, PoseError):
            pose = source.at(stamp_ns).mean
            known.append(stamp_ns)
            rows.append((pose.x_m, pose.y_m, pose.yaw_rad))
    recorded = track_of(np.array(known, np.int64), np.array(rows).reshape(-1, 3))
    poses = np.array([(pose.x_m, pose.y_m, pose.yaw_rad) for pose in trajectory.poses])
    longest_s = FILLED_GAPS * limits['max_gap_s']
    filled = with_recorded_motion(Nodes(trajectory.stamps_ns, poses), recorded, longest_s)
    if filled is None:
        return None
    return Trajectory(
        filled.stamps_ns,
        tuple(Pose2D(*row) for row in filled.poses.tolist()),
        trajectory.format,
        _deviations_at(filled.stamps_ns, trajectory),
    )


def _deviations_at(stamps_ns: Int64Array, trajectory: Trajectory) -> Float64Array | None:
    """Return the deviations (N, 3) of poses between those of a trajectory, where it has any.

    Variances go straight from one pose to the next, as `PoseHistory` has it.
    """
    if trajectory.deviations is None:
        return None
    known, begin = trajectory.deviations**2, trajectory.stamps_ns[0]
    at, since = stamps_ns - begin, trajectory.stamps_ns - begin
    told = np.stack([np.interp(at, since, column) for column in known.T], axis=1)
    return np.asarray(np.sqrt(told), np.float64)

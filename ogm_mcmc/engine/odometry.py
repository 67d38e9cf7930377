"""What odometry says of how the robot went between scans, beside what a localizer believed.

Which: of all that a recording holds besides the poses in use, poses in a frame with odom in its
name: those of tf, or of nav_msgs/Odometry. Wheels slip: `Moves.of_wheels` has heavy tails, and how
well its moves fit is estimated with the poses.
"""

from __future__ import annotations

from bisect import bisect, insort
from collections.abc import Callable, Sequence

import numpy as np

from ogm_mcmc.arrays import AnyArray, Float64Array
from ogm_mcmc.engine.placing import PoseSource
from ogm_mcmc.engine.pose_choice import TF, PoseChoice, RankedPoses, is_called_odom
from ogm_mcmc.engine.pose_history import RESTART_NS, PoseHistory, Unplaceable, Waiting
from ogm_mcmc.engine.transform_tree import TransformTree
from ogm_mcmc.errors import PoseError
from ogm_mcmc.geometry import PlacedScan, Pose2D, PoseBelief
from ogm_mcmc.io import ros_types
from ogm_mcmc.trajectory import Moves

__all__ = [
    'OdometryAt',
    'OdometryTrack',
    'is_of_base',
    'odometry_among',
    'odometry_frame',
    'said_odometry',
    'wheel_moves',
]

# Odometry that covers less than half of the scans is not worth a word.
LEAST_COVERAGE = 0.5

# Scans whose odometry is known; a recording holds fewer.
MOST_KNOWN = 200_000

# Scans that wait for odometry that may still come.
MOST_WAITING = 1000

OdometryAt = Callable[[int], 'Pose2D | None']
"""Where the robot was at a stamp, ns, as odometry has it; None where it does not say."""


class OdometryTrack:
    """Odometry at the stamps of scans, resolved as it comes in; the rest of it is forgotten."""

    def __init__(self, source: PoseSource | None = None) -> None:
        self.source: PoseSource = PoseHistory(keep=2000) if source is None else source
        self._known: dict[int, Pose2D] = {}
        self._waiting: list[int] = []  # in order

    def __len__(self) -> int:
        """Return the number of stamps at which it is known."""
        return len(self._known)

    @property
    def n_waiting(self) -> int:
        """The number of stamps at which it may still become known."""
        return len(self._waiting)

    def add(self, stamp_ns: int, belief: PoseBelief) -> None:
        """Take a pose of the odometry, where that comes as messages."""
        assert isinstance(self.source, PoseHistory)
        self.source.add(stamp_ns, belief)

    def want(self, stamp_ns: int) -> None:
        """Have the pose at a stamp kept, now or when it is known."""
        waiting = self._waiting
        if waiting and stamp_ns < waiting[-1] - RESTART_NS:  # time started again
            del waiting[bisect(waiting, stamp_ns) :]
        insort(waiting, stamp_ns)
        if len(waiting) > MOST_WAITING:
            del waiting[0]
        self.settle()

    def settle(self) -> None:
        """Keep what is known by now of what is wanted.

        Where the first stamp has to wait so have the later ones: they are not tried.
        """
        done = 0
        for stamp_ns in self._waiting:
            try:
                pose = self.source.at(stamp_ns).mean
            except Waiting:
                break
            except (Unplaceable, PoseError):
                pass
            else:
                self._known[stamp_ns] = pose
                if len(self._known) > MOST_KNOWN:
                    del self._known[next(iter(self._known))]
            done += 1
        del self._waiting[:done]

    def at(self, stamp_ns: int) -> Pose2D | None:
        """Return the pose at a stamp that was wanted; None where it is not known."""
        return self._known.get(stamp_ns)

    def clear(self) -> None:
        """Forget everything."""
        self.source.clear()
        self._known.clear()
        self._waiting.clear()


def odometry_among(poses: PoseChoice, base_frame: str, tree: TransformTree) -> RankedPoses | None:
    """Return the odometry of a recording that is not in use as poses already; None: there is none.

    Nor is there any beside poses in a frame of odometry, whatever messages they are: it would
    count twice. Of several what covers most scans; of a frame that sits elsewhere on the robot
    than the base, as far as tf knows, none.
    """
    if poses.chosen is not None and is_called_odom(poses.chosen.candidate.frame):
        return None
    found = [
        one
        for one in poses.others
        if _is_odometry(one)
        and one.coverage >= LEAST_COVERAGE
        and is_of_base(one.candidate.child_frame, base_frame, tree)
    ]
    return max(found, key=lambda one: (one.coverage, one.candidate.kind != TF), default=None)


def _is_odometry(one: RankedPoses) -> bool:
    source = one.candidate
    kind = source.kind in (TF, ros_types.ODOMETRY)
    return kind and is_called_odom(source.frame)


def is_of_base(child_frame: str, base_frame: str, tree: TransformTree) -> bool:
    """Return whether odometry is that of the base, as far as tf knows."""
    return child_frame in ('', base_frame) or not tree.frames()


def odometry_frame(tree: TransformTree, base_frame: str) -> str:
    """Return the frame of odometry above the base; empty where tf knows none."""
    return next((frame for frame in tree.ancestors(base_frame)[1:] if is_called_odom(frame)), '')


def wheel_moves(
    scans: Sequence[PlacedScan], order: AnyArray, odometry: OdometryAt
) -> Moves | None:
    """Return how sensors went from scan to scan in the `order` (K,); None where nothing says so.

    Each pose of the robot is carried to the sensor by where that sits on it.
    """
    poses: Float64Array = np.full((len(scans), 3), np.nan)
    for k, placed in enumerate(scans):
        robot = odometry(placed.scan.stamp_ns)
        if robot is not None:
            sensor = robot.compose(placed.belief.offset)
            poses[k] = sensor.x_m, sensor.y_m, sensor.yaw_rad
    moves = Moves.of_wheels(poses, order)
    return moves if moves.first.size else None


def said_odometry(name: str, moves: Moves | None, n_scans: int, scale: float = 1.0) -> str:
    """Return a line for the user: what was used, and how well it fits."""
    if moves is None:
        return 'poses without odometry: none is there beside the poses in use'
    return (
        f'odometry of {name} used for {moves.first.size} of {max(n_scans - 1, 0)} steps between '
        f'scans; errs {np.sqrt(scale):.1f} times as much as taken for granted'
    )

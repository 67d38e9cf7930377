"""What to use of a bag, as the user asks for it, and what was chosen."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from ogm_mcmc.config import MountConfig
from ogm_mcmc.engine.pose_choice import PoseChoice
from ogm_mcmc.engine.pose_history import PoseLimits
from ogm_mcmc.engine.transform_tree import TransformTree
from ogm_mcmc.errors import BagError
from ogm_mcmc.geometry.motion import MAX_SPEED_M_S, MAX_TURN_RAD_S
from ogm_mcmc.io.bags import BagRecord, BagTopic
from ogm_mcmc.io.trajectory_files import Trajectory

__all__ = ['StreamChoice', 'StreamTopics']


@dataclass(frozen=True)
class StreamChoice:
    """What to use of a bag; empty names stand for what fits best.

    `scan_topic` and, with `sensor` range, that of Range messages may name several topics,
    separated by commas. `pose_source`: auto or one of `POSE_SOURCES`. With `trajectory` poses are
    those of a file (`trajectory_stamps` beside it where its format keeps none), of
    `trajectory_frame` (empty: the base). `map_frame` and `base_frame` matter to tf. With
    `beliefs` false covariances are not looked at, with `deviations` false only those in a file
    beside `trajectory` are not. `no_return_code_m`: see `RangeCodes`.
    """

    scan_topic: str = ''
    pose_topic: str = ''
    pose_source: str = 'auto'
    max_pose_gap_s: float = 2.0
    sensor: str = 'scan'
    mounts: MountConfig = MountConfig()  # noqa: RUF009 - frozen
    max_speed_m_s: float = MAX_SPEED_M_S
    max_turn_rad_s: float = MAX_TURN_RAD_S
    deskew: str = 'auto'
    no_return_code_m: float = 0.0
    trajectory: Path | None = None
    trajectory_stamps: Path | None = None
    trajectory_frame: str = ''
    map_frame: str = ''
    base_frame: str = ''
    beliefs: bool = True
    deviations: bool = True

    @property
    def limits(self) -> PoseLimits:
        """Between which poses those of a scan are taken: arguments of a source of poses."""
        return {
            'max_gap_s': self.max_pose_gap_s,
            'max_speed_m_s': self.max_speed_m_s,
            'max_turn_rad_s': self.max_turn_rad_s,
        }


class StreamTopics(NamedTuple):
    """What was chosen: topics with readings, poses and their frames, transforms.

    `pose_source` is one of `POSE_SOURCES` or `trajectory`, `pose_name` the topic, tf or the name
    of the file. Poses are those of `base_frame` in `map_frame`. `remarks`: lines for the user.
    `sensors`: frame of each, and a stamp of one of its scans. `unstamped`: topics whose messages
    count by the times they were recorded at, for want of a stamp. `trajectory`: all poses that are
    used of a file, with `filled_in` also those that odometry tells between them. `sampled`: scans
    from all over the bag. `unstamped_frames`: those whose transforms count by the times they were
    recorded at, from sensors and base up to the root.
    """

    scans: tuple[BagTopic, ...]
    poses: PoseChoice
    pose_source: str
    map_frame: str
    base_frame: str
    tree: TransformTree
    trajectory: Trajectory | None = None
    remarks: tuple[str, ...] = ()
    sensors: tuple[tuple[str, int], ...] = ()
    unstamped: frozenset[str] = frozenset()
    filled_in: bool = False
    sampled: tuple[BagRecord, ...] = ()
    unstamped_frames: tuple[str, ...] = ()

    @property
    def pose_name(self) -> str:
        """The topic, `tf`, or the name of the file."""
        assert self.poses.chosen is not None
        return self.poses.chosen.candidate.name

    @property
    def scan_names(self) -> str:
        """All topics with readings, for people and files."""
        return ','.join(topic.name for topic in self.scans)

    def require_stamps(self, path: Path) -> None:
        """Refuse what nodes cannot place: they see no times of recording. Raises BagError."""
        if self.unstamped:
            raise BagError(
                f'{path}: stamps on {", ".join(sorted(self.unstamped))} are all 0 or all the '
                'same: expected those of the measurements, by which nodes place scans (`map` '
                'takes the times of recording)'
            )

    @property
    def n_scans(self) -> int:
        """Number of readings on them."""
        return sum(topic.n_messages for topic in self.scans)

    def as_dict(self) -> dict[str, Any]:
        """Return what was chosen, for files of results."""
        return {
            'scan_topic': self.scan_names,
            'pose_topic': self.pose_name,
            'pose_source': self.pose_source,
            'poses': str(self.poses),
            'scans': self.n_scans,
        }

"""Scans of a bag, each with the belief about its sensor's pose: the one door for recordings."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from ogm_mcmc.engine.bag_topics import choose_topics, said_unstamped
from ogm_mcmc.engine.mounts import MountFound, Mounts
from ogm_mcmc.engine.odometry import OdometryAt, odometry_among
from ogm_mcmc.engine.placing import DROP_REASONS, PoseSource, RobotScan, ScanPlacer, final_belief
from ogm_mcmc.engine.pose_history import PoseHistory, Unplaceable, Waiting
from ogm_mcmc.engine.range_codes import RangeCodes
from ogm_mcmc.engine.recorded_poses import LONGEST, recorded_poses
from ogm_mcmc.engine.stream_choice import StreamChoice, StreamTopics
from ogm_mcmc.engine.tf_poses import TfPoses
from ogm_mcmc.errors import BagError, PoseError, ScanError
from ogm_mcmc.geometry import PlacedScan, Pose2D, Scan
from ogm_mcmc.geometry.scan import Remark, say_nothing
from ogm_mcmc.io import messages
from ogm_mcmc.io.bags import BagReader, BagRecord

__all__ = ['PlacedScans', 'StreamChoice', 'StreamTopics', 'choose_topics', 'open_scans']

# Remarks on so many kinds of oddities; more help nobody.
MAX_REMARKS = 20


@dataclass
class PlacedScans:
    """Iterate over a bag's placed scans; afterwards `placer.dropped` says what was left out.

    The same reading and placing as in the live node. In a file nothing comes late: a scan waits
    for its pose until the end of the bag. A message at fault is dropped and counted. Sensors sit
    where parameters say, else where tf does, else at the robot's origin. Raises BagError when no
    scan could be placed. `tell` hears each thing a user should know once, in a line: what was
    chosen at the start, where each sensor sits, what is odd about the scans. `frames` are those
    of the scans placed, `mounts` what is known of their mounts (the newest).
    """

    bag: BagReader
    topics: StreamTopics
    choice: StreamChoice
    on_scan: Callable[[], object] = lambda: None
    tell: Remark = say_nothing
    placer: ScanPlacer = field(init=False)
    placed: int = field(default=0, init=False)
    frames: set[str] = field(default_factory=set, init=False)
    mounts: dict[str, MountFound] = field(default_factory=dict, init=False)
    first_fault: str = field(default='', init=False)
    odometry_name: str = field(default='', init=False)
    _mounts: Mounts = field(init=False)
    _codes: RangeCodes = field(init=False)
    _said: set[str] = field(default_factory=set, init=False)
    _hit: bool = field(default=False, init=False)
    _informed: bool = field(default=False, init=False)
    _last: Scan | None = field(default=None, init=False)

    def __post_init__(self) -> None:
        """Prepare the source of poses and that of mounts."""
        choice, topics = self.choice, self.topics
        transforms = TfPoses(
            topics.tree,
            topics.map_frame,
            topics.base_frame,
            complete=True,
            **choice.limits,
        )
        source: PoseSource = transforms if topics.pose_source == 'tf' else self._history()
        self._mounts = Mounts(
            choice.mounts,
            topics.base_frame,
            transforms=transforms if topics.tree.frames() else None,
            patience_s=0.0,
            tell=self._told_of_mount,
        )
        self._codes = RangeCodes(choice.no_return_code_m, lambda text: self.tell(text))
        self.placer = ScanPlacer(
            source, timeout_s=1.0, max_waiting=1_000_000, mounts=self._mounts, deskew=choice.deskew
        )

    def _history(self) -> PoseHistory:
        """Return the poses of a trajectory, or none yet."""
        known = self.topics.trajectory
        if known is None:
            return PoseHistory(**self.choice.limits, keep=10_000)
        history = PoseHistory(**self.choice.limits, keep=max(1, known.stamps_ns.size))
        for stamp_ns, belief in zip(known.stamps_ns.tolist(), known.beliefs(), strict=True):
            history.add(stamp_ns, belief)
        return history

    def __iter__(self) -> Iterator[PlacedScan]:
        """Yield placed scans in order of their stamps."""
        for line in self.topics.remarks:
            self.tell(line)
        self.learn_codes()
        scan_names = {topic.name for topic in self.topics.scans}
        poses = {self.topics.pose_name} - {'tf'} if self.topics.trajectory is None else set()
        for record in self.bag.records(scan_names | poses):
            where = f'{self.bag.path}: {record.topic} at {record.time_ns / 1e9:.3f} s'
            is_scan = record.topic in scan_names
            try:
                if is_scan:
                    self.on_scan()
                    self.placer.add_scan(self._scan(record))
                else:
                    self._take_pose(record)
            except (ScanError, PoseError, BagError) as error:
                self.placer.drop('scan_invalid' if is_scan else 'pose_invalid')
                self.first_fault = self.first_fault or f'{where}: {error}'
            yield from map(self._on_robot, self.placer.placed())
        yield from map(self._on_robot, self.placer.flush())
        if self.placed == 0:
            raise BagError(self._none_placed())
        for fault in self._mounts.faults.values():
            self.tell(f'scans left out: {fault}')
        self._tell_of_nothing()

    def _none_placed(self) -> str:
        """Say why no scan could be placed: each reason, how often, and the first fault."""
        line = f'{self.bag.path}: none of {self.topics.n_scans} scans could be placed'
        for reason, count in self.placer.dropped.most_common():
            line += f'; {reason} {count}: {DROP_REASONS[reason]}'
        faults = [*self._mounts.faults.values(), self.first_fault]
        if fault := next(filter(None, faults), ''):
            return f'{line}; the first fault: {fault}'
        return (
            f'{line}; expected poses on {self.topics.pose_name} around the stamps of '
            + self.topics.scan_names
        )

    def _tell_of_nothing(self) -> None:
        """Say so where no beam of any scan met something."""
        if self._hit or self._last is None:
            return
        scan = self._last
        limits = f'range_min {scan.range_min_m:g} to range_max {scan.range_max_m:g} m'
        if self._informed:
            self.tell(f'nothing was hit: every range is inf, or not from {limits}')
            return
        finite = scan.ranges_m[np.isfinite(scan.ranges_m)]
        found = f'from {finite.min():g} to {finite.max():g}' if finite.size else 'not finite'
        self.tell(
            f'nothing was measured: no range is from {limits}, or inf; those of the last scan are '
            + found
        )

    def robot_poses(self) -> PoseSource:
        """Return all poses of the robot there are, whatever the scans."""
        source = self.placer.source
        if isinstance(source, PoseHistory) and self.topics.trajectory is None:
            source.keep = LONGEST
            for record in self.bag.records((self.topics.pose_name,)):
                with contextlib.suppress(PoseError, BagError):
                    self._take_pose(record)
        return source

    def odometry(self) -> OdometryAt | None:
        """Return the odometry of the bag beside the poses in use; None where there is none.

        Nor where poses in use were filled in by it: it would be believed twice.
        """
        topics = self.topics
        found = odometry_among(topics.poses, topics.base_frame, topics.tree)
        if found is None or topics.filled_in:
            return None
        self.odometry_name = str(found)
        if found.candidate.unstamped:
            self.tell(said_unstamped([found.candidate.name]))
        source = recorded_poses(self.bag, topics.tree, found.candidate, self.choice.limits)

        def at(stamp_ns: int) -> Pose2D | None:
            try:
                return final_belief(source, stamp_ns).mean
            except (Waiting, Unplaceable, PoseError):
                return None

        return at

    def sensor_mounts(self) -> dict[str, MountFound]:
        """Return where each sensor sits, as `mounts` holds it, without reading the scans."""
        for frame, stamp_ns in self.topics.sensors:
            with contextlib.suppress(Waiting, Unplaceable):
                self._mounts.at(frame, stamp_ns, 0.0)
        return self.mounts

    def learn_codes(self) -> None:
        """Find the readings that stand for "nothing was hit", and tell of them."""
        some = []
        for record in self.topics.sampled:
            with contextlib.suppress(ScanError, BagError):
                some.append(messages.read_scan(self.bag.decode(record)))
        self._codes.learn(some)

    def _scan(self, record: BagRecord) -> Scan:
        message = self.bag.decode(record)
        if self.choice.sensor == 'range':
            scan = messages.read_range(message)
        else:
            scan = self._codes.taken(
                messages.read_scan(message, lambda text: self._once(f'{record.topic}: {text}'))
            )
        if record.topic in self.topics.unstamped:
            scan = replace(scan, stamp_ns=record.time_ns)
        return scan

    def _take_pose(self, record: BagRecord) -> None:
        message: Any = self.bag.decode(record)
        frame = messages.frame_of(message)
        if frame != self.topics.map_frame:
            self.placer.drop('pose_wrong_frame')
            return
        if self.topics.pose_source in ('particles', 'particle_cloud'):
            belief = messages.read_particles(message)
        else:
            belief = messages.read_pose(message, with_covariance=self.choice.beliefs)
        unstamped = record.topic in self.topics.unstamped
        self.placer.add_pose(record.time_ns if unstamped else messages.stamp_of(message), belief)

    def _on_robot(self, taken: RobotScan) -> PlacedScan:
        self.placed += 1
        self.frames.add(taken.scan.frame_id)
        if not self._hit:
            self._hit = bool(taken.scan.measured().any())
            self._informed = self._informed or taken.scan.n_informative() > 0
            self._last = taken.scan
        return taken.on_mount()

    def _told_of_mount(self, found: MountFound) -> None:
        self.mounts[found.frame] = found
        if found.shown:
            self.tell(str(found))

    def _once(self, text: str) -> None:
        if text not in self._said and len(self._said) < MAX_REMARKS:
            self._said.add(text)
            self.tell(text)


@contextlib.contextmanager
def open_scans(path: Path, choice: StreamChoice) -> Iterator[PlacedScans]:
    """Open a bag and yield its scans, to be iterated over while it is open.

    Raises BagError that says what is missing.
    """
    with BagReader(path) as bag:
        yield PlacedScans(bag, choose_topics(bag, choice), choice)

"""Scans and poses in, placed scans out: what every node that uses scans subscribes and drops."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from sensor_msgs.msg import LaserScan, Range

from ogm_mcmc.config import PlacingConfig
from ogm_mcmc.config.nodes import IntakeConfig
from ogm_mcmc.engine.mounts import MountFound, Mounts
from ogm_mcmc.engine.placing import DROP_REASONS, PoseSource, ScanPlacer
from ogm_mcmc.engine.pose_history import PoseHistory
from ogm_mcmc.engine.pose_watch import Corrections, RarePoses
from ogm_mcmc.engine.range_codes import RangeCodes
from ogm_mcmc.engine.scan_rhythm import NEVER_CAME, ScanRhythm
from ogm_mcmc.engine.still_clocks import StillClocks
from ogm_mcmc.engine.tf_poses import TfPoses
from ogm_mcmc.engine.transform_tree import TransformTree
from ogm_mcmc.errors import GridError, PoseError, ScanError
from ogm_mcmc.geometry import PlacedScan, Scan
from ogm_mcmc.geometry.rigid_transform import StampedTransform
from ogm_mcmc.io import messages
from ogm_mcmc.ros import qos
from ogm_mcmc.ros.intake_health import Health, IntakeHealth
from ogm_mcmc.ros.mount_topic import TOPIC as MOUNT_TOPIC
from ogm_mcmc.ros.mount_topic import MountListener
from ogm_mcmc.ros.pose_topics import AnyReliability, message_class, pose_reader
from ogm_mcmc.ros.problems import Problems
from ogm_mcmc.ros.tf_listener import TF_STATIC_TOPIC, TF_TOPIC, TfListener, tf_is_installed

__all__ = ['ScanIntake', 'limit_poses']

# Transforms are kept this long at least.
KEEP_TF_S = 30.0

# Scans are used for so long at once; the others wait for the next message or call.
WORK_S = 0.2

# How long a best-effort publisher may go unheard.
ADAPT_EVERY_S = 0.2

# Drops for want of a pose: the log says what is not there.
POSE_MISSING = ('pose_timeout', 'scan_before_poses', 'pose_unavailable', 'pose_gap')

UseScan = Callable[[PlacedScan], None]


class ScanIntake:
    """Subscribes, places, and hands every placed scan to `use`: the one door for live data.

    What cannot be used is counted under a reason and warned about, at most every five seconds
    for each; a GridError of `use` counts as well. Call `subscribe` when the node is ready, and
    `pass_on` now and then: scans that waited too long are dropped there. With `sonar` the scans
    are the readings on `range`; without `with_covariance` nobody looks at that of the poses.

    Raises ConfigError where messages that are asked for are not installed.
    """

    def __init__(
        self,
        node: Node,
        settings: IntakeConfig,
        placing: PlacingConfig,
        use: UseScan,
        *,
        sonar: bool = False,
        with_covariance: bool = True,
    ) -> None:
        self.node = node
        self.settings = settings
        self.placing = placing
        self.use = use
        self.sonar = sonar
        self.paused = False
        self.counts: Counter[str] = Counter()
        self._read_pose = pose_reader(settings.pose_source, with_covariance=with_covariance)
        self._rare_poses = RarePoses()
        self._rhythm = ScanRhythm()
        self._tf_clocks = StillClocks()
        self._pose_topic: AnyReliability | None = None
        self._pose_frame = ''

        frames = settings.map_frame, settings.base_frame
        self.transforms = TfPoses(TransformTree(KEEP_TF_S), *frames)
        self._corrections = Corrections(self.transforms.tree, *frames)
        self.tf = self._listener()
        self.mount_topic = self._mount_listener()
        self.mounts = Mounts(
            placing.mount,
            settings.base_frame,
            source=settings.mount_source,
            transforms=self.transforms if self.tf or self.mount_topic else None,
            patience_s=settings.transform_timeout,
            tell=self.on_mount,
        )
        from_tf = settings.pose_source == 'tf'
        source: PoseSource = self.transforms if from_tf else PoseHistory()
        self.placer = ScanPlacer(source, mounts=self.mounts, live=True, on_drop=self.on_drop)
        self.problems = Problems(node, lambda: self.placer.dropped + self._rhythm.missed)
        self.codes = RangeCodes(tell=node.get_logger().info)
        names = (TF_TOPIC, TF_STATIC_TOPIC) if from_tf else (settings.pose_source,)
        topics = [self._topic(name) for name in names]
        self.watch = IntakeHealth(node, [self._topic('range' if sonar else 'scan')], topics)
        self.configure(settings, placing)

    def _topic(self, name: str) -> str:
        return str(self.node.resolve_topic_name(name))

    def _listener(self) -> TfListener | None:
        """Return what listens to tf where it is asked for, or there and of use."""
        settings = self.settings
        asked = 'tf' in (settings.pose_source, settings.mount_source)
        if asked:
            message_class('tf')  # better said now than when all is ready
        if asked or (settings.mount_source == 'auto' and tf_is_installed()):
            return TfListener(
                self.node,
                self.transforms.tree,
                on_moving=self.on_moving,
                on_message=self.on_transforms,
                on_fault=self.on_fault,
            )
        return None

    def _mount_listener(self) -> MountListener | None:
        if self.settings.mount_source != 'topic':
            return None
        return MountListener(
            self.node,
            self.transforms.tree,
            on_message=self.on_mount_message,
            on_fault=self.on_fault,
        )

    def subscribe(self) -> None:
        """Begin to receive."""
        self.watch.begin()
        subscribe = self.node.create_subscription
        if self.sonar:
            subscribe(Range, 'range', self.on_range, qos.SENSOR)
        else:
            subscribe(LaserScan, 'scan', self.on_scan, qos.SENSOR)
        if self.tf is not None:
            self.tf.subscribe()
        if self.mount_topic is not None:
            self.mount_topic.subscribe()
        name = self.settings.pose_source
        if name != 'tf':
            self._pose_topic = AnyReliability(self.node, message_class(name), name, self.on_pose)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.node.create_timer(ADAPT_EVERY_S, self.adapt, clock=steady)

    def configure(self, settings: IntakeConfig, placing: PlacingConfig) -> None:
        """Take over what may change while the node runs."""
        # The frame of the map is fixed at start, or by the odometry.
        self.settings = replace(settings, map_frame=self.settings.map_frame)
        self.placing = placing
        self.placer.timeout_s = self.mounts.patience_s = settings.transform_timeout
        self.placer.max_waiting = settings.max_waiting_scans
        self.placer.deskew = placing.deskew
        self.codes.chosen_m = placing.no_return_code
        for source in (self.placer.source, self.transforms):
            limit_poses(source, placing)

    def clear(self, used: int = 0) -> None:
        """Forget the waiting scans and the poses, not the counts.

        used  how many scans the node forgets with them
        """
        self.counts['scans_forgotten'] += len(self.placer) + used
        self.placer.clear()

    # -- messages in ------------------------------------------------------------------------

    def on_scan(self, msg: LaserScan) -> None:
        """Queue a scan and pass on whatever can be placed."""
        self.take_scan(msg, self._read_scan)

    def _read_scan(self, msg: LaserScan) -> Scan:
        return self.codes.taken(messages.read_scan(msg, self.problems.remark))

    def on_range(self, msg: Range) -> None:
        """Queue the reading of a sonar; it is placed like a scan."""
        self.take_scan(msg, messages.read_range)

    def take_scan(self, msg: Any, read: Callable[[Any], Scan]) -> None:
        """Queue a scan, unless it is of another frame or invalid."""
        self.counts['scans_received'] += 1
        self.watch.scan_came()
        wanted, frame = self.settings.sensor_frame, messages.frame_of(msg)
        if missing := self._rhythm.add(frame, messages.stamp_of(msg)):
            what = f'{missing} scan{"s" * (missing > 1)} of {frame!r} never came'
            self.problems.warn(
                NEVER_CAME, f'{what}, by the stamps: lost on the way, or not sent', count=False
            )
        if self.paused:
            self.counts['scans_while_paused'] += 1
            return
        if wanted and frame != wanted:
            self.problems.warn('scan_wrong_frame', f'scan from {frame!r}: expected {wanted!r}')
            return
        try:
            scan = read(msg)
        except ScanError as error:
            self.problems.warn('scan_invalid', f'scan of {frame!r} dropped: {error}')
        else:
            self._queue(scan)
        self.pass_on()

    def _queue(self, scan: Scan) -> None:
        used = scan.n_informative()
        self.counts['beams_ignored'] += scan.ranges_m.size - used
        if used == 0:
            self.problems.warn(
                'scan_says_nothing',
                f'scan of {scan.frame_id!r} dropped: none of its {scan.ranges_m.size} ranges is '
                f'from range_min {scan.range_min_m:g} to range_max {scan.range_max_m:g} or inf',
            )
            return
        if 2 * len(self.placer) > self.placer.max_waiting:
            self.mounts.stop_waiting()
        self.placer.add_scan(scan, time.monotonic())

    def on_pose(self, msg: Any) -> None:
        """Add a pose to the history, unless it is of another frame or invalid."""
        self.counts['poses_received'] += 1
        self.watch.pose_came()
        frame = messages.frame_of(msg)
        if self.settings.pose_source == 'odom' and not self._pose_frame:
            self._follow_odometry(frame, messages.plain_frame(msg.child_frame_id))
        if frame != self.settings.map_frame:
            expected = self.settings.map_frame
            self.problems.warn(
                'pose_wrong_frame',
                f'pose in frame {frame!r}: expected {expected!r} (parameter map_frame)',
            )
            return
        stamp_ns = messages.stamp_of(msg)
        try:
            belief = self._read_pose(msg)
        except PoseError as error:
            self.problems.warn('pose_invalid', f'pose dropped: {error}')
            return
        self.placer.add_pose(stamp_ns, belief, time.monotonic())
        if rare := self._rare_poses.add(stamp_ns, belief.mean):
            self.node.get_logger().warning(rare)
        self.pass_on()

    def _follow_odometry(self, frame: str, child: str) -> None:
        """Draw the map in the frame of the odometry; sensors sit on what it is the odometry of."""
        self._pose_frame = frame
        if frame != self.settings.map_frame:
            self.node.get_logger().info(
                f'the map is drawn in the frame of the odometry, {frame!r}'
            )
            self.settings = replace(self.settings, map_frame=frame)
        if child and child != self.mounts.base_frame:
            self.node.get_logger().info(f'the odometry is that of {child!r}: sensors sit on it')
            self.mounts.base_frame = self.transforms.base_frame = child

    def on_moving(self, entry: StampedTransform) -> None:
        """Notice that the past was corrected."""
        correction = self._corrections.add(entry, self.settings.correction_warning)
        if self.settings.pose_source != 'tf':
            return
        if correction:
            self.problems.warn('map_corrected', correction)
        again = self._tf_clocks.add(entry.child, entry.stamp_ns, time.monotonic())
        if not again or not self._tf_clocks.stands(entry.child, entry.stamp_ns):
            return
        if entry.child in self.transforms.tree.ancestors(self.transforms.base_frame):
            self.problems.warn(
                'tf_unstamped',
                f'transform {entry.parent} -> {entry.child} holds at {entry.stamp_ns / 1e9:.3f} s '
                'only: its stamp has been the same for more than 1 s: a clock stands still',
            )

    def on_transforms(self) -> None:
        """Pass on the scans that waited for transforms."""
        if self.settings.pose_source == 'tf':
            self.counts['poses_received'] += 1
            self.watch.pose_came()
        self.on_mount_message()

    def on_mount_message(self) -> None:
        """Pass on the scans that waited for where their sensor sits."""
        if len(self.placer) > 0:
            self.pass_on()

    def on_fault(self, text: str) -> None:
        """Count a transform that is none."""
        self.problems.warn('tf_invalid', f'transform dropped: {text}')

    # -- placed scans out -------------------------------------------------------------------

    def pass_on(self) -> None:
        """Use every waiting scan whose pose is known; drop those that waited too long."""
        if self.paused:
            return
        began = time.monotonic()
        for taken in self.placer.placed(began):
            try:
                self.use(taken.on_mount())
            except GridError as error:
                self.problems.warn('scan_off_map', f'scan dropped: {error}')
            else:
                self.counts['beams_used'] += taken.scan.n_informative()
                self.watch.scan_used()
            if time.monotonic() - began > WORK_S:
                return  # whoever calls a service must not wait for all of them

    def adapt(self) -> None:
        """Hear publishers that are best effort as well."""
        for topic in (self._pose_topic, self.tf):
            if topic is not None:
                topic.adapt()

    # -- what went wrong --------------------------------------------------------------------

    def on_mount(self, found: MountFound) -> None:
        """Say where a sensor sits, the first time and when it was moved."""
        logger = self.node.get_logger()
        if found.guessed:
            logger.warning(str(found))
        elif found.shown:
            logger.info(str(found))

    def on_drop(self, reason: str, scan: Scan | None) -> None:
        """Warn about something the placer dropped (it counts itself)."""
        if scan is None:
            self.problems.warn(reason, f'pose dropped: {DROP_REASONS[reason]}', count=False)
            return
        stamp_s = scan.stamp_ns / 1e9
        what = f'scan of {scan.frame_id!r} at {stamp_s:.3f} s dropped: {DROP_REASONS[reason]}'
        self.problems.warn(reason, lambda: f'{what}{self._missing(reason, scan)}', count=False)

    def _missing(self, reason: str, scan: Scan) -> str:
        """Return what is not there for the pose of a scan, and who should send it."""
        if reason == 'pose_jump':
            return '; scans mapped before may lie wrong'
        if reason == 'scan_no_mount':
            told = 'from tf' if self.mount_topic is None else f'on {self._topic(MOUNT_TOPIC)}'
            base, frame = self.transforms.base_frame, scan.frame_id
            why = self.transforms.tree.why_not(base, frame, scan.stamp_ns)
            return f' ({base} -> {frame} is expected {told})' + (f'; {why}' if why else '')
        if reason == 'scan_bad_mount':
            return f': {self.mounts.faults.get(scan.frame_id, "")}'
        if reason not in POSE_MISSING:
            return ''
        why = self.placer.source.why_not(scan.stamp_ns)
        return f': {why}; {self.watch.who_sends_poses()}'

    def health(self) -> Health:
        """Return whether what is needed comes in, for /diagnostics."""
        return self.watch.judge(self.settings.stale_after, paused=self.paused)

    def values(self) -> dict[str, object]:
        """Return what came in, for /diagnostics."""
        return {
            'scans received': self.counts['scans_received'],
            'scans waiting': len(self.placer),
            'scans while paused': self.counts['scans_while_paused'],
            'scans forgotten when asked to': self.counts['scans_forgotten'],
            'beams used': self.counts['beams_used'],
            'beams ignored': self.counts['beams_ignored'],
            'poses received': self.counts['poses_received'],
            'scans at a last pose (standing still)': self.placer.n_held,
        }


def limit_poses(source: PoseSource, placing: PlacingConfig) -> None:
    """Have a source of poses keep to the limits of the parameters."""
    source.max_gap_ns = round(placing.max_pose_gap * 1e9)
    source.max_speed_m_s = placing.max_speed
    source.max_turn_rad_s = placing.max_turn_rate

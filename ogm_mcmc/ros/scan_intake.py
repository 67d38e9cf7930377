"""Scans and poses in, placed scans out: what every node that uses scans subscribes and drops."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable
from typing import Any

from geometry_msgs.msg import PoseArray, PoseWithCovarianceStamped
from rclpy.node import Node
from sensor_msgs.msg import LaserScan, Range

from ogm_mcmc.config import PlacingConfig
from ogm_mcmc.config.nodes import IntakeConfig
from ogm_mcmc.engine.placing import DROP_REASONS, PoseHistory, ScanPlacer, sensor_mount
from ogm_mcmc.errors import ConfigError, GridError, PoseError, ScanError
from ogm_mcmc.geometry import PlacedScan, Scan, SensorMount
from ogm_mcmc.io import messages
from ogm_mcmc.ros import qos
from ogm_mcmc.ros.tf_poses import TfTree

__all__ = ['ScanIntake']

WARN_EVERY_S = 5.0

# Counted beside the problems, but none themselves.
NO_PROBLEMS = ('scans_received', 'poses_received', 'scans_while_paused')

UseScan = Callable[[PlacedScan], None]


class ScanIntake:
    """Subscribes, places, and hands every placed scan to `use`: the one door for live data.

    What cannot be used is counted under a reason and warned about, at most every five seconds
    for each; a GridError of `use` counts as well. Call `subscribe` when the node is ready, and
    `pass_on` now and then: scans that waited too long are dropped there. With `sonar` the scans
    are the readings on `range`.
    """

    def __init__(
        self,
        node: Node,
        settings: IntakeConfig,
        placing: PlacingConfig,
        use: UseScan,
        *,
        sonar: bool = False,
    ) -> None:
        self.node = node
        self.settings = settings
        self.placing = placing
        self.use = use
        self.sonar = sonar
        self.paused = False
        self.counts: Counter[str] = Counter()
        self._warned_at: dict[str, float] = {}
        self._reported: Counter[str] = Counter()
        self._mounts: dict[str, SensorMount] = {}
        uses_tf = 'tf' in (settings.pose_source, settings.mount_source)
        self.tf = TfTree(node, settings.map_frame, settings.base_frame) if uses_tf else None
        self.placer = self._make_placer()

    def _make_placer(self) -> ScanPlacer:
        settings = self.settings
        if settings.pose_source == 'tf':
            assert self.tf is not None
            source: Any = self.tf
        else:
            source = PoseHistory(
                max_gap_s=self.placing.max_pose_gap,
                max_speed_m_s=self.placing.max_speed,
                max_turn_rad_s=self.placing.max_turn_rate,
            )
        return ScanPlacer(
            source,
            timeout_s=settings.transform_timeout,
            max_waiting=settings.max_waiting_scans,
            on_drop=self.on_drop,
        )

    def subscribe(self) -> None:
        """Begin to receive."""
        subscribe = self.node.create_subscription
        if self.sonar:
            subscribe(Range, 'range', self.on_range, qos.SENSOR)
        else:
            subscribe(LaserScan, 'scan', self.on_scan, qos.SENSOR)
        if self.settings.pose_source == 'pose':
            subscribe(PoseWithCovarianceStamped, 'pose', self.on_pose, qos.POSES)
        elif self.settings.pose_source == 'particles':
            subscribe(PoseArray, 'particles', self.on_particles, qos.POSES)
        elif self.settings.pose_source == 'particle_cloud':
            subscribe(particle_cloud_type(), 'particle_cloud', self.on_particles, qos.POSES)

    def configure(self, settings: IntakeConfig, placing: PlacingConfig) -> None:
        """Take over what may change while the node runs."""
        self.settings, self.placing = settings, placing
        self.placer.timeout_s = settings.transform_timeout
        if isinstance(self.placer.source, PoseHistory):
            self.placer.source.max_gap_ns = round(placing.max_pose_gap * 1e9)
            self.placer.source.max_speed_m_s = placing.max_speed
            self.placer.source.max_turn_rad_s = placing.max_turn_rate

    def clear(self) -> None:
        """Forget the waiting scans and the poses, not the counts."""
        self.placer.clear()

    # -- messages in ------------------------------------------------------------------------

    def on_scan(self, msg: LaserScan) -> None:
        """Queue a scan and pass on whatever can be placed."""
        self.take_scan(msg, messages.read_scan)

    def on_range(self, msg: Range) -> None:
        """Queue the reading of a sonar; it is placed like a scan."""
        self.take_scan(msg, messages.read_range)

    def take_scan(self, msg: Any, read: Any) -> None:
        """Queue a scan, unless it is of another frame or invalid."""
        self.counts['scans_received'] += 1
        wanted = self.settings.sensor_frame
        if self.paused:
            self.counts['scans_while_paused'] += 1
        elif wanted and messages.frame_of(msg) != wanted:
            self.warn(
                'scan_wrong_frame', f'scan from {msg.header.frame_id!r}: expected {wanted!r}'
            )
        else:
            try:
                self.placer.add_scan(read(msg), time.monotonic())
            except ScanError as error:
                self.warn('scan_invalid', f'scan dropped: {error}')
            self.pass_on()

    def on_pose(self, msg: PoseWithCovarianceStamped) -> None:
        """Take a pose and pass on the scans that waited for it."""
        self.take_pose(msg, messages.read_pose)

    def on_particles(self, msg: Any) -> None:
        """Take a PoseArray or a ParticleCloud and pass on the scans that waited for it."""
        self.take_pose(msg, messages.read_particles)

    def take_pose(self, msg: Any, read: Any) -> None:
        """Add a pose to the history, unless it is of another frame or invalid."""
        self.counts['poses_received'] += 1
        frame = messages.frame_of(msg)
        if frame != self.settings.map_frame:
            expected = self.settings.map_frame
            self.warn('pose_wrong_frame', f'pose in frame {frame!r}: expected {expected!r}')
            return
        try:
            self.placer.add_pose(messages.stamp_of(msg), read(msg), time.monotonic())
        except PoseError as error:
            self.warn('pose_invalid', f'pose dropped: {error}')
            return
        self.pass_on()

    # -- placed scans out -------------------------------------------------------------------

    def pass_on(self) -> None:
        """Use every waiting scan whose pose is known; drop those that waited too long."""
        if self.paused:
            return
        for taken in self.placer.placed(time.monotonic()):
            scan = taken.scan
            mount = self.mount_of(scan)
            if mount is None:
                self.warn('scan_no_mount', f'tf does not know {scan.frame_id!r} on the base yet')
                continue
            try:
                self.use(taken.on_mount(mount))
            except GridError as error:
                self.warn('scan_off_map', f'scan dropped: {error}')

    def mount_of(self, scan: Scan) -> SensorMount | None:
        """Return where the sensor of a scan sits, None while it is not known."""
        if self.settings.mount_source == 'parameters':
            return sensor_mount(self.placing.mount, scan.frame_id)
        if scan.frame_id not in self._mounts:
            assert self.tf is not None
            try:
                found = self.tf.mount_of(scan.frame_id)
            except PoseError as error:
                self.warn('scan_bad_mount', f'mount of {scan.frame_id!r}: {error}')
                return None
            if found is None:
                return None
            self._mounts[scan.frame_id] = found
        return self._mounts[scan.frame_id]

    # -- what went wrong --------------------------------------------------------------------

    def on_drop(self, reason: str, scan: Scan | None) -> None:
        """Warn about something the placer dropped (it counts itself)."""
        what = 'pose' if scan is None else f'scan at {scan.stamp_ns / 1e9:.3f} s'
        self.warn(reason, f'{what} dropped: {DROP_REASONS[reason]}', count=False)

    def warn(self, reason: str, text: str, *, count: bool = True) -> None:
        """Count a problem and, at most every five seconds for each reason, say so."""
        if count:
            self.counts[reason] += 1
        now = time.monotonic()
        if now - self._warned_at.get(reason, -WARN_EVERY_S) >= WARN_EVERY_S:
            self._warned_at[reason] = now
            self.node.get_logger().warning(f'{text} [{reason}: {self.problems()[reason]}]')

    def problems(self) -> Counter[str]:
        """Return how often each thing went wrong."""
        own = Counter({key: n for key, n in self.counts.items() if key not in NO_PROBLEMS})
        return own + self.placer.dropped

    def new_problems(self) -> Counter[str]:
        """Return what went wrong since this was last asked."""
        problems = self.problems()
        fresh = problems - self._reported
        self._reported = problems
        return fresh

    def values(self) -> dict[str, object]:
        """Return what came in, for /diagnostics."""
        return {
            'scans received': self.counts['scans_received'],
            'scans waiting': len(self.placer),
            'scans while paused': self.counts['scans_while_paused'],
            'poses received': self.counts['poses_received'],
        }

    def dropped(self) -> dict[str, object]:
        """Return what was dropped and why, for /diagnostics."""
        return {f'dropped: {key}': count for key, count in sorted(self.problems().items())}


def particle_cloud_type() -> Any:
    """Return nav2_msgs/ParticleCloud; raises ConfigError where it is not installed."""
    try:
        from nav2_msgs.msg import ParticleCloud
    except ImportError as error:
        raise ConfigError(
            f'pose_source particle_cloud needs nav2_msgs ({error}): expected it installed, or '
            'pose_source particles (PoseArray)'
        ) from error
    return ParticleCloud

"""The node `online_mapper`: LaserScan and an uncertain pose in, a live OccupancyGrid out."""

from __future__ import annotations

import sys
import time
from collections import Counter
from pathlib import Path
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import PoseArray, PoseWithCovarianceStamped
from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.parameter import Parameter
from sensor_msgs.msg import LaserScan, Range
from std_srvs.srv import SetBool, Trigger

from ogm_mcmc.config import LIVE_MAPPING, MapperConfig, OutputConfig, PlacingConfig
from ogm_mcmc.errors import ConfigError, GridError, OgmError, PoseError, ScanError
from ogm_mcmc.geometry import Scan, SensorMount
from ogm_mcmc.io import messages
from ogm_mcmc.io.map_files import save_map
from ogm_mcmc.pipeline import MappingPipeline, sensor_mount, warm_up
from ogm_mcmc.placement import DROP_REASONS, PoseHistory, ScanPlacer
from ogm_mcmc.ros import qos
from ogm_mcmc.ros.grid_publisher import GridPublisher
from ogm_mcmc.ros.parameters import ParameterSet
from ogm_mcmc.ros.running import run_node
from ogm_mcmc.ros.settings import LIVE_PARAMETERS, NODE_CONFIGS, OnlineMapperConfig
from ogm_mcmc.ros.tf_poses import TfTree

__all__ = ['OnlineMapper', 'main']

WARN_EVERY_S = 5.0
HOUSEKEEPING_S = 0.1
DIAGNOSTICS_S = 1.0
DISCOVERY_S = 2.0


class OnlineMapper(Node):
    """Subscribes, places, maps, publishes; everything of substance happens in `pipeline`."""

    def __init__(self, **node_options: Any) -> None:
        super().__init__('online_mapper', **node_options)
        self.parameters = ParameterSet(self, NODE_CONFIGS, LIVE_PARAMETERS)
        self.settings = self.parameters.read(OnlineMapperConfig)
        self.placing = self.parameters.read(PlacingConfig)
        self.pipeline = MappingPipeline(self.parameters.read(MapperConfig))
        self.output = self.parameters.read(OutputConfig)
        self.paused = False
        self.counts: Counter[str] = Counter()
        self.mapping_s = 0.0
        self._warned_at: dict[str, float] = {}
        self._reported: Counter[str] = Counter()
        self._last_stamp_ns = 0
        self._renewed_at = 0.0
        self._mounts: dict[str, SensorMount] = {}

        uses_tf = 'tf' in (self.settings.pose_source, self.settings.mount_source)
        self.tf = (
            TfTree(self, self.settings.map_frame, self.settings.base_frame) if uses_tf else None
        )
        self.placer = self._make_placer()

        started = time.monotonic()
        warm_up(self.pipeline.config)
        self.get_logger().info(f'kernels ready after {time.monotonic() - started:.2f} s')

        self.map_publisher = GridPublisher(self, 'map', self.pipeline, self.output, 'map')
        self.entropy_publisher = GridPublisher(
            self, '~/entropy', self.pipeline, self.output, 'entropy'
        )
        self.diagnostics = self.create_publisher(DiagnosticArray, '/diagnostics', 10)
        self.create_service(Trigger, '~/reset', self.on_reset)
        self.create_service(Trigger, '~/save_map', self.on_save_map)
        self.create_service(SetBool, '~/pause', self.on_pause)
        self._subscribe()
        # Real time, so that publishing goes on while a simulated clock stands still.
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.map_timer = self.create_timer(
            self.settings.map_update_interval, self.on_map_timer, clock=steady
        )
        self.create_timer(HOUSEKEEPING_S, self.on_housekeeping, clock=steady)
        self.create_timer(DIAGNOSTICS_S, self.publish_diagnostics, clock=steady)
        self.add_on_set_parameters_callback(self.check_parameters)
        self.add_post_set_parameters_callback(self.on_parameters_set)

    def _make_placer(self) -> ScanPlacer:
        settings = self.settings
        if settings.pose_source == 'tf':
            assert self.tf is not None
            source: Any = self.tf
        else:
            source = PoseHistory(max_gap_s=self.placing.max_pose_gap)
        return ScanPlacer(
            source,
            timeout_s=settings.transform_timeout,
            max_waiting=settings.max_waiting_scans,
            on_drop=self.on_drop,
        )

    def _subscribe(self) -> None:
        if self.pipeline.config.method == 'sonar':
            self.create_subscription(Range, 'range', self.on_range, qos.SENSOR)
        else:
            self.create_subscription(LaserScan, 'scan', self.on_scan, qos.SENSOR)
        if self.settings.pose_source == 'pose':
            self.create_subscription(PoseWithCovarianceStamped, 'pose', self.on_pose, qos.POSES)
        elif self.settings.pose_source == 'particles':
            self.create_subscription(PoseArray, 'particles', self.on_particles, qos.POSES)
        elif self.settings.pose_source == 'particle_cloud':
            cloud = particle_cloud_type()
            self.create_subscription(cloud, 'particle_cloud', self.on_particles, qos.POSES)

    # -- messages in ------------------------------------------------------------------------

    def on_scan(self, msg: LaserScan) -> None:
        """Queue a scan and map whatever can be placed."""
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
            self.map_placed_scans()

    def on_pose(self, msg: PoseWithCovarianceStamped) -> None:
        """Take a pose and map the scans that waited for it."""
        self.take_pose(msg, messages.read_pose)

    def on_particles(self, msg: Any) -> None:
        """Take a PoseArray or a ParticleCloud and map the scans that waited for it."""
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
        self.map_placed_scans()

    def on_housekeeping(self) -> None:
        """Drop scans that waited too long; do not let the first listener wait for its map."""
        self.map_placed_scans()
        publisher = self.map_publisher
        if publisher.sent == 0 and publisher.listeners > 0 and self.pipeline.scans_used > 0:
            self.publish_map()

    def map_placed_scans(self) -> None:
        """Map every waiting scan whose pose is known; drop those that waited too long."""
        if self.paused:
            return
        for scan, belief in self.placer.placed(time.monotonic()):
            mount = self.mount_of(scan)
            if mount is None:
                self.warn('scan_no_mount', f'tf does not know {scan.frame_id!r} on the base yet')
                continue
            started = time.perf_counter()
            try:
                changed = self.pipeline.update(scan, belief, mount)
            except GridError as error:
                self.warn('scan_off_map', f'scan dropped: {error}')
                continue
            self.mapping_s += time.perf_counter() - started
            self._last_stamp_ns = scan.stamp_ns
            self.map_publisher.mark(changed)
            self.entropy_publisher.mark(changed)
            if self.pipeline.scans_used == 1:
                # Give listeners that were here before us time to be discovered: DDS takes up to
                # three seconds to hand them a copy that was latched before.
                self._renewed_at = time.monotonic() + DISCOVERY_S - self.settings.latched_interval

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
            self.get_logger().warning(f'{text} [{reason}: {self.problems()[reason]}]')

    def problems(self) -> Counter[str]:
        """Return how often each thing went wrong."""
        known = ('scans_received', 'poses_received', 'scans_while_paused')
        own = Counter({key: value for key, value in self.counts.items() if key not in known})
        return own + self.placer.dropped

    # -- maps out ---------------------------------------------------------------------------

    def on_map_timer(self) -> None:
        """Publish what changed, where somebody listens or the latched copy is due."""
        if self.pipeline.scans_used == 0:
            return
        now = time.monotonic()
        due = now - self._renewed_at >= self.settings.latched_interval
        publisher = self.map_publisher
        listening = publisher.listeners > 0
        if (publisher.view.stale and (listening or due)) or (due and publisher.copy_is_old):
            self.publish_map(whole=due)
        if self.entropy_publisher.view.stale and self.entropy_publisher.listeners > 0:
            self.entropy_publisher.publish(self.settings.map_frame, self._last_stamp_ns)

    def publish_map(self, *, whole: bool = True) -> None:
        """Publish now: the whole map, or what changed where that is enough."""
        frame = self.settings.map_frame
        if self.map_publisher.publish(frame, self._last_stamp_ns, whole=whole):
            self._renewed_at = time.monotonic()

    def publish_diagnostics(self) -> None:
        """Say how it goes: what came, what was used, what was dropped and why."""
        spec = self.pipeline.method.spec
        used = self.pipeline.scans_used
        problems = self.problems()
        fresh = problems - self._reported
        self._reported = problems
        values = {
            'scans received': self.counts['scans_received'],
            'scans used': used,
            'scans waiting': len(self.placer),
            'scans while paused': self.counts['scans_while_paused'],
            'poses received': self.counts['poses_received'],
            'mapping time per scan (ms)': f'{1e3 * self.mapping_s / used if used else 0.0:.3f}',
            'map size (cells)': f'{spec.width} x {spec.height}',
            'maps published': self.map_publisher.sent,
            'paused': self.paused,
            **{f'dropped: {reason}': count for reason, count in sorted(problems.items())},
        }
        status = DiagnosticStatus(
            level=DiagnosticStatus.WARN if fresh else DiagnosticStatus.OK,
            name=f'{self.get_fully_qualified_name()}: mapping',
            message=f'{used} scans mapped, {sum(problems.values())} messages dropped',
            hardware_id='none',
            values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
        )
        report = DiagnosticArray(status=[status])
        report.header.stamp = self.get_clock().now().to_msg()
        self.diagnostics.publish(report)

    # -- services and parameters ------------------------------------------------------------

    def on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Forget the map, the waiting scans and the poses; publish the empty map."""
        used = self.pipeline.scans_used
        self.pipeline.reset()
        self.placer.clear()
        self.mapping_s = 0.0
        for publisher in (self.map_publisher, self.entropy_publisher):
            publisher.view.restart()
        self.publish_map()
        if self.entropy_publisher.listeners > 0:
            self.entropy_publisher.publish(self.settings.map_frame, self._last_stamp_ns)
        response.success, response.message = True, f'forgot a map of {used} scans'
        return response

    def on_save_map(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Save the map as PGM, YAML and PNG; scans wait in the queue meanwhile."""
        if self.pipeline.scans_used == 0:
            response.success, response.message = False, 'no scan was mapped yet: nothing to save'
            return response
        folder = Path(self.settings.save_directory).expanduser()
        try:
            paths = save_map(self.pipeline.map(), folder, self.output, self.settings.save_name)
        except OgmError as error:
            response.success, response.message = False, str(error)
        else:
            response.success, response.message = True, str(paths['yaml'].absolute())
        return response

    def on_pause(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        """Stop or go on using scans."""
        self.paused = bool(request.data)
        response.success = True
        response.message = 'paused: scans are ignored' if self.paused else 'mapping'
        return response

    def check_parameters(self, changes: list[Parameter]) -> SetParametersResult:
        """Judge a change; a method may have settings fixed that others take over."""
        fixed = LIVE_MAPPING - self.pipeline.live_settings
        for name in sorted({change.name for change in changes} & fixed):
            reason = f'{name} is fixed at start by method {self.pipeline.config.method}'
            return SetParametersResult(successful=False, reason=reason)
        return self.parameters.check(changes)

    def on_parameters_set(self, _: list[Parameter]) -> None:
        """Take over what `LIVE_PARAMETERS` allows to change."""
        before = self.output
        self.settings = self.parameters.read(OnlineMapperConfig)
        self.placing = self.parameters.read(PlacingConfig)
        self.output = self.parameters.read(OutputConfig)
        self.placer.timeout_s = self.settings.transform_timeout
        if isinstance(self.placer.source, PoseHistory):
            self.placer.source.max_gap_ns = round(self.placing.max_pose_gap * 1e9)
        self.map_timer.timer_period_ns = round(self.settings.map_update_interval * 1e9)
        self.map_timer.reset()  # or the old period would run out first
        if self.output != before:
            self.map_publisher.view.output = self.output
            self.map_publisher.mark(self.pipeline.changed)
        mapping = self.parameters.read(MapperConfig)
        if mapping != self.pipeline.config:
            self.pipeline.configure(mapping)
            # What is shown of the cells may be another thing now (`counting.show`).
            for publisher in (self.map_publisher, self.entropy_publisher):
                publisher.mark(self.pipeline.changed)


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


def main(args: list[str] | None = None) -> None:
    """Run the node until Ctrl-C or SIGTERM."""
    sys.exit(run_node(OnlineMapper, rclpy.spin, args))


if __name__ == '__main__':
    main()

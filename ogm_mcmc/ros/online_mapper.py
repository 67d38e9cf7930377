"""The node `online_mapper`: LaserScan and an uncertain pose in, a live OccupancyGrid out."""

from __future__ import annotations

import sys
import time
from dataclasses import replace
from typing import Any

from nav_msgs.srv import GetMap
from rcl_interfaces.msg import SetParametersResult
from rclpy.parameter import Parameter
from std_srvs.srv import SetBool, Trigger

from ogm_mcmc.config import OutputConfig, PlacingConfig
from ogm_mcmc.config.nodes import (
    LIVE_PARAMETERS,
    NODE_CONFIGS,
    IntakeConfig,
    NodeMapperConfig,
    OnlineMapperConfig,
)
from ogm_mcmc.engine.corrections import Nodes
from ogm_mcmc.engine.kept_scans import KeptScans
from ogm_mcmc.engine.live_map import warm_up_mapping
from ogm_mcmc.engine.no_returns import LiveNoReturn, NoReturnChoice
from ogm_mcmc.engine.saved_map import MapToSave, replacing_map, saved_text
from ogm_mcmc.errors import OgmError
from ogm_mcmc.files.user_paths import user_path
from ogm_mcmc.geometry import PlacedScan
from ogm_mcmc.pipeline import MappingPipeline
from ogm_mcmc.ros.diagnostics import DIAGNOSTICS_S, Diagnostics
from ogm_mcmc.ros.intake_health import WELL
from ogm_mcmc.ros.live_maps import LiveMaps
from ogm_mcmc.ros.managed_node import ManagedNode
from ogm_mcmc.ros.running import run_node
from ogm_mcmc.ros.scan_intake import ScanIntake
from ogm_mcmc.ros.slam_adapters import check_installed
from ogm_mcmc.ros.trajectory_intake import TrajectoryIntake

__all__ = ['OnlineMapper', 'main']

HOUSEKEEPING_S = 0.1


class OnlineMapper(ManagedNode):
    """Subscribes, places, maps, publishes; everything of substance happens in `pipeline`."""

    def __init__(self, **node_options: Any) -> None:
        super().__init__('online_mapper', NODE_CONFIGS, LIVE_PARAMETERS, **node_options)
        self.start()

    def set_up(self) -> None:
        """Make the map, empty, and everything around it."""
        self.settings = self.parameters.read(OnlineMapperConfig)
        self.no_return = self._fresh_no_return()
        self.pipeline = MappingPipeline(self._mapping())
        self.output = self.parameters.read(OutputConfig)
        self.mapping_s = 0.0
        self._last_stamp_ns = 0
        self.intake = ScanIntake(
            self,
            self.parameters.read(IntakeConfig),
            self.parameters.read(PlacingConfig),
            self.map_scan,
            sonar=self.pipeline.config.method == 'sonar',
            with_covariance=self.pipeline.uses_covariance,
        )
        self.maps = LiveMaps(
            self,
            self.pipeline,
            self.output,
            lambda: (self.intake.settings.map_frame, self._last_stamp_ns),
        )
        self.kept = KeptScans(self.settings.keep_scans_mb) if self.settings.keep_scans else None
        self.trajectory: TrajectoryIntake | None = None
        self._check_trajectory_source()
        self.diagnostics = Diagnostics(self, 'mapping')
        self.create_service(Trigger, '~/reset', self.on_reset)
        self.create_service(Trigger, '~/save_map', self.on_save_map)
        self.create_service(SetBool, '~/pause', self.on_pause)
        self.create_service(GetMap, '~/get_map', self.on_get_map)
        self.every(DIAGNOSTICS_S, self.publish_diagnostics)

    def _check_trajectory_source(self) -> None:
        """Say at once what `trajectory_source` lacks. Raises ConfigError without the messages."""
        source = self.intake.settings.trajectory_source
        check_installed(source)
        if self.kept is None and source != 'path':
            self.get_logger().warning(
                f'trajectory_source is {source!r}: expected keep_scans, without which the map '
                'stays as it is'
            )

    def _fresh_no_return(self) -> LiveNoReturn:
        asked = self.parameters.read(NodeMapperConfig)
        return LiveNoReturn(asked.no_return, asked.resolution, asked.max_range)

    def _mapping(self) -> NodeMapperConfig:
        """Return the settings of the map, with what no return is found to mean now."""
        asked = self.parameters.read(NodeMapperConfig)
        found = self.no_return.choice.value
        if asked.method == 'sonar':
            found = NoReturnChoice.of_cones(asked.no_return).value
        return replace(asked, no_return=found)

    def warm_up(self) -> None:
        """Compile what the method needs."""
        warm_up_mapping(self.pipeline.config, together=self.settings.keep_scans)

    def begin(self) -> None:
        """Subscribe, and publish from now on."""
        self.intake.subscribe()
        if self.kept is not None:
            self.trajectory = TrajectoryIntake(self, self.intake, self.correct)
        self.map_timer = self.every(self.settings.map_update_interval, self.on_map_timer)
        self.every(HOUSEKEEPING_S, self.on_housekeeping)

    def end(self) -> None:
        """Forget scans that wait; the map stays."""
        self.intake.clear()

    def tear_down(self) -> None:
        """Forget the map."""
        if self.kept is not None:
            self.kept.clear()  # ends the thread that makes the map anew
        del self.pipeline, self.maps, self.intake, self.kept, self.trajectory

    # -- scans in ---------------------------------------------------------------------------

    def map_scan(self, placed: PlacedScan) -> None:
        """Map a placed scan; raises GridError when the map would become too large."""
        started = time.perf_counter()
        changed = self.pipeline.update(placed)
        self.mapping_s += time.perf_counter() - started
        self._last_stamp_ns = placed.scan.stamp_ns
        self.maps.mark(changed)
        self._remark_on_cloud(placed)
        self._look_at_no_returns(placed)
        if self.kept is not None:
            # Only methods that look at clouds of particles need them again.
            if not self.pipeline.uses_covariance:
                placed = placed._replace(belief=placed.belief._replace(particles=None))
            self.kept.add(placed)

    def _look_at_no_returns(self, placed: PlacedScan) -> None:
        if self.intake.sonar:
            return
        said = self.no_return.see(placed)
        if said:
            log, warns = self.get_logger(), self.no_return.choice.asked == 'clear'
            log.warning(said) if warns else log.info(said)
        if self.no_return.choice.value != self.pipeline.config.no_return:
            self.pipeline.configure(self._mapping())

    def _remark_on_cloud(self, placed: PlacedScan) -> None:
        cloud, config = placed.belief.particles, self.pipeline.config
        limit = config.pose_uncertain.max_particles
        if cloud is not None and cloud.weights.size > limit and self.pipeline.uses_covariance:
            self.intake.problems.remark(
                f'clouds of more than {limit} particles: so many are drawn for each scan '
                '(pose_uncertain.max_particles)'
            )

    def correct(self, nodes: Nodes) -> None:
        """Begin to place the scans anew, and to make the map anew."""
        assert self.kept is not None
        self.kept.recording.read_anew(self.intake.codes.without_codes)
        self.kept.correct(nodes, self.pipeline.config)

    def take_remade(self) -> None:
        """Swap in a map that was made anew."""
        remade = None if self.kept is None else self.kept.taken(self.pipeline.config)
        if remade is None:
            return
        if self.trajectory is not None:
            self.trajectory.last = remade.corrected
        if remade.pipeline is not None:
            self.pipeline.take_over(remade.pipeline)
            self.maps.restart()
            assert self.kept is not None
            self.no_return.see_anew(self.kept.recording.snapshot())
            self.get_logger().info(
                f'map made anew from {remade.scans} scans at corrected poses in '
                f'{remade.seconds:.2f} s'
            )

    def on_housekeeping(self) -> None:
        """Drop scans that waited too long; do not let a new listener wait for its map."""
        self.intake.pass_on()
        self.take_remade()
        self.maps.serve_newcomers()
        if self.trajectory is not None:
            self.trajectory.adapt()

    # -- maps out ---------------------------------------------------------------------------

    def on_map_timer(self) -> None:
        """Publish what changed, where somebody listens or the latched copy is due."""
        self.maps.publish_changes(self.settings.latched_interval)

    def publish_diagnostics(self) -> None:
        """Say how it goes: what came, what was used, what was dropped and why."""
        spec = self.pipeline.method.spec
        used = self.pipeline.scans_used
        values = {
            **self.intake.values(),
            'scans used': used,
            'mapping time per scan (ms)': f'{1e3 * self.mapping_s / used if used else 0.0:.3f}',
            'map size (cells)': f'{spec.width} x {spec.height}',
            'maps published': self.maps.map.topic.sent,
            'no_return': '' if self.intake.sonar else self.no_return.text(),
            'paused': self.intake.paused,
            **self._kept_values(),
            'working': self.working,
            **self.intake.problems.values(),
        }
        dropped = self.intake.problems.all().total()
        self.diagnostics.publish(
            self.compiling or f'{used} scans mapped, {dropped} messages dropped',
            values,
            warn=bool(self.intake.problems.new()),
            health=self.intake.health() if self.working else WELL,
        )

    def _kept_values(self) -> dict[str, object]:
        if self.kept is None:
            return {'scans kept for corrections': 'none: keep_scans is off'}
        kept, recording = self.kept, self.kept.recording
        return {
            'scans kept for corrections': len(recording),
            'memory of kept scans (MB)': f'{kept.n_bytes / 1e6:.1f}',
            'scans let go': recording.let_go.total(),
            'map is being made anew': kept.busy,
            **(self.trajectory.values() if self.trajectory else {}),
        }

    # -- services and parameters ------------------------------------------------------------

    def on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Forget the map, the waiting scans and the poses; publish the empty map."""
        used = self.pipeline.scans_used
        self.pipeline.reset()
        self.no_return = self._fresh_no_return()
        self.pipeline.configure(self._mapping())
        self.intake.clear(used)
        if self.kept is not None:
            self.kept.clear()
        if self.trajectory is not None:
            self.trajectory.last = None
        self.mapping_s = 0.0
        self.maps.restart()
        response.success, response.message = True, f'forgot a map of {used} scans'
        return response

    def on_save_map(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Save the map and what its method saves beside it; scans wait in the queue meanwhile."""
        if self.pipeline.scans_used == 0:
            response.success, response.message = False, 'no scan was mapped yet: nothing to save'
            return response
        name = self.settings.save_name
        try:
            folder = user_path(self.settings.save_directory, 'save_directory')
            saved = MapToSave(self.pipeline)
            with replacing_map(saved, folder, name, self.output):
                pass
        except OgmError as error:
            response.success, response.message = False, str(error)
        else:
            response.success = True
            response.message = saved_text(saved.grid_map, folder / f'{name}.yaml')
        return response

    def on_get_map(self, _: GetMap.Request, response: GetMap.Response) -> GetMap.Response:
        """Return the map as `map` would show it now; one without cells while there is none."""
        if self.pipeline.scans_used == 0:
            response.map.header.frame_id = self.intake.settings.map_frame
            self.get_logger().warning('~/get_map: no scan was mapped yet, the map is empty')
        else:
            response.map = self.maps.map_message()
        return response

    def on_pause(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        """Stop or go on using scans."""
        self.intake.paused = bool(request.data)
        response.success = True
        response.message = 'paused: scans are ignored' if request.data else 'mapping'
        return response

    def check_parameters(self, changes: list[Parameter]) -> SetParametersResult:
        """Judge a change; what the method does not use is refused."""
        method = self.parameters.read(NodeMapperConfig).method
        unused = self.parameters.live_of(NodeMapperConfig) - MappingPipeline.live_settings(method)
        for name in sorted({change.name for change in changes} & unused):
            reason = f'{name} has no effect with method {method}'
            return SetParametersResult(successful=False, reason=reason)
        return super().check_parameters(changes)

    def parameters_changed(self) -> None:
        """Take over what `LIVE_PARAMETERS` allows to change."""
        self.settings = self.parameters.read(OnlineMapperConfig)
        self.intake.configure(
            self.parameters.read(IntakeConfig), self.parameters.read(PlacingConfig)
        )
        self.output = self.parameters.read(OutputConfig)
        if self.working:
            self.map_timer.timer_period_ns = round(self.settings.map_update_interval * 1e9)
            self.map_timer.reset()  # or the old period would run out first
        self.maps.show(self.output)
        asked = self.parameters.read(NodeMapperConfig)
        self.no_return.ask(asked.no_return, asked.max_range)
        mapping = self._mapping()
        if mapping != self.pipeline.config:
            self.pipeline.configure(mapping)
            # What is shown of the cells may be another thing now (`counting.show`).
            self.maps.mark(self.pipeline.changed)


def main(args: list[str] | None = None) -> None:
    """Run the node until Ctrl-C or SIGTERM."""
    sys.exit(run_node(OnlineMapper, args))


if __name__ == '__main__':
    main()

"""The node `refine_server`: records placed scans and samples their full posterior on demand."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from nav_msgs.srv import GetMap
from std_srvs.srv import Trigger

from ogm_mcmc.config import (
    CollisionConfig,
    OutputConfig,
    PlacingConfig,
    RecordingConfig,
    RefinePosesConfig,
    ShownConfig,
    StopConfig,
)
from ogm_mcmc.config.nodes import (
    REFINE_CONFIGS,
    REFINE_LIVE_PARAMETERS,
    IntakeConfig,
    RefineSamplerConfig,
    RefineServerConfig,
    refine_settings_agree,
)
from ogm_mcmc.engine.corrections import Corrected, Nodes
from ogm_mcmc.engine.pose_choice import is_called_odom
from ogm_mcmc.engine.recording import Recording
from ogm_mcmc.engine.refined_map import RefinedMap
from ogm_mcmc.engine.sampling_orders import SamplingOrders
from ogm_mcmc.engine.saved_map import save_refined, saved_text
from ogm_mcmc.engine.warm_up import warm_up_collisions, warm_up_poses, warm_up_sampling
from ogm_mcmc.engine.worker import RefineWorker
from ogm_mcmc.errors import OgmError
from ogm_mcmc.files.output_files import writable_folder
from ogm_mcmc.files.user_paths import user_path
from ogm_mcmc.geometry import GridMap, PlacedScan
from ogm_mcmc.ros.collision_answers import CollisionAnswers
from ogm_mcmc.ros.diagnostics import DIAGNOSTICS_S, Diagnostics
from ogm_mcmc.ros.intake_health import WELL
from ogm_mcmc.ros.managed_node import ManagedNode
from ogm_mcmc.ros.odometry_intake import OdometryIntake
from ogm_mcmc.ros.refine_report import (
    disagreement,
    nothing_recorded,
    nothing_refined,
    order_text,
    progress_text,
    size_refusal,
    status_values,
)
from ogm_mcmc.ros.refined_maps import RefinedMaps
from ogm_mcmc.ros.running import run_node
from ogm_mcmc.ros.scan_intake import ScanIntake
from ogm_mcmc.ros.slam_adapters import check_installed
from ogm_mcmc.ros.trajectory_intake import TrajectoryIntake
from ogm_mcmc.ros.trajectory_publisher import TrajectoryPublisher, correction_values

__all__ = ['RefineServer', 'main']

HOUSEKEEPING_S = 0.1
FLUSH_S = 1.0


class RefineServer(ManagedNode):
    """Subscribes and records; a `RefineWorker` samples; what it hands over is published here."""

    def __init__(self, **node_options: Any) -> None:
        super().__init__(
            'refine_server',
            REFINE_CONFIGS,
            REFINE_LIVE_PARAMETERS,
            refine_settings_agree,
            **node_options,
        )
        self.start()

    def set_up(self) -> None:
        """Make the worker, an empty recording and everything around them."""
        self.sampler = self.parameters.read(RefineSamplerConfig)
        self.poses = self.parameters.read(RefinePosesConfig)
        self._read_live()
        self.recording = Recording(self.parameters.read(RecordingConfig), self.sampler)
        self.intake = ScanIntake(
            self,
            self.parameters.read(IntakeConfig),
            self.parameters.read(PlacingConfig),
            self.record,
        )
        check_installed(self.intake.settings.trajectory_source)
        self.corrected: TrajectoryIntake | None = None
        self.collisions: CollisionAnswers | None = None
        self.odometry = OdometryIntake(self, self.intake, self.poses)
        self.worker = RefineWorker(
            self.sampler,
            self.poses,
            odometry=self.odometry.at,
            map_every_s=self.settings.map_update_interval,
            state_file=self._state_file(),
            niceness=self.settings.niceness,
            samples=self.settings.collision_samples,
            log=self.get_logger().info,
            warn=self.get_logger().warning,
        )
        self.orders = SamplingOrders(
            self.worker, self.recording, self.scans_now, self.stop, self.of_odometry
        )
        self.maps = RefinedMaps(self, self.map_frame, self.output, self.shown)
        self.trajectory = TrajectoryPublisher(self)
        self.diagnostics = Diagnostics(self, 'refining')
        self._reported_error = self._reported_lack = ''
        self.create_service(Trigger, '~/refine', self.on_refine)
        self.create_service(Trigger, '~/stop', self.on_stop)
        self.create_service(Trigger, '~/clear', self.on_clear)
        self.create_service(Trigger, '~/save_map', self.on_save_map)
        self.create_service(GetMap, '~/get_map', self.on_get_map)
        self.every(DIAGNOSTICS_S, self.publish_diagnostics)

    def warm_up(self) -> None:
        """Compile what sampling and answers need."""
        warm_up_sampling(self.sampler)
        warm_up_collisions()
        if self.poses.joint:
            warm_up_poses()

    def begin(self) -> None:
        """Subscribe and record, and publish from now on."""
        self.intake.subscribe()
        self.odometry.subscribe()
        self.corrected = TrajectoryIntake(self, self.intake, self.correct)
        self.collisions = CollisionAnswers(
            self,
            self.intake.problems,
            self.map_frame,
            lambda: self.worker.result,
            lambda: self.robot_radius,
        )
        self.every(HOUSEKEEPING_S, self.on_housekeeping)

    def end(self) -> None:
        """End sampling; the recording and the last map stay."""
        self.orders.stop()
        self.intake.clear()

    def tear_down(self) -> None:
        """Forget recording, chains and map."""
        self.worker.close()
        del self.worker, self.recording, self.maps, self.intake, self.odometry
        del self.orders, self.corrected, self.collisions

    def map_frame(self) -> str:
        """Return the frame of maps and poses; of odometry it is known when that comes."""
        return self.intake.settings.map_frame

    def _read_live(self) -> None:
        self.settings = self.parameters.read(RefineServerConfig)
        self.stop = self.parameters.read(StopConfig)
        self.output = self.parameters.read(OutputConfig)
        self.robot_radius = self.parameters.read(CollisionConfig).robot_radius
        self.unknown_margin = self.parameters.read(ShownConfig).unknown_margin

    def _state_file(self) -> Path | None:
        if not self.settings.state_file:
            return None
        path = user_path(self.settings.state_file, 'state_file').absolute()
        writable_folder(path.parent)  # better said now than when the work is done
        return path

    # -- scans in ---------------------------------------------------------------------------

    def record(self, placed: PlacedScan) -> None:
        """Record a placed scan; raises GridError when no window can hold it."""
        self.recording.add(placed)
        self.orders.corrector.note(placed)
        self.odometry.want(placed)

    def correct(self, nodes: Nodes) -> Corrected:
        """Place the recorded scans anew; sampling in progress goes on with them, warm."""
        return self.orders.correct(nodes, self.sampler.window.resolution)

    def scans_now(self) -> list[PlacedScan]:
        """Return the recorded scans, without codes that were found since they came."""
        self.recording.read_anew(self.intake.codes.without_codes)
        return self.recording.snapshot()

    def of_odometry(self) -> bool:
        """Return whether poses are those of odometry."""
        return is_called_odom(self.intake.settings.map_frame)

    # -- maps out ---------------------------------------------------------------------------

    def on_housekeeping(self) -> None:
        """Drop scans that waited too long; publish what the worker handed over."""
        self.intake.pass_on()
        self.odometry.adapt()
        if self.corrected is not None:
            self.corrected.adapt()
        self.orders.sample_corrected()
        if self.worker.failure is not None:
            raise self.worker.failure
        self.publish_maps()

    def publish_maps(self) -> None:
        """Send what the worker has handed over."""
        result = self.worker.result
        if result is not None:
            self.maps.publish(result, self.settings.latched_interval)
            self.trajectory.publish(result.trajectory, self.intake.settings.map_frame)

    def shown(self, result: RefinedMap) -> GridMap:
        """Return a map with nan where it is no more certain than the prior."""
        return result.shown(self.unknown_margin)

    def publish_diagnostics(self) -> None:
        """Say how it goes: what was recorded, how far sampling is, why it stopped."""
        status, recording, result = self.worker.status, self.recording, self.worker.result
        recording.understand(*status.understood)
        values = {
            **self.intake.values(),
            **recording.values(),
            **(self.corrected.values() if self.corrected else {}),
            'working': self.working,
            **status_values(status, self.sampler.window.no_return),
            'state not saved because': self.worker.unsaved,
            'poses': self.poses.poses,
            **self.odometry.values(),
            **correction_values(None if result is None else result.trajectory),
            'maps published': self.maps.map.topic.sent,
            'collision queries answered': self.collisions.answered if self.collisions else 0,
            **self.intake.problems.values(),
        }
        new_error = status.error != self._reported_error
        self._reported_error = status.error
        message = self.compiling or f'{len(recording)} scans recorded, {status.state}'
        limits = self.orders.limits
        lacking = disagreement(status, limits)
        details = lacking or progress_text(status, limits) or status.stopped
        if details:
            message += f' ({details})'
        if lacking and lacking != self._reported_lack:
            self.get_logger().warning(f'refinement {lacking}')
        self._reported_lack = lacking
        warn = bool(self.intake.problems.new()) or (new_error and bool(status.error))
        if self.worker.unsaved:
            message += f'; state not saved: {self.worker.unsaved}'
        warn = warn or bool(lacking) or bool(self.worker.unsaved)
        health = self.intake.health() if self.working else WELL
        self.diagnostics.publish(message, values, warn=warn, health=health)

    # -- services and parameters ------------------------------------------------------------

    def on_refine(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Sample what is recorded now; the answer does not wait for anything."""
        self.recording.understand(*self.worker.status.understood)
        refusal = self._refusal()
        response.success, response.message = not refusal, refusal or self._sample()
        return response

    def _refusal(self) -> str:
        """Return why nothing can be sampled now; empty if it can."""
        if not self.active:
            return 'not active: activate the node first'
        if not self.working:
            return f'{self.compiling or "starting"}: scans are taken after that'
        scans = len(self.recording)
        if scans == 0:
            return nothing_recorded(len(self.intake.placer), self.intake.problems.all().total())
        size = self.recording.size
        return size_refusal(scans, size.rays, size.n_bytes, self.sampler.window)

    def _sample(self) -> str:
        """Order the recorded scans to be sampled; return what is said of it."""
        status = self.worker.status
        last = disagreement(status, self.orders.limits)
        replaced = self.orders.sample(self.stop)
        text = order_text(
            len(self.recording),
            self.recording.size.rays,
            self.stop,
            status.chain_sweeps,
            bool(self.settings.state_file),
        )
        text += ', instead of those before' if replaced else ''
        return text + (f'; the last one {last}' if last else '')

    def on_stop(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """End sampling; the last map is published as soon as the sweep is over."""
        stopped = self.orders.stop()
        response.success = True
        response.message = 'stopping' if stopped else 'was not sampling'
        return response

    def on_clear(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Forget the recorded scans, the poses and the refined map; publish an empty one."""
        forgotten = len(self.recording)
        self.intake.clear(forgotten + self.recording.let_go.total())
        self.orders.clear()
        self.recording.clear()
        self.odometry.clear()
        self.maps.clear(self.sampler.window.resolution)
        self.trajectory.clear(self.intake.settings.map_frame)
        response.success, response.message = True, f'forgot {forgotten} scans'
        return response

    def on_save_map(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Save the newest refined map as PGM, YAML and PNG; the state file follows.

        With joint poses these are saved beside it, as NAME_trajectory.txt with deviations.
        """
        result = self.worker.result
        if result is None:
            response.success = False
            response.message = f'nothing to save: {nothing_refined(self.worker.status)}'
            return response
        grid_map = self.shown(result).cropped()
        try:
            folder = user_path(self.settings.save_directory, 'save_directory')
            path = save_refined(
                grid_map, result.trajectory, folder, self.settings.save_name, self.output
            )
        except OgmError as error:
            response.success, response.message = False, str(error)
        else:
            response.success, response.message = True, saved_text(grid_map, path)
            self.worker.save_state()
        return response

    def on_get_map(self, _: GetMap.Request, response: GetMap.Response) -> GetMap.Response:
        """Return the newest refined map; one without cells while there is none."""
        result = self.worker.result
        if result is None:
            response.map.header.frame_id = self.intake.settings.map_frame
            why = nothing_refined(self.worker.status)
            self.get_logger().warning(f'~/get_map: the map is empty: {why}')
        else:
            response.map = self.maps.map_message(result)
        return response

    def parameters_changed(self) -> None:
        """Take over what `REFINE_LIVE_PARAMETERS` allows to change."""
        self._read_live()
        self.intake.configure(
            self.parameters.read(IntakeConfig), self.parameters.read(PlacingConfig)
        )
        self.odometry.configure()
        self.recording.configure(self.parameters.read(RecordingConfig))
        self.worker.show_every(self.settings.map_update_interval)
        self.maps.show(self.output)

    # -- the end ----------------------------------------------------------------------------

    def finish(self) -> None:
        """End sampling and publish its last map, while ROS is still there."""
        if not self.configured:
            return
        self.worker.close()
        if self.working and self.context.ok() and self.worker.failure is None:
            self.publish_maps()
            self.maps.flush(FLUSH_S)

    def destroy_node(self) -> None:
        """Leave no thread behind."""
        worker = getattr(self, 'worker', None)
        if worker is not None:
            worker.close()
        super().destroy_node()


def main(args: list[str] | None = None) -> None:
    """Run the node until Ctrl-C or SIGTERM."""
    sys.exit(run_node(RefineServer, args))


if __name__ == '__main__':
    main()

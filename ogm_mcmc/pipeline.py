"""Scan + pose -> rays -> grid -> message: the one page to read first.

    LaserScan --read_scan--> Scan ---------+
                                           +--> ScanPlacer --> (Scan, PoseBelief)
    Pose... --read_pose--> PoseBelief -----+                        |
                                                     + SensorMount  v
       OccupancyGrid <--MapView-- probabilities <-- MappingMethod.update(scan, belief)
                                                    [cast_rays, fuse]

The node `online_mapper`, the commands `map` and `bench`, and the tests all run this page.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np

from ogm_mcmc.arrays import Float32Array, Int8Array
from ogm_mcmc.config import MapperConfig, MountConfig, OutputConfig, flatten
from ogm_mcmc.errors import require
from ogm_mcmc.geometry import (
    CellBox,
    GridMap,
    GridSpec,
    Pose2D,
    PoseBelief,
    Scan,
    SensorMount,
)
from ogm_mcmc.geometry.grid_map import entropy_bits, occupancy_values, trinary_values
from ogm_mcmc.mapping import Reconfigurable, make_method
from ogm_mcmc.placement import Placement

__all__ = ['MapView', 'MappingPipeline', 'mounted', 'sensor_mount', 'warm_up']

NOTHING = CellBox(0, 0, 0, 0)

# Changes far apart are brought up to date one by one: the box around both may be the whole map.
MAX_STALE_BOXES = 16


class MappingPipeline:
    """Placed scans in, a map out."""

    def __init__(self, config: MapperConfig) -> None:
        self.config = config
        self.method = make_method(config)
        self.scans_used = 0
        self.changed = NOTHING  # since the start or the last reset

    def update(self, scan: Scan, robot: PoseBelief, mount: SensorMount | None = None) -> CellBox:
        """Add a scan taken while the robot was believed at `robot`; return the changed cells.

        Raises GridError, with nothing changed, when the map would become too large.
        """
        changed = self.method.update(*mounted(scan, robot, mount or SensorMount()))
        self.changed = self.changed.union(changed)
        self.scans_used += 1
        return changed

    @property
    def live_settings(self) -> frozenset[str]:
        """The settings that may change while the map grows."""
        method = self.method
        return method.live_settings if isinstance(method, Reconfigurable) else frozenset()

    def configure(self, config: MapperConfig) -> None:
        """Take over settings; raises ConfigError for a change of one not in `live_settings`."""
        before, after = flatten(self.config), flatten(config)
        changed = {name for name in after if after[name] != before[name]}
        for name in sorted(changed - self.live_settings):
            require(False, name, after[name], f'method {self.config.method} has it fixed at start')
        if changed and isinstance(self.method, Reconfigurable):
            self.method.configure(config)
            self.config = config

    def reset(self) -> None:
        """Forget the map."""
        self.method.reset()
        self.scans_used = 0
        self.changed = NOTHING

    def map(self) -> GridMap:
        """Return the whole map, cropped to the measured cells."""
        spec = self.method.spec
        return GridMap(spec, self.method.probabilities(spec.box)).cropped()


class MapView:
    """Whole percents of a map, kept up to date by work proportional to the change.

    `values` (height, width) int8 as in nav_msgs/OccupancyGrid: 0..100, -1 unknown. A subclass
    may decide where they live (`_allocate`), so that a message needs no further copy.
    """

    def __init__(self, pipeline: MappingPipeline, output: OutputConfig, kind: str = 'map') -> None:
        self.pipeline = pipeline
        self.output = output
        self.kind = kind
        self.spec: GridSpec | None = None
        self.values: Int8Array = np.empty((0, 0), np.int8)
        self._stale: list[CellBox] = []
        self.mark(pipeline.changed)

    def mark(self, changed: CellBox) -> None:
        """Note that cells changed; every change since the view was made has to be marked."""
        if changed.empty:
            return
        for index, box in enumerate(self._stale):
            both = box.union(changed)
            if both.n_cells <= 2 * (box.n_cells + changed.n_cells):
                self._stale[index] = both
                return
        if len(self._stale) < MAX_STALE_BOXES:
            self._stale.append(changed)
        else:
            self._stale[-1] = self._stale[-1].union(changed)

    def restart(self) -> None:
        """Forget what was shown (after a reset)."""
        self.spec = None
        self._stale = []
        self.mark(self.pipeline.changed)

    @property
    def stale(self) -> bool:
        """Whether `refresh` has anything to do."""
        return bool(self._stale) or self.spec != self.pipeline.method.spec

    def refresh(self) -> list[CellBox]:
        """Bring `values` up to date; return the boxes that were written."""
        spec = self.pipeline.method.spec
        if spec != self.spec:
            before, values = self.spec, self._allocate(spec)
            values.fill(-1)
            # After a reset the window may have moved: nothing of the old one is true any more.
            if before is not None and spec.box.covers(before.box):
                values[spec.slices(before.box)] = self.values
            self.spec, self.values = spec, values
        written, self._stale = self._stale, []
        for box in written:
            self.values[spec.slices(box)] = self._shown(self.pipeline.method.probabilities(box))
        return written

    def _allocate(self, spec: GridSpec) -> Int8Array:
        return np.empty((spec.height, spec.width), np.int8)

    def _shown(self, probability: Float32Array) -> Int8Array:
        if self.kind == 'entropy':
            return occupancy_values(entropy_bits(probability).astype(np.float32))
        if self.output.output == 'trinary':
            return trinary_values(
                probability, self.output.occupied_thresh, self.output.free_thresh
            )
        return occupancy_values(probability)


def mounted(scan: Scan, robot: PoseBelief, mount: SensorMount) -> Placement:
    """Return the scan as an upright sensor would give it, and the belief about the sensor."""
    if mount == SensorMount():
        return Placement(scan, robot)
    return Placement(scan.flipped() if mount.upside_down else scan, robot.moved(mount.pose))


def sensor_mount(config: MountConfig, frame_id: str = '') -> SensorMount:
    """Return the mount that parameters describe, for the sensor of a frame."""
    named = _named_mounts(config)
    if frame_id in named:
        return SensorMount(Pose2D(*named[frame_id]))
    return SensorMount(Pose2D(config.x, config.y, config.yaw), config.upside_down)


@lru_cache(maxsize=8)
def _named_mounts(config: MountConfig) -> dict[str, tuple[float, float, float]]:
    return config.named()


def warm_up(config: MapperConfig) -> int:
    """Compile, or load from the cache, every kernel the configuration needs.

    Returns the number of cells that a first scan on a map of its own has measured.
    """
    # A few cells, whatever the configuration.
    sonar = replace(config.sonar, thickness=config.resolution)
    pipeline = MappingPipeline(replace(config, sonar=sonar))
    scan = Scan.checked(
        np.array([1.5, np.inf], np.float32) * config.resolution,
        angle_min_rad=0.1,
        angle_increment_rad=1.0,
        range_min_m=0.0,
        range_max_m=2.0 * config.resolution,
    )
    pose = Pose2D(3.5 * config.resolution, 3.5 * config.resolution)
    if config.method != 'two_assumption':
        # An uncertain pose may take other kernels than a known one.
        doubt = 1e-4 * config.resolution**2 * np.eye(3)
        MappingPipeline(pipeline.config).update(scan, PoseBelief(pose, doubt))
    pipeline.update(scan, PoseBelief(pose))
    return int(np.isfinite(pipeline.map().probability).sum())

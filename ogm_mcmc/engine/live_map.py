"""The traditional map of scans, and maps that chains start from."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import UInt8Array
from ogm_mcmc.config import MapperConfig, SamplerConfig, WindowConfig
from ogm_mcmc.errors import GridError
from ogm_mcmc.geometry import CellBox, GridMap, GridSpec, PlacedScan, Pose2D, PoseBelief, Scan
from ogm_mcmc.mapping import add_scans, make_method
from ogm_mcmc.mapping.counting import CountingMapper
from ogm_mcmc.pipeline import MappingPipeline
from ogm_mcmc.sampling import over_dispersed_starts

__all__ = [
    'Reflections',
    'cells_on',
    'check_lattice',
    'first_maps',
    'live_map',
    'map_of',
    'reflection_map',
    'warm_up_mapping',
]

# As if so many more beams had passed each cell: few that ended in it say little for certain, less
# still where readings may be those of other cells.
DOUBTED_SHARP, DOUBTED = 5.0, 20.0


def map_of(
    scans: Iterable[PlacedScan], config: MapperConfig, box: CellBox | None = None
) -> GridMap:
    """Map scans with the method that the settings name.

    Returns the whole map, or a `box` of its lattice, nan where nothing was measured. Raises
    GridError when the map would become too large.
    """
    method = make_method(config)
    add_scans(config.method, method, list(scans))
    found = GridMap(method.spec, method.probabilities(method.spec.box))
    return found if box is None else found.windowed(box)


def live_map(scans: Iterable[PlacedScan], window: WindowConfig) -> GridMap:
    """Return the two-assumption map of the beams a window takes, on its lattice."""
    return map_of(_of_beams(scans, window), _of_window(window, 'two_assumption'))


class Reflections(NamedTuple):
    """What cells reflected of the beams a window takes ([slides]); nan where no beam came.

    share  of the beams that reached a cell; beams: how many these were
    """

    share: GridMap
    beams: GridMap

    def least(self, blur: float, in_part: float = 1.0) -> GridMap:
        """Return the share, had more passed: up to `DOUBTED` for a blur of 1 (`blur_of`).

        As far as walls fill their cells `in_part`, see `filled_in_part`.
        """
        share, beams = self.share.probability, self.beams.probability
        doubted = np.float32(DOUBTED_SHARP + blur * (DOUBTED - DOUBTED_SHARP))
        return GridMap(self.share.spec, np.float32(in_part) * share * beams / (beams + doubted))


def reflection_map(
    scans: Iterable[PlacedScan], window: WindowConfig, box: CellBox | None = None
) -> Reflections:
    """Return what cells of a window's lattice, or of a `box` of it, reflected."""
    method = CountingMapper(_of_window(window, 'counting'))
    if box is not None:
        method.grid.cover(box)  # at once: one that grows takes room to spare
    add_scans('counting', method, _of_beams(scans, window))
    share = method.reflection(method.spec.box)
    hits, misses = method.counts(method.spec.box)
    beams = (hits.astype(np.float64) + misses).astype(np.float32)
    maps = (GridMap(method.spec, one) for one in (share, beams))
    return Reflections(*(one if box is None else one.windowed(box) for one in maps))


def _of_beams(scans: Iterable[PlacedScan], window: WindowConfig) -> list[PlacedScan]:
    """Return scans of the beams that are sampled."""
    return [scan.thinned(window.beam_stride) for scan in scans]


def _of_window(window: WindowConfig, method: str) -> MapperConfig:
    """Return the settings of a method on the lattice of a window."""
    return MapperConfig(
        method=method,
        resolution=window.resolution,
        max_range=window.max_range,
        no_return=window.no_return,
    )


def first_maps(
    live: GridMap, config: SamplerConfig, spec: GridSpec, n_chains: int
) -> list[UInt8Array]:
    """Return the maps (K,) on a window that chains start from, as the settings have it.

    live  the live map of the scans of that window
    """
    chain = config.chain
    return over_dispersed_starts(
        chain.start,
        n_chains,
        cells_on(spec, live, chain.start_threshold, chain.prior),
        chain.prior,
        chain.seed,
        cells_on(spec, live, 0.5, 1.0) == 0,
    )


def cells_on(spec: GridSpec, grid: GridMap, threshold: float, elsewhere: float) -> UInt8Array:
    """Return a map (K,) of a window: 1 where `grid` is at least at a threshold.

    Cells that `grid` does not know have the probability `elsewhere`.
    """
    check_lattice(spec, grid)
    cells = np.full((spec.height, spec.width), elsewhere >= threshold, np.uint8)
    common = spec.box.intersection(grid.spec.box)
    if not common.empty:
        known = np.nan_to_num(grid.probability[grid.spec.slices(common)], nan=elsewhere)
        cells[spec.slices(common)] = known >= threshold
    return cells.reshape(-1)


def check_lattice(spec: GridSpec, grid: GridMap) -> None:
    """Raise GridError unless the cells of `grid` are those of a window's lattice."""
    same = (
        grid.spec.resolution_m == spec.resolution_m
        and grid.spec.anchor_x_m == spec.anchor_x_m
        and grid.spec.anchor_y_m == spec.anchor_y_m
    )
    if not same:
        raise GridError(
            f'start map with cells of {grid.spec.resolution_m:g} m anchored at '
            f'({grid.spec.anchor_x_m:g}, {grid.spec.anchor_y_m:g}): expected '
            f'{spec.resolution_m:g} m at ({spec.anchor_x_m:g}, {spec.anchor_y_m:g})'
        )


def warm_up_mapping(config: MapperConfig, *, together: bool = False) -> int:
    """Compile, or load from the cache, every kernel the configuration needs.

    With `together` also those that take many scans at once (`MappingPipeline.update_all`).
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
        # An uncertain pose may take other kernels than a known one, and a second scan, which may
        # be looked at in the map so far, others than the first.
        doubt = 1e-4 * config.resolution**2 * np.eye(3)
        doubtful = MappingPipeline(pipeline.config)
        for _ in range(2):
            doubtful.update(PlacedScan(scan, PoseBelief(pose, doubt)))
    pipeline.update(PlacedScan.at(scan, pose))
    if together:
        MappingPipeline(pipeline.config).update_all([PlacedScan.at(scan, pose)])
    return int(np.isfinite(pipeline.map().probability).sum())

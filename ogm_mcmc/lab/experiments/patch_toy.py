"""Table I and Fig. 1 of [patch]: what a map sample costs on a map of 64 000 cells.

Nine combinations of patch size and prior, three robot positions. The map of [patch] is not
public: ours is a part of a generated building, 320 x 200 cells of 0.1 m.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ogm_mcmc.config import ForwardModelConfig, MapperConfig, PatchConfig, SamplerConfig
from ogm_mcmc.engine.live_map import map_of
from ogm_mcmc.errors import PriorError
from ogm_mcmc.evaluation import confusion_counts, near
from ogm_mcmc.geometry import CellBox, GridMap, GridSpec, PlacedScan, Pose2D
from ogm_mcmc.lab.experiments.map_samples import config_of, sample_map
from ogm_mcmc.lab.experiments.results import row, save_picture
from ogm_mcmc.plotting import Grid, Series, grids_png
from ogm_mcmc.simulation import GridWorld, Lidar, generate_floor

__all__ = ['run', 'toy_scans', 'toy_world']

BUILDING, LEFT, BOTTOM, WIDTH, HEIGHT = 3, 90, 150, 320, 200
REACH_CELLS, BEAMS, NOISE_CELLS, POSITIONS, CLEARANCE_CELLS = 75.0, 180, 3.0, 3, 8
CELL_PRIOR, THRESHOLD, NEAR_CELLS = 0.234, 0.20, 10

# Table I, seconds per map sample, by patch size and prior; with L = 25 uniform was intractable.
PUBLISHED: dict[tuple[int, str], float | str | None] = {
    (1, 'uniform'): 4.4, (1, 'patch'): 5.1, (1, 'border'): 6.6,
    (9, 'uniform'): 38.3, (9, 'patch'): 23.9, (9, 'border'): 2.7,
    (25, 'uniform'): 'intractable', (25, 'patch'): 124.9, (25, 'border'): None,
}  # fmt: skip

# Counted sweeps: cheap ones many, dear ones few; Fig. 1 takes 5000 samples of (9, border).
SWEEPS = {1: 200, 9: 20, 25: 20}
FIGURE_SWEEPS = 5000

# What is compiled is loaded by a sweep of this many cells around the first robot.
WARM_UP_CELLS = 20


def run(folder: Path, *, quick: bool, seed: int) -> dict[str, Any]:
    """Sample with every combination; quick: a tenth of the samples of Fig. 1."""
    world = toy_world(seed)
    scans = toy_scans(world, np.random.default_rng(seed))
    live = live_map(world, scans)
    share = 10 if quick else 1
    rows: list[dict[str, Any]] = []
    seconds: dict[str, float | None] = {}
    settings: dict[str, Any] = {}
    maps = {'truth': world.truth(), 'traditional': live}
    for (size, prior), published in PUBLISHED.items():
        sweeps, burn_in = SWEEPS[size], SWEEPS[size] // 2
        if (size, prior) == (9, 'border'):
            sweeps, burn_in = FIGURE_SWEEPS // share, 500 // share
        config = config_of(
            PatchConfig(prior=prior, size=size),
            world.spec.resolution_m,
            ForwardModelConfig(kind='gaussian', sigma=NOISE_CELLS * world.spec.resolution_m),
            prior=CELL_PRIOR,
            threshold=THRESHOLD,
            burn_in=burn_in,
            seed=seed,
        )
        what = f'L = {size}, {prior}'
        try:
            warm_up(config, scans, live)
            found = sample_map(config, scans, world.spec.box, live, sweeps=sweeps)
        except PriorError as error:
            ours = 'intractable' if prior == 'uniform' else 'refused'
            rows.append(row(f'{what}: s per map sample', ours, published, str(error)))
            seconds[what] = None
            continue
        remark = (
            f'burn-in {burn_in}, {sweeps} sweeps, {found.settings.get("patch.prior_file", "")}'
        )
        rows.append(row(f'{what}: s per map sample', found.seconds_per_sample, published, remark))
        seconds[what] = found.seconds_per_sample
        if (size, prior) in ((1, 'uniform'), (9, 'border')):
            maps[what] = found.mean
            settings = found.settings
    counted = near(np.isfinite(live.probability), NEAR_CELLS)
    for name, shown in maps.items():
        if name != 'truth':
            p = np.nan_to_num(shown.probability, nan=CELL_PRIOR)
            best = confusion_counts(
                p[counted], world.occupied[counted] == 1, np.linspace(0.0, 1.0, 101)
            ).best()
            remark = f'at {best.threshold:.2f}, cells within {NEAR_CELLS} of a measured one'
            rows.append(row(f'{name}: max F1', best.f1, None, remark))
    return {
        'rows': rows,
        'pictures': draw_maps(folder, maps, scans),
        'settings': {
            **settings,
            'cells': world.spec.width * world.spec.height,
            'positions': POSITIONS,
            'beams': BEAMS,
            'reach_cells': REACH_CELLS,
        },
        'seconds_per_sample': seconds,
        'notes': [
            'Published times: Matlab, a 2.7 GHz i7-6820HQ. Ours: one core, processor time, '
            'without the burn-in.',
            'L = 25 with border needs 7 x 7 windows, which [patch] does not count, either.',
        ],
    }


def draw_maps(
    folder: Path, maps: Mapping[str, GridMap], scans: list[PlacedScan]
) -> dict[str, str]:
    """Draw the maps of Fig. 1 and where the robot stood; return captions by file name."""
    x = np.array([one.pose.x_m for one in scans])
    y = np.array([one.pose.y_m for one in scans])
    captions = {}
    for name, (spec, probability) in maps.items():
        file = f'{name.replace(" = ", "").replace(", ", "_").lower()}.png'
        grid = Grid(probability, spec.extent_m, marks=(Series('robot', x, y, 'C0o'),))
        save_picture(folder / file, grids_png([grid], 'x, m', 'y, m'))
        captions[file] = f'{name} ([patch] Fig. 1)'
    return captions


def warm_up(config: SamplerConfig, scans: list[PlacedScan], live: GridMap) -> None:
    """Sample a few cells, so that times of the whole map hold no compiling and no loading."""
    pose = scans[0].pose
    column, line = live.spec.cell_of(pose.x_m, pose.y_m)
    half = WARM_UP_CELLS // 2
    box = CellBox(column - half, line - half, column + half, line + half)
    box = box.intersection(live.spec.box)
    part = GridMap(live.spec.windowed(box), live.probability[live.spec.slices(box)])
    sample_map(config, scans, box, part, sweeps=1)


def toy_world(seed: int) -> GridWorld:
    """Return 320 x 200 cells of a building."""
    whole = generate_floor(BUILDING, seed)
    part = whole.occupied[BOTTOM : BOTTOM + HEIGHT, LEFT : LEFT + WIDTH]
    return GridWorld.checked(GridSpec(whole.spec.resolution_m, WIDTH, HEIGHT), part)


def toy_scans(world: GridWorld, rng: np.random.Generator) -> list[PlacedScan]:
    """Scan all around from three free places, none within 8 cells of a wall."""
    size = world.spec.resolution_m
    lidar = Lidar(
        BEAMS,
        range_min_m=0.0,
        range_max_m=REACH_CELLS * size,
        noise_m=NOISE_CELLS * size,
        dropout=0.0,
    )
    scans: list[PlacedScan] = []
    while len(scans) < POSITIONS:
        column = int(rng.integers(CLEARANCE_CELLS, WIDTH - CLEARANCE_CELLS))
        line = int(rng.integers(CLEARANCE_CELLS, HEIGHT - CLEARANCE_CELLS))
        around = world.occupied[
            line - CLEARANCE_CELLS : line + CLEARANCE_CELLS + 1,
            column - CLEARANCE_CELLS : column + CLEARANCE_CELLS + 1,
        ]
        if around.any():
            continue
        pose = Pose2D(*world.spec.center_of(column, line), float(rng.uniform(-np.pi, np.pi)))
        exact = world.ranges(pose, lidar.bearings(), lidar.range_max_m)
        scans.append(PlacedScan.at(lidar.scan(lidar.observe(exact, rng), len(scans)), pose))
    return scans


def live_map(world: GridWorld, scans: list[PlacedScan]) -> GridMap:
    """Return the traditional map on the cells of the world."""
    spec = world.spec
    config = MapperConfig(fusion='per_beam', resolution=spec.resolution_m, prior=CELL_PRIOR)
    return map_of(scans, config, spec.box)

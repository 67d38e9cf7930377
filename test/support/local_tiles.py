"""Tiles in this process, one after the other: what a cluster does, without one."""

import math
from concurrent.futures import Future

import numpy as np

from ogm_mcmc.config import ForwardModelConfig, WindowConfig
from ogm_mcmc.engine.posterior import patch_prior
from ogm_mcmc.engine.tiled_refinement import Held, tile_sampler
from ogm_mcmc.geometry import PlacedScan, Pose2D
from ogm_mcmc.sampling.tile_gibbs import TileSampler
from ogm_mcmc.sampling.tile_index import arrivals, batch_of
from ogm_mcmc.sampling.tiled_model import TiledModel, TilePrior
from support.strategies import fan

__all__ = ['LocalHolders', 'LocalTiles', 'inside', 'room', 'some_map', 'tiled']

MODEL = ForwardModelConfig(sigma=0.6, clutter=0.1, missing=0.1)
WINDOW = WindowConfig(resolution=1.0, cut_sigma=6.0)
PRIOR = math.log(0.3 / 0.7)


class LocalTiles:
    """Holds all tiles and draws at once; `jobs` counts what each was asked to do."""

    def __init__(self, samplers):
        self.samplers = samplers
        self.jobs = [0] * len(samplers)

    def draw(self, tile, job):
        self.jobs[tile] += 1
        done = Future()
        done.set_result(self.samplers[tile].draw(job))
        return done


class LocalHolders:
    """Holds tiles in this process; `asked` are the settings and how many tiles, each time."""

    def __init__(self):
        self.asked = []

    def hold(self, config, scans, tiling):
        self.asked.append((config, len(tiling.tiles)))
        table = patch_prior(config).table
        n_tiles = len(tiling.tiles)
        samplers = [tile_sampler(config, table, scans, tiling, i) for i in range(n_tiles)]
        return Held(LocalTiles(samplers), [sampler.report() for sampler in samplers])


def tiled(scans, window, model, tiling, table=None, **prior):
    """Return the tiled posterior of some scans, and its tiles."""
    samplers = [
        TileSampler(scans, window, model, table, tiling, tile) for tile in range(len(tiling.tiles))
    ]
    tiles = LocalTiles(samplers)
    side = 0 if table is None else table.side

    batch = batch_of(scans, window, model)

    def arrive(telling, probability, least):
        return arrivals(batch, model, tiling.spec, telling, probability, least)

    reports = [sampler.report() for sampler in samplers]
    return TiledModel(tiling, reports, tiles, TilePrior(side=side, **prior), arrive), tiles


def room(n_scans=6, n_beams=24, seed=4):
    """Scans from places of a room of 11 x 9 cells, in all directions, some without return."""
    rng = np.random.default_rng(seed)
    placed = []
    for _ in range(n_scans):
        ranges = rng.uniform(0.5, 5.0, n_beams)
        ranges[rng.random(n_beams) < 0.1] = math.inf
        scan = fan(*ranges, bearing=-3.0, increment=6.24 / n_beams, range_max_m=6.0)
        pose = Pose2D(*rng.uniform(4.0, 7.0, 2), rng.uniform(-3.0, 3.0))
        placed.append(PlacedScan.at(scan, pose))
    return placed


def some_map(n, seed=0, share=0.15):
    return (np.random.default_rng(seed).random(n) < share).astype(np.uint8)


def inside(spec, cells, box):
    """Which cells of the window lie in a box, and their numbers there."""
    row, column = np.divmod(cells, spec.width)
    row, column = row + spec.row0 - box.row0, column + spec.column0 - box.column0
    width, height = box.column1 - box.column0, box.row1 - box.row0
    within = (row >= 0) & (row < height) & (column >= 0) & (column < width)
    return within, row * width + column

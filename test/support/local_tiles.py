"""Tiles in this process, one after the other: what a cluster does, without one."""

from concurrent.futures import Future

from ogm_mcmc.engine.tiled_refinement import Held, tile_sampler
from ogm_mcmc.sampling.tile_gibbs import TileSampler
from ogm_mcmc.sampling.tile_index import arrivals
from ogm_mcmc.sampling.tiled_model import TiledModel, TilePrior

__all__ = ['LocalHolders', 'LocalTiles', 'tiled']


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
        samplers = [tile_sampler(config, scans, tiling, i) for i in range(len(tiling.tiles))]
        return Held(LocalTiles(samplers), [sampler.report() for sampler in samplers])


def tiled(scans, window, model, tiling, table=None, **prior):
    """Return the tiled posterior of some scans, and its tiles."""
    samplers = [
        TileSampler(scans, window, model, table, tiling, tile) for tile in range(len(tiling.tiles))
    ]
    tiles = LocalTiles(samplers)
    side = 0 if table is None else table.side

    def arrive(telling, probability, least):
        return arrivals(scans, window, model, tiling.spec, telling, probability, least)

    reports = [sampler.report() for sampler in samplers]
    return TiledModel(tiling, reports, tiles, TilePrior(side=side, **prior), arrive), tiles

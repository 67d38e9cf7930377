"""Chains of a window of a few rays, of single cells and of patches."""

import numpy as np

from ogm_mcmc.config import ForwardModelConfig, WindowConfig
from ogm_mcmc.geometry import PlacedScan, Pose2D
from ogm_mcmc.sampling import CellModel, PosteriorSampler, RayWindow
from ogm_mcmc.sampling.cell_gibbs import GibbsState
from ogm_mcmc.sampling.gibbs_kernels import PARTS
from ogm_mcmc.sampling.patch_gibbs import PatchModel
from ogm_mcmc.sampling.patch_places import DULL_TURNS
from ogm_mcmc.sampling.patch_prior import make_table
from ogm_mcmc.sampling.ray_index_kernels import WIDTH
from support.strategies import fan

__all__ = ['LoneCells', 'assert_same', 'patch_model', 'sampler_of', 'small_model']


def small_model(order='fixed', *, reading=1.6, prior=0.3):
    window = RayWindow(
        WindowConfig(resolution=0.5, cut_sigma=0.0), ForwardModelConfig(sigma=0.6, clutter=0.2)
    )
    window.add(
        [
            PlacedScan.at(fan(reading, 1.9, increment=0.5, range_max_m=3.0), Pose2D(0.3, 0.4)),
            PlacedScan.at(
                fan(float('inf'), 1.0, increment=0.5, range_max_m=3.0), Pose2D(0.6, 1.3, -0.7)
            ),
        ]
    )
    return CellModel(window.index, float(np.log(prior / (1 - prior))), window.spec.width, order)


def sampler_of(model, seed=7, chains=2, burn_in=5, may_end=False):
    starts = [np.full(model.n_cells, j % 2, np.uint8) for j in range(chains)]
    return PosteriorSampler(model, starts, seed=seed, burn_in=burn_in, may_end=may_end)


def patch_model():
    cell_model = small_model()
    table = make_table('uniform', 9, p_occupied=0.3)
    width = int(cell_model.index.grid[WIDTH])
    return PatchModel(cell_model.index, width, table, margin=1, flip_cells=True)


class LoneCells:
    """Cells (C,) that nothing holds together, each a patch of its own; drawn as patches are.

    As many chains of one cell: those that `focus` puts off come in one of eight sweeps, the
    others are drawn with a probability that is told.
    """

    def __init__(self, probability):
        self.probability = probability
        self.n_cells = probability.size
        self.touched = np.arange(probability.size, dtype=np.int32)

    def start(self, cells):
        return GibbsState(cells.copy(), np.zeros(0))

    def focus(self, in_doubt, moving):
        return in_doubt | moving

    def arrival(self, probability, least):
        return np.ones_like(probability)

    begins_cold = False

    def advance(self, rng, state, *, settling=False, focus=None, chances=None, power=1.0):
        drawn = np.full(self.n_cells, True)
        if focus is not None:
            drawn = focus | (rng.integers(0, DULL_TURNS, self.n_cells) == 0)
            parts = np.floor(self.probability * PARTS + rng.random(self.n_cells))
            chances[focus] = parts[focus].astype(np.uint8)
        new = rng.random(self.n_cells) < self.probability
        state.cells[drawn] = new[drawn]
        return 0


def assert_same(one, other):
    assert one.sweeps == other.sweeps
    assert one.counted == other.counted
    for a, b in zip(one.states, other.states, strict=True):
        assert np.array_equal(a.cells, b.cells)
        assert np.array_equal(a.records[:, :2], b.records[:, :2])
    for a, b in zip(one.counts, other.counts, strict=True):
        assert (a.batch_length, a.full, a.in_last) == (b.batch_length, b.full, b.in_last)
        assert np.array_equal(a.counts, b.counts)
        assert a.counts.dtype == b.counts.dtype
    assert np.array_equal(one.estimate().mean, other.estimate().mean)

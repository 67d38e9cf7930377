"""All maps by Gray code against all maps one by one."""

import time

import numpy as np
import pytest
from hypothesis import given, settings
from support.cuts import cut_error
from support.naive_posterior import NaivePosterior
from support.strategies import REPEATABLE, fan
from support.tiny_problems import cell_numbers, tiny_problems

from ogm_mcmc.config import ForwardModelConfig, WindowConfig
from ogm_mcmc.errors import WindowError
from ogm_mcmc.geometry import PlacedScan, Pose2D
from ogm_mcmc.lab.exact import enumerate_maps, line_posterior
from ogm_mcmc.sampling import RayWindow

approx = pytest.approx


def corridor(n_cells, readings, **settings):
    """A window of one row of 1 m cells, looked along from the first of them."""
    model = ForwardModelConfig(**{'sigma': 2.0, 'clutter': 0.1, **settings})
    window = RayWindow(WindowConfig(resolution=1.0, cut_sigma=0.0), model)
    window.add([PlacedScan.at(fan(*readings, range_max_m=n_cells - 0.75), Pose2D(0.25, 0.5))])
    assert window.index.touched().size == n_cells
    return window.index


@given(problem=tiny_problems(max_cells=9))
@settings(REPEATABLE, max_examples=60)
def test_equals_every_map_by_itself(problem):
    naive, window = problem.naive(), problem.indexed()
    found = enumerate_maps(window.index, problem.prior_log_odds)
    assert found.touched.tolist() == cell_numbers(window.spec, naive.touched)
    expected = naive.enumerate_log_joint()
    assert found.log_joint == approx(expected, abs=1e-4, rel=1e-5)
    assert found.marginals == approx(naive.marginals(), abs=1e-5)
    assert found.log_evidence == approx(np.logaddexp.reduce(expected), abs=1e-4, rel=1e-5)
    assert found.probabilities().sum() == approx(1.0)


@pytest.mark.jit
@pytest.mark.parametrize('kind', ['beam', 'gaussian'])
def test_twenty_cells_in_seconds(kind):
    """Hours in [gibbs]; the closed form for a line says the same."""
    index = corridor(20, [11.3, 12.0, 14.2], kind=kind)
    enumerate_maps(corridor(8, [5.3], kind=kind), 0.0)  # compiled before the clock starts
    started = time.process_time()
    found = enumerate_maps(index, np.log(0.3 / 0.7))
    assert time.process_time() - started < 10.0
    assert found.log_joint.size == 2**20
    rays = np.array([index.ray(n)[1] for n in range(3)], np.float64)
    nothing = [index.ray(n)[2] for n in range(3)]
    line = line_posterior(np.column_stack((rays, nothing)), 0.3)
    assert found.marginals == approx(line, abs=1e-9)
    # Errors do not add up on the way through a million maps.
    everywhere = rays[:, 0].sum() + 20 * np.log(0.3)
    assert found.log_joint[-1] == approx(everywhere, abs=1e-8)


def test_too_many_cells_are_refused():
    index = corridor(25, [11.0])
    with pytest.raises(WindowError, match='25 cells to enumerate: expected at most 24'):
        enumerate_maps(index, 0.0)


@pytest.mark.parametrize('reading', [1.1, 1.9, 2.6, np.inf])
@pytest.mark.parametrize('short', [0.0, 0.05])
def test_cutting_rays_changes_the_posterior_by_less_than_its_bound(reading, short):
    """By enumeration: with and without cut, for all maps of the cells of the whole ray."""
    model = ForwardModelConfig(sigma=0.12, clutter=0.02, short=short)
    placed = [
        PlacedScan.at(fan(reading, 2.0, increment=0.3, range_max_m=4.5), Pose2D(0.25, 0.5)),
        PlacedScan.at(fan(1.4, range_max_m=4.5), Pose2D(0.75, 1.25, 0.4)),
    ]
    whole = NaivePosterior(model, WindowConfig(resolution=1.0, cut_sigma=0.0), 0.2, placed)
    exact = dict(zip(whole.touched, whole.marginals(), strict=True))
    for cut_sigma in (1.0, 2.0, 4.0, 6.0):
        window = RayWindow(WindowConfig(resolution=1.0, cut_sigma=cut_sigma), model)
        window.add(placed)
        bound = sum(
            cut_error(window.model, cut_sigma, ray.reading, ray.reach) for ray in whole.rays
        )
        cut = enumerate_maps(window.index, np.log(0.2 / 0.8))
        for k, p in zip(cut.touched.tolist(), cut.marginals, strict=True):
            row, column = divmod(k, window.spec.width)
            exactly = exact[column + window.spec.column0, row + window.spec.row0]
            # Every log joint moved by at most the bound, so every log-odds by twice that.
            moved = np.log(p / (1.0 - p)) - np.log(exactly / (1.0 - exactly))
            assert abs(moved) <= 2.0 * bound + 1e-5
        if cut_sigma == 6.0 and short == 0.0:
            assert bound < 1e-4


@pytest.mark.parametrize('reading', [1.3, 1.9, 2.4])
def test_cutting_rays_of_the_gaussian_changes_little_where_readings_agree(reading):
    """There it is another model, but only of maps that none of the readings come from."""
    model = ForwardModelConfig(kind='gaussian', sigma=0.25)
    placed = [PlacedScan.at(fan(reading, reading + 0.1, range_max_m=6.5), Pose2D(0.25, 0.5))]
    whole = NaivePosterior(model, WindowConfig(resolution=1.0, cut_sigma=0.0), 0.2, placed)
    assert len(whole.touched) == 7
    window = RayWindow(WindowConfig(resolution=1.0, cut_sigma=6.0), model)
    window.add(placed)
    cut = enumerate_maps(window.index, np.log(0.2 / 0.8))
    assert 3 <= cut.touched.size < 7
    assert cut.marginals == approx(whole.marginals()[: cut.touched.size], abs=1e-4)

"""The line of cells is the one of the papers: distances, likelihoods, the traditional map."""

import math

import numpy as np
import pytest

from ogm_mcmc.lab.exact import enumerate_maps, line_posterior
from ogm_mcmc.lab.experiments.gibbs_line import (
    cell_model,
    draw_chain,
    draw_readings,
    log_likelihoods,
    measured_line,
    traditional_map,
)
from ogm_mcmc.lab.experiments.patch_mutual_information import exact_information
from ogm_mcmc.sampling.estimates import mutual_information_bits, pair_information_bits


def normal(z, mean, sigma):
    return -0.5 * ((z - mean) / sigma) ** 2 - math.log(sigma * math.sqrt(2.0 * math.pi))


def test_likelihoods_by_hand():
    line = measured_line(np.array([2.0, 3.5]), reach=4, sigma=1.5)
    found = log_likelihoods(line)
    # The robot stands in the middle of cell 0 and sees its right half; cell k is k away; a ray
    # that hits nothing ends at 4.
    distances = [0.25, 1.0, 2.0, 3.0, 4.0, 4.0]
    expected = [[normal(z, d, 1.5) for d in distances] for z in (2.0, 3.5)]
    assert found == pytest.approx(np.array(expected), abs=1e-5)
    assert line.n_cells == 5
    # In cell 1 of the line the same, one cell on.
    moved = measured_line(np.array([2.0, 3.5]), reach=4, sigma=1.5, robot=1)
    assert log_likelihoods(moved) == pytest.approx(found, abs=1e-6)
    assert moved.window.spec.column0 == 1


def test_traditional_map_by_hand():
    line = measured_line(np.array([2.0, 2.2]), reach=4, sigma=1.0)
    step = 1.0 / (1.0 + math.exp(2 * 1.3863))
    expected = [step, step, 1.0 - step, 0.5, 0.5]
    assert traditional_map(line) == pytest.approx(np.array(expected), abs=1e-6)


def test_readings_stay_within_reach():
    rng = np.random.default_rng(3)
    drawn = np.array([draw_readings(rng, 4, 4.0, 1.0, 5) for _ in range(200)])
    assert drawn.min() > 0.0
    assert drawn.max() < 5.0
    assert 3.0 < drawn.mean() < 4.0  # what lies beyond was drawn again


def test_chain_has_the_exact_marginals():
    line = measured_line(np.array([3.0, 3.6]), reach=6, sigma=1.0)
    everything = enumerate_maps(line.window.index, cell_model(line, 0.3).prior_log_odds)
    assert line_posterior(log_likelihoods(line), 0.3) == pytest.approx(
        everything.marginals, abs=1e-6
    )
    maps = draw_chain(np.random.default_rng(5), cell_model(line, 0.3), 0.3, 20_000)
    # Neighbouring sweeps hardly know of each other here: four standard errors, and half as much.
    error = np.abs(maps.mean(axis=0) - everything.marginals)
    assert (error <= 6.0 * np.sqrt(everything.marginals / 20_000) + 1e-4).all()


def test_information_of_all_maps_in_plain_python():
    line = measured_line(np.array([1.0, 2.0]), reach=3, sigma=1.0)
    everything = enumerate_maps(line.window.index, 0.0)
    weight = everything.probabilities()

    def p(**wanted):
        """Return the probability that cells (c0=1, c2=0, ...) are as wanted."""
        return sum(
            weight[m] for m in range(16)
            if all(m >> int(name[1:]) & 1 == value for name, value in wanted.items())
        )  # fmt: skip

    found = exact_information(everything)
    for a in range(4):
        for b in range(4):
            if a == b:
                continue
            expected = 0.0
            for i in (0, 1):
                for j in (0, 1):
                    both = p(**{f'c{a}': i, f'c{b}': j})
                    expected += both * math.log2(both / (p(**{f'c{a}': i}) * p(**{f'c{b}': j})))
            assert found[a, b] == pytest.approx(expected, abs=1e-12)
    assert found[0, 1] > 0.01


def test_information_of_a_coin():
    """A copy tells everything, its inverse too, another coin nothing."""
    coin = np.array([0, 0, 1, 1])
    samples = np.stack((coin, coin, 1 - coin, [0, 1, 0, 1]), axis=1)
    found = mutual_information_bits(samples)
    assert found[0] == pytest.approx([1.0, 1.0, 1.0, 0.0])
    both = samples.T @ samples / 4.0
    assert pair_information_bits(samples.mean(axis=0), both) == pytest.approx(found)

"""[gibbs] Fig. 2 and 3 in small: the numbers are sane and say what the paper says."""

import numpy as np
import pytest

from ogm_mcmc.evaluation import total_divergence
from ogm_mcmc.lab.exact import line_posterior
from ogm_mcmc.lab.experiments import gibbs_1d, patch_mutual_information
from ogm_mcmc.lab.experiments.gibbs_line import log_likelihoods, measured_line


@pytest.fixture(scope='module')
def result(tmp_path_factory):
    folder = tmp_path_factory.mktemp('gibbs')
    result = gibbs_1d.run(folder, quick=True, seed=1)
    assert {path.name for path in folder.iterdir()} == set(result['pictures'])
    return result


def ours(result, start):
    return next(line['ours'] for line in result['rows'] if line['what'].startswith(start))


def test_full_solution_and_traditional_map(result):
    readings = np.array(result['settings']['readings'])
    assert readings.size == 8
    full = np.array(result['full'])
    assert full.size == 31
    line = measured_line(readings, reach=30, sigma=2.0)
    assert full == pytest.approx(line_posterior(log_likelihoods(line), 0.5), abs=5e-3)
    # In front everything is free; far behind the wall nothing is known.
    assert full[:16].max() < 0.01
    assert full[25:] == pytest.approx(0.5, abs=1e-3)
    assert 19 <= int(full.argmax()) <= 21
    # These readings do what the paper shows.
    for line_of_table in result['rows'][:4]:
        assert line_of_table['ours'] == line_of_table['published']
    assert ours(result, 'closed form') < 1e-5


def test_samples_approach_the_full_solution(result):
    found = result['divergence']
    samples, median = np.array(found['samples']), np.array(found['median'])
    assert (np.array(found['low']) <= median).all()
    assert (median <= np.array(found['high'])).all()
    # Like 1 / samples: two decades of samples, nearly two decades of divergence.
    late = samples >= 10
    slope = np.polyfit(np.log(samples[late]), np.log(median[late]), 1)[0]
    assert -1.3 < slope < -0.8
    assert median[-1] < 0.05 < ours(result, 'DKL(full || traditional)')
    assert ours(result, 'DKL(full || 1000 samples)') == pytest.approx(median[-1])
    # 1000 correlated draws of p = 0.5.
    error = np.abs(np.array(result['sampled']['1000']) - result['full'])
    assert error.max() < 0.1
    assert 1 <= ours(result, 'sweeps until') <= 20


def test_divergence_after_each_number_of_samples_by_hand():
    full = np.array([0.25, 0.5])
    chain = np.array([[0, 1], [1, 1], [0, 0], [0, 1]], np.uint8)
    found = gibbs_1d._divergences(full, chain, np.array([1, 2, 4]))
    # One sample: 0 and 1, kept at 1/4 and 3/4.
    means = ([0.25, 0.75], [0.5, 5 / 6], [0.25, 0.75])
    expected = [total_divergence(full, np.array(mean)).nats for mean in means]
    assert found == pytest.approx(expected)
    assert expected[0] == pytest.approx(0.5 * np.log(0.5 / 0.75) + 0.5 * np.log(0.5 / 0.25))


def test_information_between_cells(tmp_path):
    result = patch_mutual_information.run(tmp_path, quick=True, seed=1)
    assert {path.name for path in tmp_path.iterdir()} == set(result['pictures'])
    exact, sampled = np.array(result['exact']), np.array(result['sampled'])
    assert exact.shape == sampled.shape == (14, 14)
    assert exact == pytest.approx(exact.T, abs=1e-12)
    off = ~np.eye(14, dtype=bool)
    assert np.abs(sampled - exact)[off].max() < 0.03
    # Between neighbours at the wall the most; nothing in free space and far behind.
    assert ours(result, 'most between neighbours') == ours(result, 'most information') > 0.02
    assert ours(result, 'most between cells 4') < 0.1 * ours(result, 'most information')
    assert exact[0, 1] < 1e-3
    assert ours(result, 'sum over all pairs') == pytest.approx(exact[off].sum() / 2.0)

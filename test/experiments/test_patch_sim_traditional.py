"""One of the hundred data sets, mapped and scored; pooled counts."""

import numpy as np
import pytest

from ogm_mcmc.experiments.hundred_sets import set_names, simulated_set
from ogm_mcmc.experiments.patch_sim_traditional import pooled, score


def test_a_hundred_names():
    names = set_names()
    assert len(names) == 100
    assert names['map10_run03'] == (10, 3)
    assert list(set_names(maps=2, runs=1).values()) == [(1, 1), (2, 1)]


def test_sets_are_seeded_and_differ():
    arguments = {'seed': 7, 'noise_cells': 3.0, 'max_scans': 3}
    one, same = simulated_set(9, 1, **arguments), simulated_set(9, 1, **arguments)
    other = simulated_set(9, 2, **arguments)
    assert np.array_equal(one.scans[2].scan.ranges_m, same.scans[2].scan.ranges_m)
    assert np.array_equal(one.world.occupied, other.world.occupied)
    assert one.scans[0].pose != other.scans[0].pose
    assert one.scans[0].scan.ranges_m.size == 180


def test_score_of_one_set():
    result = score(10, 1, seed=7, noise_cells=1.0, prior=0.234)
    assert result['positives'] + result['negatives'] == 500 * 500
    counts = pooled({'a': result})
    # Called occupied from 0 on is everything; from above the prior on, only what was hit.
    everything = counts.scores(-1)
    assert everything.threshold == 0.0
    assert everything.recall == 1.0
    assert everything.precision == pytest.approx(result['positives'] / 250_000)
    assert counts.best().f1 > 0.75
    assert result['measured'] > 0.75
    twice = pooled({'a': result, 'b': result})
    assert twice.best() == pytest.approx(counts.best())
    assert twice.positives == 2 * counts.positives

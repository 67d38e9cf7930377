"""One of the hundred data sets, mapped and scored; pooled counts."""

import numpy as np
import pytest

from ogm_mcmc.experiments.hundred_sets import set_names, simulated_set
from ogm_mcmc.experiments.patch_sim_traditional import score
from ogm_mcmc.experiments.scoring import counts_of, draw_scores, pooled, summary
from ogm_mcmc.geometry import GridMap, GridSpec
from ogm_mcmc.simulation import GridWorld


def test_a_hundred_names():
    names = set_names()
    assert len(names) == 100
    assert names['map10_run03'] == (10, 3)
    assert list(set_names(maps=2, runs=1).values()) == [(1, 1), (2, 1)]


@pytest.mark.jit
def test_sets_are_seeded_and_differ():
    arguments = {'seed': 7, 'noise_cells': 3.0, 'max_scans': 3}
    one, same = simulated_set(9, 1, **arguments), simulated_set(9, 1, **arguments)
    other = simulated_set(9, 2, **arguments)
    assert np.array_equal(one.scans[2].scan.ranges_m, same.scans[2].scan.ranges_m)
    assert np.array_equal(one.world.occupied, other.world.occupied)
    assert one.scans[0].pose != other.scans[0].pose
    assert one.scans[0].scan.ranges_m.size == 180


@pytest.mark.jit
def test_score_of_one_set():
    result = score(10, 1, seed=7, noise_cells=1.0, prior=0.234)
    assert result['positives'] + result['negatives'] == 500 * 500
    counts = pooled([result])
    # Called occupied from 0 on is everything; from above the prior on, only what was hit.
    everything = counts.scores(-1)
    assert everything.threshold == 0.0
    assert everything.recall == 1.0
    assert everything.precision == pytest.approx(result['positives'] / 250_000)
    assert counts.best().f1 > 0.75
    assert result['measured'] > 0.75
    twice = pooled([result, result])
    assert twice.best() == pytest.approx(counts.best())
    assert twice.positives == 2 * counts.positives


def test_counts_and_summary_by_hand(tmp_path):
    """Four cells, one of them unmapped and by the prior of 0.3 called occupied from 0.3 down."""
    spec = GridSpec(1.0, 4, 1)
    world = GridWorld.checked(spec, np.array([[1, 0, 0, 1]]))
    grid_map = GridMap(spec, np.array([[0.9, 0.5, 0.1, np.nan]], np.float32))
    result = counts_of(grid_map, world, 0.3)
    assert result['measured'] == 0.75
    counts = pooled([result])
    values = summary(counts)
    assert values['max precision'] == 1.0
    assert values['max F1'] == pytest.approx(2 * 2 / (2 * 2 + 1))
    assert values['threshold for max F1'] == pytest.approx(0.3)
    assert values['precision at max F1'] == pytest.approx(2 / 3)
    assert values['recall at max F1'] == 1.0
    captions = draw_scores(tmp_path, {'a': counts, 'b': counts})
    assert {path.name for path in tmp_path.iterdir()} == set(captions)

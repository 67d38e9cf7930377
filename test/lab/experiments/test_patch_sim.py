"""One of the hundred data sets, mapped and scored; pooled counts."""

import numpy as np
import pytest

from ogm_mcmc.geometry import GridMap, GridSpec
from ogm_mcmc.lab.experiments import patch_sim
from ogm_mcmc.lab.experiments.chains import ChainPlan
from ogm_mcmc.lab.experiments.scoring import counts_of, draw_scores, pooled, summary
from ogm_mcmc.sampling.patch_learning import PatchCounts, WindowCounts
from ogm_mcmc.simulation import GridWorld, generate_floor


@pytest.mark.full
@pytest.mark.jit
def test_one_set_in_every_way(monkeypatch):
    """Few samples of one sparse building: the border prior is ahead by far."""
    few = ChainPlan(samples=4, burn_in=8)
    monkeypatch.setattr(patch_sim, 'PLANS', dict.fromkeys(patch_sim.PLANS, few))
    best = {}
    for method in patch_sim.FILES:
        result = patch_sim.score(9, 1, method, seed=7, noise_cells=3.0, beams=180)
        assert result['positives'] + result['negatives'] == 500 * 500
        counts = pooled([result])
        everything = counts.scores(-1)
        assert (everything.threshold, everything.recall) == (0.0, 1.0)
        assert 0.6 < result['measured'] < 0.9
        assert result['scans'] > 20
        best[method] = summary(counts)['max F1']
    assert best['border, L = 9'] > best['traditional'] + 0.02
    assert best['border, L = 9'] > max(best['L = 9'], best['L = 1'])
    assert best['border, other buildings'] > best['traditional'] + 0.02


@pytest.mark.jit
def test_prior_of_the_buildings_is_their_own():
    counts = patch_sim.buildings_prior(1)
    floors = [generate_floor(number, 1).occupied for number in range(1, 11)]
    assert counts.p_occupied == pytest.approx(np.mean(floors))
    # Every 5 x 5 window of ten drawings of 500 x 500 cells, the blank outside of them, too.
    assert counts.squares.windows.sum() == 10 * 496**2


def fake_score(building, run, method, seed, noise_cells, beams):
    """Counts of four cells; the border prior is right about all, traditional misses one."""
    world = GridWorld.checked(GridSpec(1.0, 4, 1), np.array([[1, 0, 0, 1]]))
    values = {
        'traditional': [0.9, 0.1, 0.1, 0.05],
        'L = 9': [0.9, 0.1, 0.1, 0.4],
        'border, L = 9': [1.0, 0.0, 0.0, 0.9],
    }.get(method, [0.9, 0.1, 0.1, 0.3])
    counts = counts_of(GridMap(world.spec, np.array([values], np.float32)), world, 0.3)
    return {**counts, 'seconds': 1.0, 'scans': building + run}


def test_table_of_the_paper(tmp_path, monkeypatch):
    monkeypatch.setenv('OGM_MCMC_WORKERS', '1')
    monkeypatch.setattr(patch_sim, 'score', fake_score)
    monkeypatch.setattr(
        patch_sim,
        'buildings_prior',
        lambda seed: PatchCounts(
            0.1, np.array([3, 1]), np.ones(512, np.int64), WindowCounts(np.zeros(1), np.ones(1))
        ),
    )
    result = patch_sim.run(tmp_path, quick=False, seed=3)
    rows = {line['what']: line for line in result['rows']}
    assert rows['border, L = 9: max F1']['ours'] == 1.0
    assert rows['border, L = 9: max F1']['published'] == 0.982
    assert rows['traditional: max F1']['ours'] == pytest.approx(2 * 2 / (2 * 2 + 2))
    assert rows['border, L = 9 above traditional, max F1']['ours'] == pytest.approx(1 / 3)
    assert rows['border, L = 9: F1 at 0.5']['ours'] == 1.0
    assert rows['L = 9: F1 at 0.5']['ours'] == pytest.approx(2 / 3)
    assert rows['border, real maps: max F1 on 10 first runs']['ours'] == 1.0
    assert len(result['f1_by_data_set']) == 100
    assert result['settings']['scans_per_set'] == '2 to 20'
    assert result['settings']['prior'] == '0.2500'


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

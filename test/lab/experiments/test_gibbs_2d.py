"""Burn-in, the maps that are compared, and one data set with few sweeps."""

import io

import numpy as np
import pytest
from PIL import Image

from ogm_mcmc.geometry import GridSpec, PlacedScan, Pose2D, Scan
from ogm_mcmc.lab.experiments import gibbs_2d, gibbs_figures
from ogm_mcmc.lab.experiments.hundred_sets import SimulatedSet
from ogm_mcmc.plotting.grids import LEFT, RIGHT, TOP
from ogm_mcmc.simulation import GridWorld


def test_burn_in_by_hand():
    later = np.tile([-1.0, 1.0], 10)  # mean 0, standard deviation 1
    early = np.full(20, -50.0)
    early[7:] = -2.9
    assert gibbs_2d.burn_in(np.concatenate((early, later))) == 8
    early[7:] = -3.1
    assert gibbs_2d.burn_in(np.concatenate((early, later))) == 21


def room():
    """Return a row of cells, solid from the sixth on, seen from the middle of the first."""
    spec = GridSpec(1.0, 9, 3)
    occupied = np.ones((3, 9), np.uint8)
    occupied[1, :5] = 0
    scan = Scan.checked(
        np.array([4.2, 5.1, np.inf]),
        angle_min_rad=0.0,
        angle_increment_rad=1e-9,
        range_min_m=0.0,
        range_max_m=7.0,
    )
    world = GridWorld.checked(spec, occupied)
    return SimulatedSet(world, [PlacedScan.at(scan, Pose2D(0.5, 1.5))])


def test_maps_of_figure_5():
    data = room()
    counts = gibbs_figures.reflections(data)
    assert counts.sum() == 2
    assert (counts[1, 4], counts[1, 5]) == (1, 1)
    truth = gibbs_2d.true_map(data)
    assert truth[1].tolist() == pytest.approx([0, 0, 0, 0, 0, 1, 0.15, 0.15, 0.15])
    assert truth[0].tolist() == pytest.approx([1, 1, 1, 1, 1, 1, 0.15, 0.15, 0.15])


def test_the_square_that_holds_most():
    values = np.zeros((40, 60))
    values[10, 20] = 3.0
    values[12, 22] = 3.0
    values[0, 59] = 5.0  # too near to the border for a whole square to be around it
    values[30, 40] = 4.0
    first = gibbs_figures.densest(values, 2)
    assert abs(first[0] - 21) + abs(first[1] - 11) <= 2
    assert values[first[1] - 2 : first[1] + 3, first[0] - 2 : first[0] + 3].sum() == 6.0
    corner = gibbs_figures.densest(values, 2, [first])
    assert corner == (57, 2)
    second = gibbs_figures.densest(values, 2, [first, corner])
    assert values[second[1] - 2 : second[1] + 3, second[0] - 2 : second[0] + 3].sum() == 4.0


def test_places_that_figure_5_enlarges():
    spec, prior = GridSpec(0.1, 200, 100), 0.15
    live = np.full((100, 200), 0.001)  # seen often
    counts = np.zeros((100, 200))
    counts[30:50, 40] = 9.0
    live[60:80, 100:120] = np.nan
    live[20:40, 150:170] = 0.0423  # one beam: prior log-odds and log(1 / 4)
    live[60:90, 150:190] = 0.0009  # four beams, more cells
    observable, free = np.ones((100, 200), bool), np.ones((100, 200), bool)
    observable[:, 100:110] = False
    places = gibbs_figures.closeups_of(counts, live, observable, free, spec, prior)
    cells = [spec.cell_of(one.x, one.y) for one in places]
    assert abs(cells[0][0] - 40) <= 15
    assert abs(cells[1][0] - 115) <= 11
    assert abs(cells[2][0] - 160) <= 6
    assert [cells[k][1] for k in range(3)] == pytest.approx([40, 70, 30], abs=6)
    assert {round(one.radius, 6) for one in places} == {1.5}


def test_chains_are_compared_by_their_distance_from_where_they_end():
    """The constant that a prior adds to a log posterior must not be seen."""
    trace = np.concatenate((-(10.0 ** np.arange(5.0, 2.0, -0.5)), np.tile([-20.0, 20.0], 20)))
    burn_ins = {0.15: 5, 0.5: 7}
    one = gibbs_figures.convergence_png({0.15: trace, 0.5: 2.0 * trace}, burn_ins)
    other = gibbs_figures.convergence_png({0.15: trace - 4e4, 0.5: 2.0 * trace + 5e3}, burn_ins)
    with Image.open(io.BytesIO(one)) as first, Image.open(io.BytesIO(other)) as second:
        assert (np.asarray(first) == np.asarray(second)).all()
    slower = gibbs_figures.convergence_png({0.15: trace, 0.5: 3.0 * trace}, burn_ins)
    assert slower != one


@pytest.mark.jit
def test_pictures(monkeypatch, tmp_path):
    monkeypatch.setattr(gibbs_2d, 'SWEEPS', 20)
    monkeypatch.setattr(gibbs_2d, 'SAMPLES', 10)
    captions = gibbs_2d._pictures(tmp_path, seed=1)
    assert {path.name for path in tmp_path.iterdir()} == set(captions)
    assert len(captions) == 3 + 1 + 6
    for name in captions:
        with Image.open(tmp_path / name) as picture:
            pixels = np.asarray(picture.convert('RGB'))
        if name != 'convergence.png':
            assert pixels.shape[1] == LEFT + 500 + RIGHT
            # Three circles under the maps of Fig. 5 and on them.
            circled = (pixels == (31, 119, 180)).all(axis=2)
            assert (
                circled[: TOP + 500].any() == circled[TOP + 540 :].any() == ('sample' not in name)
            )


@pytest.mark.jit
def test_one_set(monkeypatch):
    monkeypatch.setattr(gibbs_2d, 'SWEEPS', 60)
    monkeypatch.setattr(gibbs_2d, 'SAMPLES', 40)
    result = gibbs_2d.score(8, 1, seed=3, noise_cells=2.0, beams=90)
    # An uninformed prior takes longer, and the truth is further away than the live map.
    assert 5 < result['burn_in']['0.15'] < result['burn_in']['0.5'] < 60
    assert result['mcmc_live'] < result['mcmc_truth']
    assert all(np.isfinite(result[name]) for name in ('truth_mcmc', 'live_mcmc', 'mcmc_truth'))
    assert result['seconds_per_sweep'] < 1.0


def fake_score(building, run, seed, noise_cells, beams):
    """Values whose means tell them apart; [gibbs] did a hundred data sets."""
    return {
        'mcmc_truth': 1000.0 * building,
        'truth_mcmc': 2000.0 * building,
        'mcmc_live': 10.0 * run,
        'live_mcmc': 20.0 * run,
        'truth_live': 30.0 * run,
        'burn_in': {'0.15': run, '0.5': 100 + run},
        'behind_truth': float(building - run),
        'seconds_per_sweep': 0.01 * building,
        'scans': 50,
        'pairs': 1000,
    }


@pytest.mark.parametrize('quick', [False, True])
def test_numbers_of_section_iv_b(tmp_path, monkeypatch, quick):
    monkeypatch.setenv('OGM_MCMC_WORKERS', '1')
    monkeypatch.setattr(gibbs_2d, 'score', fake_score)
    monkeypatch.setattr(gibbs_2d, 'simulated_set', lambda *_, **__: room())
    monkeypatch.setattr(gibbs_2d, 'SWEEPS', 20)
    monkeypatch.setattr(gibbs_2d, 'SAMPLES', 10)
    monkeypatch.setattr('ogm_mcmc.lab.experiments.gibbs_figures.CLOSEUP_CELLS', 1)
    result = gibbs_2d.run(tmp_path, quick=quick, seed=1)
    rows = {line['what']: (line['ours'], line['published']) for line in result['rows']}
    # Buildings 1 to 10 and runs 1 to 10; or buildings 1, 3, 5, 7, 9 and run 1.
    building, of_runs = (5.0, 1.0) if quick else (5.5, 5.5)
    assert rows == {
        'D(MCMC, truth)': (pytest.approx(1000.0 * building), 8.8e5),
        'D(truth, MCMC)': (pytest.approx(2000.0 * building), 8.8e5),
        'D(MCMC, two-assumption)': (pytest.approx(10.0 * of_runs), 6.3e3),
        'D(two-assumption, MCMC)': (pytest.approx(20.0 * of_runs), 6.3e3),
        'D(truth, two-assumption)': (pytest.approx(30.0 * of_runs), None),
        'sweeps of burn-in, prior 0.15': (of_runs, 'less than 20'),
        'sweeps of burn-in, prior 0.5': (100 + of_runs, 'in excess of 200'),
        'log posterior below that of a chain from the truth': (building - of_runs, None),
        'seconds a sweep': (pytest.approx(0.01 * building), 53.0),
    }
    assert result['settings']['data_sets'] == (5 if quick else 100)
    assert {path.name for path in tmp_path.glob('*.png')} == set(result['pictures'])
    parts = {path.stem.rpartition('_')[0] for path in (tmp_path / 'datasets').iterdir()}
    assert len(parts) == (5 if quick else 100)
    assert 'map09_run01' in parts

"""Burn-in, the maps that are compared, and one data set with few sweeps."""

import numpy as np
import pytest

from ogm_mcmc.experiments import gibbs_2d
from ogm_mcmc.experiments.hundred_sets import SimulatedSet
from ogm_mcmc.geometry import GridSpec, Pose2D, Scan
from ogm_mcmc.simulation import GridWorld, SimulatedScan


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
    return SimulatedSet(world, [SimulatedScan(scan, Pose2D(0.5, 1.5))])


def test_maps_of_figure_5():
    data = room()
    counts = gibbs_2d.reflections(data)
    assert counts.sum() == 2
    assert (counts[1, 4], counts[1, 5]) == (1, 1)
    truth = gibbs_2d.true_map(data)
    assert truth[1].tolist() == pytest.approx([0, 0, 0, 0, 0, 1, 0.15, 0.15, 0.15])
    assert truth[0].tolist() == pytest.approx([1, 1, 1, 1, 1, 1, 0.15, 0.15, 0.15])


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

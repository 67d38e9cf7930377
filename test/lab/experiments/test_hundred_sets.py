"""Names and seeds of the simulated data sets."""

import numpy as np
import pytest

from ogm_mcmc.lab.experiments.hundred_sets import set_names, simulated_set


def test_a_hundred_names():
    names = set_names()
    assert len(names) == 100
    assert len({building for building, _ in list(names.values())[:10]}) == 10
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
    assert one.scans[0].scan.ranges_m.size == 360

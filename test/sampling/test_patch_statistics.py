"""The figures that are compared with [patch] section III, on maps where they can be counted."""

import numpy as np
import pytest

from ogm_mcmc.config import LearningConfig
from ogm_mcmc.sampling.patch_learning import count_map
from ogm_mcmc.sampling.patch_statistics import PUBLISHED, patch_statistics


def test_one_occupied_cell():
    """On 9 x 9 every place in a window is taken once: nothing else, and nothing twice."""
    states = np.zeros((9, 9), np.int8)
    states[4, 4] = 1
    figures = patch_statistics(count_map(states, LearningConfig()))
    assert figures['windows'] == 25
    assert figures['p_occupied'] == pytest.approx(1 / 81)
    assert figures['patches_seen'] == 1 + 9
    assert figures['squares_seen'] == figures['squares_for_99.9_percent'] == 25
    assert figures['patch_free'] == pytest.approx((49 - 9) / 49)
    assert figures['patch_occupied'] == figures['square_occupied'] == figures['square_free'] == 0
    # Free around: nine patches alike. 16 borders with one occupied cell: the free patch.
    assert figures['borders_seen'] == 1 + 16
    assert figures['most_patches_per_border'] == 9
    assert figures['likeliest_patch'] == pytest.approx((16 + 1 / 9) / 17)
    assert figures['likeliest_four'] == pytest.approx((16 + 4 / 9) / 17)
    assert figures['cell_borders_seen'] == 1 + 8
    assert figures['cell_borders_undecided'] == 1


def test_the_most_frequent_patterns():
    """Free windows are a little less than 99.9 %: more than one pattern is needed."""
    states = np.zeros((40, 40), np.int8)
    states[20, 20] = 1
    figures = patch_statistics(count_map(states, LearningConfig()))
    # 38**2 windows: 1435 free, then one each of nine patterns; 1443 are 99.9 %, 1442.556.
    assert figures['patches_for_99.9_percent'] == 1 + 8


def test_published_figures_are_all_compared():
    counts = count_map(np.eye(9, dtype=np.int8), LearningConfig())
    assert set(PUBLISHED) < set(patch_statistics(counts))


def test_the_shipped_maps_are_speckled_buildings():
    from ogm_mcmc.engine.prior_files import default_prior_file, load_prior

    figures = patch_statistics(load_prior(default_prior_file()).counts)
    assert figures['p_occupied'] == pytest.approx(0.31, abs=0.05)
    assert figures['borders_seen'] > 50_000
    assert figures['patch_free'] + figures['patch_occupied'] > 0.8

"""A map against the truth: alignment, unknown cells, and figures that agree with each other."""

import json

import numpy as np
import pytest

from ogm_mcmc.config import EvaluationConfig
from ogm_mcmc.errors import GridError
from ogm_mcmc.evaluation import aligned, compare, confusion_counts, divergence
from ogm_mcmc.geometry import GridMap, GridSpec


def grid(rows, *, column0=0, row0=0, resolution=0.5, anchor=0.0):
    array = np.array(rows, np.float32)
    spec = GridSpec(resolution, array.shape[1], array.shape[0], column0, row0, anchor, anchor)
    return GridMap(spec, array)


TRUTH = grid([[0, 0, 1], [0, np.nan, 1]])
NAN = np.nan


def test_windows_of_one_lattice_are_put_over_each_other():
    moved = grid([[0.1, 0.2], [0.3, 0.4]], column0=1, row0=-1)
    expected = [[NAN, 0.3, 0.4], [NAN, NAN, NAN]]
    assert np.array_equal(aligned(moved, TRUTH), np.float32(expected), equal_nan=True)
    larger = grid(np.arange(20).reshape(4, 5) / 20, column0=-1, row0=-1)
    assert np.array_equal(aligned(larger, TRUTH), larger.probability[1:3, 1:4])


def test_other_lattices_are_refused():
    with pytest.raises(GridError, match=r'resolution of the map is 0\.1 m'):
        aligned(grid([[0.0]], resolution=0.1), TRUTH)
    with pytest.raises(GridError, match=r'\(0.400, 0.400\) cells apart'):
        aligned(grid([[0.0]], anchor=0.2), TRUTH)
    assert aligned(grid([[0.25]], anchor=0.2), TRUTH, nearest=True)[0, 0] == 0.25
    with pytest.raises(GridError, match='no cell in common'):
        aligned(grid([[0.0]], column0=7), TRUTH)


def test_a_filled_map_judges_cells_that_are_unknown_but_does_not_make_them_known():
    estimate = grid([[0.2, 0.1, NAN], [0.6, 0.9, NAN]])
    filled = grid([[0.2, NAN, 0.8], [0.6, 0.9, NAN]])  # says nothing of a cell that is known
    of_all = compare(estimate, TRUTH, EvaluationConfig(unknown=0.3), filled=filled)
    assert of_all.figures['measured_cells'] == 3
    assert np.array_equal(of_all.probability[:, 2], np.float32([0.8, 0.3]))
    assert of_all.probability[0, 1] == np.float32(0.1)
    assert np.isnan(of_all.measured[:, 2]).all()
    measured = compare(estimate, TRUTH, EvaluationConfig(mask='measured'), filled=filled)
    assert measured.figures['cells'] == 3


def test_figures_of_a_small_map():
    estimate = grid([[0.2, 0.1, 0.9], [0.6, 0.9, NAN]])
    result = compare(estimate, TRUTH)
    figures = result.figures
    assert figures['cells'] == 5
    assert figures['measured_cells'] == 4
    assert figures['occupied_cells'] == 2
    scores = figures['at_threshold']
    assert scores['precision'] == pytest.approx(2 / 3)
    assert scores['recall'] == 1.0
    assert figures['best']['threshold'] == 0.5
    p, q = np.array([0, 0, 1, 0, 1]), np.array([0.2, 0.1, 0.9, 0.6, 0.5])
    assert figures['divergence_nats'] == pytest.approx(divergence(p, q).sum(), rel=1e-6)
    assert figures['roc_area'] == pytest.approx(confusion_counts(q, p == 1).roc_area())
    # The wrong cell of the second row is two cells of 0.5 m from a wall.
    assert figures['occupied_distance']['map_to_truth_m']['largest'] == pytest.approx(1.0)
    assert figures['occupied_distance']['truth_to_map_m']['largest'] == 0.0
    json.dumps(figures)


def test_masks_and_unknown_cells():
    estimate = grid([[0.2, NAN, NAN], [NAN, NAN, NAN]])
    cells = {
        mask: compare(estimate, TRUTH, EvaluationConfig(mask=mask, near_cells=1)).figures['cells']
        for mask in ('all', 'measured', 'near')
    }
    assert cells == {'all': 5, 'measured': 1, 'near': 3}
    as_walls = EvaluationConfig(truth_unknown='occupied', unknown=0.8)
    result = compare(estimate, TRUTH, as_walls)
    assert result.figures['cells'] == 6
    assert result.figures['occupied_cells'] == 3
    assert result.figures['at_threshold']['recall'] == 1.0
    as_free = compare(estimate, TRUTH, EvaluationConfig(truth_unknown='free'))
    assert as_free.figures['occupied_cells'] == 2


def test_nothing_left_to_count():
    with pytest.raises(GridError, match='no cell counts'):
        compare(grid([[NAN]]), TRUTH, EvaluationConfig(mask='measured'))


def test_a_perfect_map():
    result = compare(TRUTH, TRUTH).figures
    assert result['best']['f1'] == 1.0
    assert result['roc_area'] == 1.0
    assert result['divergence_nats'] == pytest.approx(0.0, abs=1e-4)
    assert result['divergence_clipped_cells'] == 5

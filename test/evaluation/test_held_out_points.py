"""Points of held-out beams: where they lie, and their scores, by hand."""

import math

import numpy as np
import pytest
from sklearn.metrics import brier_score_loss, log_loss, roc_auc_score
from support.strategies import fan

from ogm_mcmc.errors import ConfigError
from ogm_mcmc.evaluation import held_out_beams, held_out_points, probability_at, score_points
from ogm_mcmc.geometry import GridMap, GridSpec, PlacedScan, Pose2D

NAN = math.nan
MAP = GridMap(GridSpec(1.0, 4, 1), np.array([[0.1, 0.3, 0.9, NAN]], np.float32))


def beams_of(*placed):
    return held_out_beams(placed, MAP.spec)


def looking(*ranges, pose=None):
    scan = fan(*ranges, increment=1e-9, range_max_m=3.0)
    return PlacedScan.at(scan, pose or Pose2D(0.5, 0.5))


def test_where_points_lie():
    """A beam of 2 m, two steps; one of 2.4 m, likewise; none; one shorter than half a step."""
    beams = beams_of(looking(2.0, 2.4), looking(NAN), looking(np.inf, 0.4, pose=Pose2D(3.5, 0.5)))
    points = held_out_points(beams, 1.0)
    expected = [(1.0, 0), (2.0, 0), (1.0, 0), (2.0, 0), (2.5, 1), (2.9, 1)]
    expected += [(4.0, 0), (5.0, 0), (6.0, 0), (3.9, 1)]
    assert np.allclose(points.xy_m[:, 0], [x for x, _ in expected])
    assert np.allclose(points.xy_m[:, 1], 0.5)
    assert points.occupied.tolist() == [bool(kind) for _, kind in expected]
    assert points.scan.tolist() == [0] * 6 + [1] * 4


def test_a_turned_sensor():
    points = held_out_points(beams_of(looking(0.5, pose=Pose2D(0.5, 0.5, np.pi))), 0.2)
    assert np.allclose(points.xy_m, [[0.4, 0.5], [0.2, 0.5], [0.0, 0.5]])


def test_more_points_than_memory_holds_are_refused():
    """Two beams of 2 m: 40 free points and 2 ends with 0.1 m between them, 400 and 2 with 1 cm."""
    beams = beams_of(looking(2.0), looking(2.0))
    assert held_out_points(beams, 0.1, most=42).occupied.size == 42
    with pytest.raises(ConfigError, match=r'point_step is 0.01.* 402 points'):
        held_out_points(beams, 0.01, most=401)


def test_what_the_map_says():
    xy = [[0.0, 0.0], [1.0, 0.999], [2.99, 0.5], [3.5, 0.5], [-0.01, 0.5], [4.0, 0.5], [0.5, 1.0]]
    assert probability_at(MAP, xy, 0.4) == pytest.approx([0.1, 0.3, 0.9, 0.4, 0.4, 0.4, 0.4])


def test_scores_are_those_of_scikit_learn():
    rng = np.random.default_rng(3)
    placed = [looking(*rng.uniform(0.2, 3.0, 5)) for _ in range(4)]
    points = held_out_points(beams_of(*placed), 0.25)
    given = rng.choice([0.0, 0.2, 0.4, 0.7], points.occupied.size)
    scores = score_points(points, given, floor=0.01)
    kept = np.clip(given, 0.01, 0.99)
    assert scores.counts.roc_area() == pytest.approx(roc_auc_score(points.occupied, given))
    assert scores.log_loss.value == pytest.approx(log_loss(points.occupied, kept))
    assert scores.brier.value == pytest.approx(brier_score_loss(points.occupied, given))
    assert scores.clipped == (given == 0.0).sum() > 0
    sums = np.array([scores.log_losses[points.scan == k].sum() for k in range(4)])
    counts = np.bincount(points.scan)
    gaps = sums - scores.log_loss.value * counts
    error = math.sqrt(4 / 3 * (gaps**2).sum()) / counts.sum()
    assert scores.log_loss.standard_error == pytest.approx(error)


def test_no_beams_and_no_step():
    points = held_out_points(beams_of(looking(NAN)), 0.5)
    assert points.xy_m.shape == (0, 2)
    with pytest.raises(ConfigError, match='expected a positive distance'):
        held_out_points(beams_of(looking(1.0)), 0.0)

"""Sensor models of a localizer: by hand, and against the judge of held-out beams."""

import math

import numpy as np
import pytest

from ogm_mcmc.config import ForwardModelConfig
from ogm_mcmc.errors import ConfigError
from ogm_mcmc.evaluation import (
    AmclNumbers,
    CastBeams,
    LikelihoodField,
    SampleBeams,
    beam_log_likelihood,
    log_likelihood_of_samples,
)
from ogm_mcmc.geometry import GridMap, GridSpec, PlacedScan, Pose2D, SampleBits, Scan
from ogm_mcmc.mapping import ProbabilityBeams
from ogm_mcmc.sensors import ForwardModel

NAN = math.nan
SPEC = GridSpec(0.5, 6, 3, anchor_x_m=-1.0, anchor_y_m=2.0)
CORRIDOR = GridMap(
    SPEC,
    np.array(
        [[0.0, 0.1, 0.2, 0.0, 0.9, 1.0], [0.0, 0.0, 0.2, 0.0, 0.8, NAN], [0.5, 0, 0, 0, 0, 0.7]],
        np.float32,
    ),
)
MODEL = ForwardModel.from_config(ForwardModelConfig(sigma=0.2, clutter=0.1, missing=0.05))
REACH = 5.0

# Tails of hits are cut where clutter is ten thousand times as likely.
NEARLY = 1e-4


def weights(fit, poses, bearings, ranges):
    return fit.log_likelihoods(
        np.array(poses, np.float64), np.array(bearings), np.array(ranges), REACH
    )


def test_likelihood_field_by_hand():
    fit = LikelihoodField(CORRIDOR, AmclNumbers(occupied=0.8))

    # Walls: the cells with 0.9, 1.0 and 0.8. From the middle of the middle row's first cell, a
    # beam of 1 m ends in its third cell, two cells of half a metre from the wall; one of 2 m in
    # the wall; one backwards outside, where the largest distance counts.
    def p(off):
        return 0.5 * math.exp(-0.5 * (off / 0.2) ** 2) + 0.5 / REACH

    pose = (-0.75, 2.75, 0.0)
    got = weights(fit, [pose] * 1, [0.0, 0.0, math.pi], [1.0, 2.0, 3.0])
    expected = math.log(1.0 + p(1.0) ** 3 + p(0.0) ** 3 + p(2.0) ** 3)
    assert got == pytest.approx([expected], rel=1e-6)
    product = LikelihoodField(CORRIDOR, AmclNumbers(occupied=0.8), product=True)
    got = weights(product, [pose], [0.0, 0.0, math.pi], [1.0, 2.0, 3.0])
    assert got == pytest.approx([math.log(p(1.0) * p(0.0) * p(2.0))], rel=1e-6)
    # What did not return says nothing.
    assert weights(fit, [pose], [0.0, 0.0], [math.inf, REACH]) == pytest.approx([0.0])


def test_cast_beams_by_hand():
    fit = CastBeams(CORRIDOR, AmclNumbers(free=0.2))
    # 0.8 ends the ray half way through: 2 m from the middle of the first cell. Backwards the
    # border of the map is met after 0.25 m. In the upper row 0.5 is unknown, and ends a ray.
    pose = (-0.75, 2.75, 0.0)

    def p(reading, cast):
        hit = 0.5 * math.exp(-0.5 * ((reading - cast) / 0.2) ** 2)
        early = 0.05 * 0.1 * math.exp(-0.1 * reading) if reading < cast else 0.0
        return hit + early + (0.05 if reading >= REACH else 0.5 / REACH)

    got = weights(fit, [pose], [0.0, 0.0, math.pi], [1.9, math.inf, 0.3])
    expected = math.log(1 + p(1.9, 2.0) ** 3 + p(REACH, 2.0) ** 3 + p(0.3, 0.25) ** 3)
    assert got == pytest.approx([expected], rel=1e-6)
    unknown = weights(fit, [(-0.75, 3.25, 0.0)], [0.0], [0.25])
    assert unknown == pytest.approx([math.log(1 + p(0.25, 0.125) ** 3)], rel=1e-6)


@pytest.fixture(scope='module')
def random_case():
    """A map of 30 x 20 cells with unknown ones, poses in and outside of it, one scan."""
    rng = np.random.default_rng(3)
    spec = GridSpec(0.2, 30, 20, anchor_x_m=1.0)
    probability = np.clip(rng.random((20, 30)) ** 6, 0.0, 1.0).astype(np.float32)
    probability[rng.random((20, 30)) < 0.2] = NAN
    probability[rng.random((20, 30)) < 0.3] = 0.0
    poses = np.column_stack(
        (rng.uniform(0.5, 7.5, 12), rng.uniform(-0.5, 4.5, 12), rng.uniform(-3, 3, 12))
    )
    ranges = np.array([0.3, 1.0, np.inf, 2.5, 4.9, np.nan, 0.05, np.inf, 1.7], np.float32)
    scan = Scan.checked(
        ranges, angle_min_rad=-2.0, angle_increment_rad=0.5, range_min_m=0.0, range_max_m=REACH
    )
    return GridMap(spec, probability), poses, scan


def slow(likelihoods, poses, scan):
    return [likelihoods([PlacedScan.at(scan, Pose2D(*pose))]) for pose in poses]


def heard(scan):
    beams = scan.informative()
    return scan.bearings()[beams], scan.ranges_m[beams].astype(np.float64), REACH


def test_probabilities_as_the_judge_of_held_out_beams(random_case):
    grid_map, poses, scan = random_case
    got = ProbabilityBeams(grid_map, MODEL, 0.15).log_likelihoods(poses, *heard(scan))
    one_by_one = slow(
        lambda placed: beam_log_likelihood(grid_map, placed, MODEL, prior=0.15).sum(), poses, scan
    )
    assert got == pytest.approx(one_by_one, abs=NEARLY)


@pytest.mark.parametrize('jointly', [False, True])
def test_samples_as_the_judge_of_held_out_beams(random_case, jointly):
    grid_map, poses, scan = random_case
    known = np.isfinite(grid_map.probability)
    rng = np.random.default_rng(4)
    maps = rng.random((64, *known.shape)) < np.nan_to_num(grid_map.probability)
    bits = SampleBits.of_maps(grid_map.spec, maps.astype(np.uint8), known)
    samples = [
        GridMap(grid_map.spec, np.where(known, cells, np.float32(np.nan)).astype(np.float32))
        for cells in maps
    ]
    power = 0.3 if jointly else 1.0
    fit = SampleBeams(bits, MODEL, 0.15, jointly, power)
    got = fit.log_likelihoods(poses, *heard(scan))

    def mixture(placed):
        if not jointly:
            return log_likelihood_of_samples(samples, placed, MODEL, prior=0.15).sum()
        each = [beam_log_likelihood(one, placed, MODEL, prior=0.15).sum() for one in samples]
        return np.logaddexp.reduce(power * np.array(each)) - math.log(64)

    some = slice(None, None, 4)
    assert got[some] == pytest.approx(slow(mixture, poses[some], scan), abs=NEARLY)


def test_samples_know_what_cells_know_of_each_other():
    """One wall at one of two places: never both, which independent cells cannot say."""
    spec = GridSpec(1.0, 6, 1)
    maps = np.array([[[0, 0, 1, 0, 0, 0]], [[0, 0, 0, 0, 1, 0]]], np.uint8)
    bits = SampleBits.of_maps(spec, maps, np.ones((1, 6), np.bool_))
    mean = GridMap(spec, maps.mean(axis=0).astype(np.float32))
    pose, beam = np.array([[0.5, 0.5, 0.0]]), (np.zeros(1), np.array([np.inf]), 6.0)
    nothing = MODEL.missing
    of_samples = SampleBeams(bits, MODEL, 0.0).log_likelihoods(pose, *beam)
    of_mean = ProbabilityBeams(mean, MODEL, 0.0).log_likelihoods(pose, *beam)
    assert of_samples == pytest.approx([math.log(nothing)], rel=1e-6)
    assert of_mean == pytest.approx([math.log(nothing + 0.25 * MODEL.hit)], rel=1e-6)


def test_models_that_cannot_be_read(random_case):
    grid_map, _, _ = random_case
    with pytest.raises(ConfigError, match='short'):
        ProbabilityBeams(
            grid_map, ForwardModel.from_config(ForwardModelConfig(kind='gaussian')), 0.1
        )
    many = SampleBits(grid_map.spec, np.zeros((20, 30, 2), np.uint64), np.ones((20, 30), bool), 65)
    with pytest.raises(ConfigError, match='65 map samples'):
        SampleBeams(many, MODEL, 0.1)

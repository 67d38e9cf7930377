"""Held-out beams: one line of cells by hand, which beams count, and the error of their mean."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.strategies import REPEATABLE, fan, poses, scans

from ogm_mcmc.config import ForwardModelConfig
from ogm_mcmc.errors import ConfigError, GridError
from ogm_mcmc.evaluation import (
    beam_log_likelihood,
    expected_information_gain,
    held_out_beams,
    log_likelihood_of_samples,
    ratio_of_sums,
    without_beams_that_leave,
)
from ogm_mcmc.geometry import GridMap, GridSpec, PlacedScan, Pose2D
from ogm_mcmc.sensors.forward_model import ForwardModel

HERE = Pose2D(0.5, 0.5)
SIGMA, CLUTTER, MISSING = 0.2, 0.1, 0.05
MODEL = ForwardModel.from_config(
    ForwardModelConfig(sigma=SIGMA, clutter=CLUTTER, missing=MISSING, depth=0.0)
)


def corridor(*probability):
    return GridMap(GridSpec(1.0, len(probability), 1), np.array([probability], np.float32))


def below(x):
    return 0.5 * math.erfc(-x / math.sqrt(2.0))


def density(z, f, reach):
    """p(z | f) of the model `beam`, from its definition; f None: nothing there, z inf: nothing."""
    hit = 1.0 - CLUTTER - MISSING
    if math.isinf(z):
        beyond = 1.0 if f is None else below((f - reach) / SIGMA) / below(f / SIGMA)
        return MISSING + hit * beyond
    peak = 0.0
    if f is not None:
        off = (z - f) / SIGMA
        peak = math.exp(-0.5 * off * off) / (SIGMA * math.sqrt(2.0 * math.pi)) / below(f / SIGMA)
    return CLUTTER / reach + hit * peak


def by_hand(z, reach):
    """Cells of 0.1, 0.6 and an unknown one of 0.8, entered at 0, 0.5 and 1.5; then nothing."""
    masses = {0.0: 0.1, 0.5: 0.9 * 0.6, 1.5: 0.9 * 0.4 * 0.8, None: 0.9 * 0.4 * 0.2}
    return math.log(sum(mass * density(z, f, reach) for f, mass in masses.items()))


def test_a_line_of_cells_on_paper():
    """Two scans of sensors that see 2.4 m and 2.2 m; the model brings its own depth."""
    grid_map = corridor(0.1, 0.6, math.nan)
    far, near = fan(0.6, 1.4, math.inf, 2.3, range_max_m=2.4), fan(1.0, range_max_m=2.2)
    got = beam_log_likelihood(
        grid_map, [PlacedScan.at(far, HERE), PlacedScan.at(near, HERE)], MODEL, prior=0.8
    )
    expected = [by_hand(z, 2.4) for z in (0.6, 1.4, math.inf, 2.3)] + [by_hand(1.0, 2.2)]
    assert got == pytest.approx(expected, rel=1e-6)


def test_samples_with_unknown_cells():
    """Where no ray came a sample says nothing; as the mean of one map it says the same."""
    samples = [corridor(0.0, 1.0, math.nan), corridor(0.0, 0.0, math.nan)]
    placed = [PlacedScan.at(fan(0.6, 1.4, math.inf, range_max_m=2.4), HERE)]
    got = log_likelihood_of_samples(iter(samples), placed, MODEL, prior=0.8)
    expected = [
        math.log(
            0.5 * density(z, 0.5, 2.4)
            + 0.5 * (0.8 * density(z, 1.5, 2.4) + 0.2 * density(z, None, 2.4))
        )
        for z in (0.6, 1.4, math.inf)
    ]
    assert got == pytest.approx(expected, rel=1e-6)
    free = log_likelihood_of_samples(samples[1:], placed, MODEL)
    assert free[2] == pytest.approx(math.log(density(math.inf, None, 2.4)))


def test_information_with_the_depth_of_the_model():
    grid_map = corridor(0.1, 0.6, 0.5)
    got = expected_information_gain(grid_map, HERE, [0.0], 2.4, MODEL)

    def log_density(z, f):
        return MODEL.log_density(z, f, 2.4)

    same = expected_information_gain(grid_map, HERE, [0.0], 2.4, log_density, depth=0.0)
    half_way = expected_information_gain(grid_map, HERE, [0.0], 2.4, log_density)
    assert got == pytest.approx(same)
    assert got != pytest.approx(half_way, abs=1e-3)


def test_the_error_of_a_mean_of_scans():
    # R = 6 / 4; s - R n = 0.5, 1, -1.5: variance 3 / 2 * 3.5 / 16.
    ratio = ratio_of_sums([2.0, 4.0, 0.0], [1, 2, 1])
    assert ratio.value == 1.5
    assert ratio.standard_error == pytest.approx(math.sqrt(1.5 * 3.5) / 4.0)
    # Equally large groups: the standard error of the mean of their means.
    sums = np.array([3.0, 5.0, 1.0, 2.0, 9.0])
    plain = np.std(sums / 7.0, ddof=1) / math.sqrt(5.0)
    assert ratio_of_sums(sums, np.full(5, 7)).standard_error == pytest.approx(plain)
    assert ratio_of_sums([3.0], [2])[0] == 1.5
    assert math.isnan(ratio_of_sums([3.0], [2]).standard_error)
    assert all(map(math.isnan, ratio_of_sums([], [])))


def test_the_error_is_that_of_repeated_draws():
    """Scans that share an error of their own: a thousand repetitions scatter as it says."""
    rng = np.random.default_rng(3)
    means, errors = [], []
    for _ in range(1000):
        counts = rng.integers(1, 30, 60)
        sums = counts * rng.normal(1.0, 0.5, 60) + np.sqrt(counts) * rng.normal(0.0, 1.0, 60)
        ratio = ratio_of_sums(sums, counts)
        means.append(ratio.value)
        errors.append(ratio.standard_error)
    # The scatter of 1000 draws is known within 2.2 %; beams taken as independent would give 2/5.
    assert np.mean(errors) == pytest.approx(np.std(means), rel=0.08)


def test_which_beams_count():
    spec = GridSpec(1.0, 3, 1)
    scan = fan(1.0, 2.4, 2.6, math.inf, math.nan, 9.0, range_max_m=5.0)
    short = fan(math.inf, 1.0, range_max_m=2.0)
    placed = [
        PlacedScan.at(scan, HERE),
        PlacedScan.at(fan(math.nan), HERE),
        PlacedScan.at(short, HERE),
    ]
    every = held_out_beams(placed, spec)
    assert len(every.placed) == 2  # one scan says nothing
    assert every.scan.tolist() == [0, 0, 0, 0, 1, 1]
    assert every.returned.tolist() == [True, True, True, False, False, True]
    # 0.5 + 2.6 is beyond 3; so is 0.5 + 5, where the beam without a return ends; 2.5 is not.
    assert every.leaving.tolist() == [False, False, True, True, False, False]
    assert every.cell.tolist() == [1, 2, -1, -1, 2, 1]
    assert every.left_out == 0
    inside = held_out_beams(placed, spec, leaving='exclude')
    assert inside.scan.tolist() == [0, 0, 1, 1]
    assert inside.left_out == 2
    assert not inside.leaving.any()
    returned = held_out_beams(placed, spec, no_return='ignore')
    assert returned.scan.tolist() == [0, 0, 0, 1]
    assert returned.returned.all()
    none = held_out_beams([PlacedScan.at(scan, Pose2D(20.0, 0.5))], spec, leaving='exclude')
    assert (none.placed, none.scan.size, none.left_out) == ([], 0, 4)
    assert math.isnan(none.mean(np.zeros(0)).value)


def test_a_range_to_which_beams_are_used():
    """A longer reading says that nothing is up to there, whatever +inf says."""
    scan = fan(1.0, 2.4, math.inf, math.nan, 9.0, range_max_m=5.0)
    for no_return, expected in (('clear', [1.0, math.inf, math.inf]), ('ignore', [1.0, math.inf])):
        beams = held_out_beams(
            [PlacedScan.at(scan, HERE)], GridSpec(1.0, 3, 1), max_range_m=2.0, no_return=no_return
        )
        (used, _) = beams.placed[0]
        assert used.range_max_m == 2.0
        assert used.ranges_m[used.informative()].tolist() == expected
    with pytest.raises(GridError, match='set max_range'):
        held_out_beams([PlacedScan.at(fan(1.0, range_max_m=3e5), HERE)], GridSpec(1.0, 3, 1))
    with pytest.raises(ConfigError, match='leaving'):
        held_out_beams([], GridSpec(1.0, 3, 1), leaving='stay')


def test_means_of_some_beams():
    spec = GridSpec(1.0, 9, 1)
    placed = [
        PlacedScan.at(fan(1.0, 2.0, math.inf, range_max_m=4.0), HERE),
        PlacedScan.at(fan(3.0), HERE),
    ]
    beams = held_out_beams(placed, spec)
    values = np.array([1.0, 2.0, 6.0, 5.0])
    assert beams.per_scan(values).tolist() == [3.0, 5.0]
    assert beams.mean(values) == ratio_of_sums([9.0, 5.0], [3, 1])
    assert beams.mean(values, beams.returned) == ratio_of_sums([3.0, 5.0], [2, 1])
    cells = beams.per_cell(values, spec)[0]
    assert cells[[1, 2, 3]].tolist() == [1.0, 2.0, 5.0]
    assert np.isnan(np.delete(cells, [1, 2, 3])).all()  # nothing returned from the fifth
    # A scan without such a beam is not one more independent draw.
    alone = beams.mean(values, ~beams.returned)
    assert alone.value == 6.0
    assert math.isnan(alone.standard_error)


@REPEATABLE
@given(scan=scans(), sensor=poses(3.0), x=st.floats(-3.0, 1.0), y=st.floats(-3.0, 1.0))
def test_beams_that_leave_end_in_no_cell(scan, sensor, x, y):
    spec = GridSpec(0.25, 9, 14, column0=2, row0=-3, anchor_x_m=x, anchor_y_m=y)
    ((kept, belief),) = without_beams_that_leave([PlacedScan.at(scan, sensor)], spec)
    assert belief.mean is sensor
    for k, (before, after) in enumerate(
        zip(scan.ranges_m.tolist(), kept.ranges_m.tolist(), strict=True)
    ):
        if math.isnan(before) or before == -math.inf:
            assert math.isnan(after)
            continue
        length = scan.range_max_m if before == math.inf else before
        angle = sensor.yaw_rad + scan.angle_min_rad + k * scan.angle_increment_rad
        end = sensor.x_m + length * math.cos(angle), sensor.y_m + length * math.sin(angle)
        column, row = spec.cell_of(*end)
        between = [(v - a) / 0.25 % 1.0 for v, a in zip(end, (x, y), strict=True)]
        if min(*between, *(1.0 - v for v in between)) < 1e-9:
            continue  # on a border, which side is a matter of rounding
        if 0 <= column < 9 and 0 <= row < 14:
            assert after == before
        else:
            assert math.isnan(after)

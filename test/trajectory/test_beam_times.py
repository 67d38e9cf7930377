"""When beams were taken, found from what they saw on a drive."""

import numpy as np
import pytest
from support.rooms import path_through, scans_at_times, scans_of

from ogm_mcmc.config import TrajectoryConfig
from ogm_mcmc.evaluation.trajectories import absolute_errors
from ogm_mcmc.geometry import PoseBelief
from ogm_mcmc.trajectory import TrajectoryRefinement, beam_times
from ogm_mcmc.trajectory.beam_times import (
    PRIOR_S,
    bent_points,
    clear_numbers,
    shown_times,
    velocities,
)
from ogm_mcmc.trajectory.curvature import widening
from ogm_mcmc.trajectory.factors import PoseFactors
from ogm_mcmc.trajectory.normal_equations import NormalEquations
from ogm_mcmc.trajectory.points import ScanPoints, poses_of
from ogm_mcmc.trajectory.surfels import Stage, SurfelSystem

COUNT, BEAMS, STEP_S = 12, 90, 0.1
TRUTH = path_through(COUNT)
TIMES = STEP_S * np.arange(COUNT)
ORDER = np.arange(COUNT)
STAGE = Stage(side_m=0.4, cut_m=0.06, flatness=0.2, steps=1)
SPREAD = np.diag(np.square((0.05, 0.05, 0.02)))
TURNS, SWEEP = 0.012, 0.02
AS_TOLD = 1.0, 0.0  # points scatter as the model says, speeds are sure


def refined(scans, start=TRUTH, times_s=TIMES, order=None, **settings):
    beliefs = [PoseBelief(pose, SPREAD) for pose in poses_of(start)]
    config = TrajectoryConfig(draws=2, **settings)
    placed = list(zip(scans, beliefs, strict=True))
    found = TrajectoryRefinement(placed, config, times_s=times_s, order=order)
    for _ in found.run():
        pass
    return found


@pytest.mark.parametrize('seconds', [(TURNS, 0.0), (-TURNS, SWEEP)])
def test_they_are_found_and_poses_get_better(seconds) -> None:
    scans = scans_at_times(TRUTH, BEAMS, 0.005, STEP_S, seconds)
    rng = np.random.default_rng(2)
    start = TRUTH + rng.normal(size=TRUTH.shape) * (0.04, 0.04, 0.015)
    found, without = refined(scans, start), refined(scans, start, beam_times=False)
    known = found.beam_times
    assert (known.deviations < 0.002).all()
    # How fast it was at a scan is only known from the scans around it.
    np.testing.assert_allclose(known.seconds, seconds, atol=0.0025)
    assert (known.seconds == 0.0).tolist() == [second == 0.0 for second in seconds]
    assert found.point_spread[1] < 0.8 * without.point_spread[1]
    better, worse = (absolute_errors(one.poses, TRUTH).turn_rad for one in (found, without))
    assert better.mean() < worse.mean()


def test_beams_taken_at_once_leave_everything_as_it_is() -> None:
    scans = scans_of(TRUTH, BEAMS, 0.01)
    found, without = refined(scans), refined(scans, times_s=None)
    assert found.speeds.any()
    assert (found.beam_times.deviations > 0.0).all()
    assert not found.beam_times.seconds.any()
    np.testing.assert_array_equal(found.poses, without.poses)
    np.testing.assert_array_equal(found.covariances(), without.covariances())
    assert np.isnan(without.beam_times.deviations).all()


def standing_first() -> np.ndarray:
    return np.concatenate((np.repeat(TRUTH[:1], 14, axis=0), TRUTH))


def straight_then_turning() -> np.ndarray:
    """0.6 m/s for 2 s, then 60 degrees/s on the spot."""
    way = np.column_stack((1.0 + 0.06 * np.arange(20), np.full(20, 2.2), np.zeros(20)))
    turns = np.repeat(way[-1:], 8, axis=0)
    turns[:, 2] = np.radians(6.0) * np.arange(1, 9)
    return np.concatenate((way, turns))


@pytest.mark.parametrize('drive', [standing_first, straight_then_turning])
def test_standing_or_straight_on_for_long_changes_nothing(drive) -> None:
    truth = drive()
    scans = scans_at_times(truth, 48, 0.005, STEP_S, (TURNS, 0.0))
    known = refined(scans, truth, STEP_S * np.arange(len(truth))).beam_times
    assert known.seconds[1] == 0.0
    assert abs(known.seconds[0] - TURNS) < 3.0 * known.deviations[0] < 0.006


def test_scans_seconds_apart_tell_nothing() -> None:
    """It went fast for a moment, which the time between scans does not show."""
    scans = scans_at_times(TRUTH, 60, 0.005, STEP_S, (TURNS, 0.0))
    found = refined(scans, times_s=3.0 * np.arange(COUNT))
    assert not found.beam_times.seconds.any()
    assert np.isnan(found.beam_times.deviations).all()


def test_even_beams_alone_say_nothing_of_turns() -> None:
    scans = scans_at_times(TRUTH, BEAMS, 0.005, STEP_S, (TURNS, 0.0))
    for scan in scans:
        scan.ranges_m[1::2] = np.nan
    assert refined(scans).beam_times.seconds[0] == 0.0


def test_one_step_solves_for_poses_and_both_numbers(monkeypatch) -> None:
    """The slow twin: all 3 K + 2 numbers in one dense system."""
    monkeypatch.setattr(beam_times, 'CLEAR', 3.0)
    scans = scans_at_times(TRUTH, BEAMS, 0.005, STEP_S, (TURNS, SWEEP))
    now = np.array([0.004, -0.003])
    speeds = velocities(TRUTH, ORDER, TIMES)
    speeds = speeds._replace(unsure=0.0 * speeds.found)
    points = bent_points(ScanPoints.of(scans), speeds.found, now)
    factors = PoseFactors.of([PoseBelief(p, SPREAD) for p in poses_of(TRUTH)], (1.0, 1.0, 1.0))
    system = SurfelSystem.around(points, TRUTH, STAGE)
    equations = NormalEquations.around(system, factors, TRUTH)
    found = shown_times(equations, points, TRUTH, speeds, now, 0.4, ORDER)
    columns = np.zeros((system.weight.size, 3 * COUNT + 2))
    for a, k in enumerate(system.scan):
        c, s = np.cos(TRUTH[k, 2]), np.sin(TRUTH[k, 2])
        vx, vy, turn = speeds.found[k] * speeds.known[k]
        columns[a, 3 * k : 3 * k + 3] = system.jacobian[a]
        rate = system.jacobian[a] @ (c * vx - s * vy, s * vx + c * vy, turn)
        columns[a, -2:] = rate * points.part[system.point[a]]
    centred = columns.copy()
    for v in np.unique(system.surfel):
        its = system.surfel == v
        centred[its] -= system.weight[its] @ columns[its] / system.weight[its].sum()
    precision = centred.T @ (system.weight[:, None] * centred)
    gradient = -centred.T @ (system.weight * system.residual)
    precision[: 3 * COUNT, : 3 * COUNT] += np.kron(np.eye(COUNT), factors.precision[0])
    precision[-2:, -2:] += np.eye(2) / PRIOR_S**2
    gradient[-2:] -= now / PRIOR_S**2
    expected = now + np.linalg.solve(precision, gradient)[-2:]
    np.testing.assert_allclose(found.seconds, expected, atol=2e-4)
    deviations = np.sqrt(np.diagonal(np.linalg.inv(precision))[-2:]) * widening(system, 0.4)
    np.testing.assert_allclose(found.deviations, deviations, rtol=0.02)
    vague = speeds._replace(unsure=0.4 * speeds.found)
    found = shown_times(equations, points, TRUTH, vague, now, 0.4, ORDER)
    assert not found.seconds.any()
    assert (found.deviations > 1.1 * deviations).all()


def test_stretches_that_disagree_are_in_the_deviations() -> None:
    """The jackknife of a mean is the usual standard error; scans that tell nothing change none."""
    rng = np.random.default_rng(0)
    seconds = 0.02 + 0.004 * rng.standard_normal((8, 2))
    precisions = 1e8 * np.tile(np.eye(2), (8, 1, 1))
    found = clear_numbers(precisions, 1e8 * seconds, *AS_TOLD)
    np.testing.assert_allclose(found.seconds, seconds.mean(axis=0), rtol=1e-6)
    expected = seconds.std(axis=0, ddof=1) / np.sqrt(8.0)
    np.testing.assert_allclose(found.deviations, expected, rtol=1e-5)
    standing = np.zeros((30, 2, 2))
    more = clear_numbers(
        np.concatenate((standing, precisions)),
        np.concatenate((standing[:, 0], 1e8 * seconds)),
        *AS_TOLD,
    )
    np.testing.assert_allclose(more.deviations, expected, rtol=1e-5)
    alike = clear_numbers(precisions, np.full((8, 2), 2e6), *AS_TOLD)
    np.testing.assert_allclose(alike.deviations, 1.0 / np.sqrt(8e8), rtol=1e-6)
    lone = clear_numbers(precisions[:1], np.full((1, 2), 2e6), *AS_TOLD)
    assert not lone.seconds.any()


def test_speed_is_told_by_the_scans_before_and_after() -> None:
    yaw = 0.5 * np.pi
    poses = np.array([(0.0, 0.0, yaw), (0.0, 0.4, yaw), (0.0, 1.0, yaw + 0.1)])
    times = np.array([0.0, 1.0, 2.0])
    found = velocities(poses, np.arange(3), times)
    np.testing.assert_allclose(found.found[:2], [(0.4, 0.0, 0.0), (0.5, 0.0, 0.05)], atol=1e-12)
    np.testing.assert_allclose(found.found[2], (0.6 * np.cos(0.1), -0.6 * np.sin(0.1), 0.1))
    # Anything between the step before and the one after: (b - a) / sqrt(12).
    np.testing.assert_allclose(found.unsure[1] * np.sqrt(12.0), (0.2, 0.0, 0.1), atol=1e-12)
    assert found.known.tolist() == [False, True, False]
    order = np.array([2, 0, 1])
    mixed = velocities(poses[[1, 2, 0]], order, times[[1, 2, 0]])
    for one, other in zip(mixed, found, strict=True):
        np.testing.assert_allclose(one[order], other)


def test_gaps_and_jumps_tell_no_speed() -> None:
    poses = np.zeros((20, 3))
    poses[:, 0] = 0.1 * np.arange(20)
    order, times = np.arange(20), 0.1 * np.arange(20)
    assert not velocities(poses, order, np.zeros(20)).found.any()
    late = velocities(poses, order, times + 100.0 * (order >= 10))
    np.testing.assert_allclose(late.found[:, 0], 1.0)
    assert np.flatnonzero(~late.known).tolist() == [0, 9, 10, 19]
    poses[10:, 1] += 30.0
    jump = velocities(poses, order, times)
    assert np.flatnonzero(~jump.known).tolist() == [0, 9, 10, 19]
    assert not jump.found[9:11].any()
    np.testing.assert_allclose(jump.found[:9], [(1.0, 0.0, 0.0)] * 9)


def test_the_way_a_map_is_turned_changes_no_speed() -> None:
    truth = straight_then_turning()
    order, times = np.arange(len(truth)), STEP_S * np.arange(len(truth))
    found = velocities(truth, order, times).found
    np.testing.assert_allclose(found[22:-1, 2], np.radians(60.0))
    turned = truth.copy()
    c, s = np.cos(1.0), np.sin(1.0)
    turned[:, 0], turned[:, 1] = (
        c * truth[:, 0] - s * truth[:, 1],
        s * truth[:, 0] + c * truth[:, 1],
    )
    turned[:, 2] += 1.0
    np.testing.assert_allclose(velocities(turned, order, times).found, found, atol=1e-9)


def test_scans_that_follow_fast_are_not_told_by_the_next() -> None:
    """40 a second: 2 mm of error in a pose are 8 cm/s from one to the next."""
    poses = np.zeros((40, 3))
    poses[:, 0] = 0.002 * (-1.0) ** np.arange(40)
    found = velocities(poses, np.arange(40), 0.025 * np.arange(40))
    assert np.abs(found.found[:, 0]).max() <= 0.004 / 0.08


@pytest.mark.parametrize('rate_hz', [0.5, 12.5, 25.0, 50.0, 75.0, 100.0])
def test_scans_at_a_steady_rate_tell_their_speeds(rate_hz) -> None:
    """Steps of just 0.08 s or 2 s, but for rounding: none is left out, all go equally far."""
    times = 1e-9 * np.rint(1e9 / rate_hz * np.arange(200))
    poses = np.zeros((200, 3))
    poses[:, 0] = 0.01 * times**2
    found = velocities(poses, np.arange(200), times)
    scans = int(np.ceil(0.08 * rate_hz - 1e-6))
    inner = slice(scans, -scans)
    assert found.known[inner].all()
    assert found.known.sum() == 200 - 2 * scans
    np.testing.assert_allclose(found.found[inner, 0], 0.02 * times[inner], rtol=1e-6)
    unsure = 0.02 * scans / rate_hz / np.sqrt(12.0)
    np.testing.assert_allclose(found.unsure[inner, 0], unsure, rtol=1e-6)

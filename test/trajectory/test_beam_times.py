"""When beams were taken, found from what they saw on a drive."""

import numpy as np
import pytest
from support.rooms import path_through, scans_at_times, scans_of

from ogm_mcmc.config import TrajectoryConfig
from ogm_mcmc.evaluation.trajectories import absolute_errors
from ogm_mcmc.geometry import PoseBelief
from ogm_mcmc.trajectory import TrajectoryRefinement
from ogm_mcmc.trajectory.beam_times import (
    CLEAR,
    PRIOR_S,
    bent_points,
    shown_times,
    velocities,
)
from ogm_mcmc.trajectory.curvature import widening
from ogm_mcmc.trajectory.factors import PoseFactors
from ogm_mcmc.trajectory.points import ScanPoints, poses_of
from ogm_mcmc.trajectory.surfels import Stage, SurfelSystem

COUNT, BEAMS, STEP_S = 12, 90, 0.1
TRUTH = path_through(COUNT)
TIMES = STEP_S * np.arange(COUNT)
ORDER = np.arange(COUNT)
STAGE = Stage(side_m=0.4, cut_m=0.06, flatness=0.2, steps=1)
SPREAD = np.diag(np.square((0.05, 0.05, 0.02)))
TURNS, SWEEP = 0.012, 0.02


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


def test_even_beams_alone_say_nothing_of_turns() -> None:
    scans = scans_at_times(TRUTH, BEAMS, 0.005, STEP_S, (TURNS, 0.0))
    for scan in scans:
        scan.ranges_m[1::2] = np.nan
    assert refined(scans).beam_times.seconds[0] == 0.0


def test_one_step_solves_for_poses_and_both_numbers() -> None:
    """The slow twin: all 3 K + 2 numbers in one dense system."""
    scans = scans_at_times(TRUTH, BEAMS, 0.005, STEP_S, (TURNS, SWEEP))
    now = np.array([0.004, -0.003])
    speeds = velocities(TRUTH, ORDER, TIMES)
    points = bent_points(ScanPoints.of(scans), speeds, now)
    factors = PoseFactors.of([PoseBelief(p, SPREAD) for p in poses_of(TRUTH)], (1.0, 1.0, 1.0))
    system = SurfelSystem.around(points, TRUTH, STAGE)
    found = shown_times(system, points, factors, TRUTH, speeds, now, 0.6)
    columns = np.zeros((system.weight.size, 3 * COUNT + 2))
    for a, k in enumerate(system.scan):
        c, s = np.cos(TRUTH[k, 2]), np.sin(TRUTH[k, 2])
        vx, vy, turn = speeds[k]
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
    deviations = np.sqrt(np.diagonal(np.linalg.inv(precision))[-2:]) * widening(system, 0.6)
    np.testing.assert_allclose(found.deviations, deviations, rtol=0.02)
    assert (np.abs(found.seconds) > CLEAR * found.deviations).all()


def test_speed_is_told_by_the_scans_before_and_after() -> None:
    yaw = 0.5 * np.pi
    poses = np.array([(0.0, 0.0, yaw), (0.0, 0.4, yaw), (0.0, 1.0, yaw + 0.1)])
    times = np.array([0.0, 1.0, 2.0])
    expected = [(0.4, 0.0, 0.0), (0.5, 0.0, 0.05)]
    np.testing.assert_allclose(velocities(poses, np.arange(3), times)[:2], expected, atol=1e-12)
    last = velocities(poses, np.arange(3), times)[2]
    np.testing.assert_allclose(last, (0.6 * np.cos(0.1), -0.6 * np.sin(0.1), 0.1))
    order = np.array([2, 0, 1])
    mixed = velocities(poses[[1, 2, 0]], order, times[[1, 2, 0]])
    np.testing.assert_allclose(mixed[order], velocities(poses, np.arange(3), times))


def test_a_gap_says_nothing_and_a_jump_little() -> None:
    poses = np.zeros((20, 3))
    poses[:, 0] = 0.1 * np.arange(20)
    times = 0.1 * np.arange(20)
    assert not velocities(poses, np.arange(20), np.zeros(20)).any()
    late = times + 100.0 * (np.arange(20) >= 10)
    assert (velocities(poses, np.arange(20), late)[:, 0] == 0.0).nonzero()[0].tolist() == [9, 10]
    poses[10:, 1] += 30.0
    found = velocities(poses, np.arange(20), times)
    np.testing.assert_allclose(found[:, 0], 1.0)
    assert np.abs(found[:, 1]).max() == pytest.approx(150.0)  # nobody else went that way
    poses[:, 1] += 0.01 * np.arange(20)
    assert velocities(poses, np.arange(20), times)[:, 1].max() == pytest.approx(1.0)

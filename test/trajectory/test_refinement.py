"""Refining a trajectory step by step: what comes out, and that it does not depend on stops."""

import numpy as np
import pytest
from support.rooms import drifted, path_through, scans_of

from ogm_mcmc.config import TrajectoryConfig
from ogm_mcmc.errors import ConfigError, WindowError
from ogm_mcmc.evaluation.trajectories import absolute_errors, coverage
from ogm_mcmc.geometry import PoseBelief
from ogm_mcmc.trajectory import Moves, TrajectoryRefinement
from ogm_mcmc.trajectory.moves import relative_poses
from ogm_mcmc.trajectory.points import poses_of

TRUTH = path_through(10)
SCANS = scans_of(TRUTH, 120, 0.01)
START = TRUTH + np.random.default_rng(2).normal(size=TRUTH.shape) * (0.05, 0.05, 0.02)
SPREAD = np.diag(np.square((0.05, 0.05, 0.02)))


def refinement(draws: int = 20) -> TrajectoryRefinement:
    beliefs = [PoseBelief(pose, SPREAD) for pose in poses_of(START)]
    config = TrajectoryConfig(draws=draws, seed=7)
    return TrajectoryRefinement(list(zip(SCANS, beliefs, strict=True)), config)


def test_poses_get_better_and_say_how_good_they_are() -> None:
    whole = refinement()
    progress = list(whole.run())
    assert progress[-1].doing == 'drawn'
    assert progress[-1].draws == 20
    assert absolute_errors(whole.poses, TRUTH).distance_m.mean() < 0.004
    beliefs = whole.beliefs()
    spread = np.array([np.sqrt(np.diag(belief.covariance)) for belief in beliefs])
    # All ten were off together by chance: that no scan can tell.
    assert (spread[:, :2] > 0.05 / np.sqrt(10.0) * 0.6).all()
    assert (spread[:, :2] < 0.05).all()
    assert (np.abs(whole.poses - TRUTH) < 4.0 * spread).all()
    low, found, high = whole.point_spread
    assert 0.0 < low < found < high
    assert high - found == pytest.approx(found - low)
    assert 0.2 < whole.held <= 1.0


def test_stopping_and_going_on_changes_nothing() -> None:
    whole, parts = refinement(4), refinement(4)
    expected = [one[:-1] for one in whole.run()]
    found = []
    while len(found) < len(expected):
        found += [one[:-1] for one in parts.run(max_time_s=0.0)]
    np.testing.assert_array_equal(parts.poses, whole.poses)
    np.testing.assert_array_equal(parts.covariances(), whole.covariances())
    assert found == expected


def test_covariances_are_unknown_before_there_are_draws() -> None:
    fresh = refinement()
    assert fresh.beliefs()[0].covariance is None
    assert fresh.point_spread is None
    assert fresh.belief_scale == 1.0
    np.testing.assert_allclose(fresh.poses, START)


def test_nothing_to_refine_is_refused() -> None:
    with pytest.raises(WindowError, match='expected at least one'):
        TrajectoryRefinement([])
    with pytest.raises(ConfigError, match='spread'):
        TrajectoryConfig(spread=0.0)


def test_a_shy_localizer_is_believed_more_than_it_says() -> None:
    beliefs = [PoseBelief(pose, 16.0 * SPREAD) for pose in poses_of(START)]
    placed = list(zip(SCANS, beliefs, strict=True))
    said = np.linalg.inv(16.0 * SPREAD + np.diag(np.square([1e-3, 1e-3, 1e-4])))
    for rescale in (True, False):
        config = TrajectoryConfig(draws=2, rescale=rescale, correlation=0.0)
        one = TrajectoryRefinement(placed, config)
        for _ in one.run():
            pass
        # Ten beliefs speak against ten more that are taken to be as sure as they say.
        ratio = one.factors.precision[0, 0, 0] / said[0, 0]
        assert one.belief_scale == pytest.approx(1.0 / ratio)
        assert ratio == pytest.approx(1.8 if rescale else 1.0, abs=0.3 * rescale)


def test_a_scan_whose_belief_is_vague_is_looked_up() -> None:
    """A particle filter may not know which way the robot looks: alignment alone is led astray."""
    vague = np.diag(np.square((0.2, 0.2, 0.3)))
    off = START.copy()
    off[6] = TRUTH[6] + (0.25, -0.2, 0.55)
    beliefs = [
        PoseBelief(pose, vague if k == 6 else SPREAD) for k, pose in enumerate(poses_of(off))
    ]
    one = TrajectoryRefinement(list(zip(SCANS, beliefs, strict=True)), TrajectoryConfig(draws=2))
    doing = [progress.doing for progress in one.run()]
    assert doing.count('looked up those astray') == 1
    assert len(doing) <= one.n_steps
    assert absolute_errors(one.poses, TRUTH).distance_m.max() < 0.03
    assert absolute_errors(one.poses, TRUTH).turn_rad.max() < 0.02


def few_beams(**settings: bool) -> float:
    """Return how far poses are off after six beams a scan moved them; 2 cm before."""
    truth = path_through(40)
    smooth = np.cumsum(np.random.default_rng(5).normal(size=truth.shape), axis=0)
    start = truth + (0.02, 0.02, 0.005) * smooth / np.abs(smooth).max(axis=0)
    placed = list(zip(scans_of(truth, 6, 0.02), map(PoseBelief, poses_of(start)), strict=True))
    one = TrajectoryRefinement(placed, TrajectoryConfig(draws=2, **settings))
    for _ in one.run():
        pass
    return float(absolute_errors(one.poses, truth).distance_m.mean())


def test_few_beams_do_not_tear_poses_from_what_the_localizer_says_of_the_way() -> None:
    assert few_beams(steps=True) < 0.015
    assert few_beams(steps=False) > 0.018


def test_poses_that_fit_few_beams_do_not_make_these_look_exact() -> None:
    """Four beams a scan decide nearly three numbers of it: they scatter less than they err."""
    truth = path_through(60)
    error = np.random.default_rng(3).normal(size=truth.shape) * (0.05, 0.05, 0.02)
    beliefs = [PoseBelief(pose, SPREAD) for pose in poses_of(truth + error)]
    placed = list(zip(scans_of(truth, 4, 0.02), beliefs, strict=True))
    one = TrajectoryRefinement(placed, TrajectoryConfig(draws=20, steps=False))
    for _ in one.run():
        pass
    assert one.point_spread[1] > 0.015  # 0.02 are true
    spread = np.sqrt(np.diagonal(one.covariances(), axis1=1, axis2=2))
    assert (coverage(one.poses - truth, spread) > 0.93).all()


def test_wheels_that_slip_do_not_bend_the_trajectory() -> None:
    """One step of odometry is half a metre and half a radian off: poses are as without it."""
    odometry = TRUTH.copy()
    odometry[5:] += (0.5, 0.0, 0.5)
    beliefs = [PoseBelief(pose, SPREAD) for pose in poses_of(START)]
    found = []
    for moves in (None, Moves.of_wheels(odometry, np.arange(10))):
        one = TrajectoryRefinement(
            list(zip(SCANS, beliefs, strict=True)), TrajectoryConfig(draws=2), moves=moves
        )
        for _ in one.run():
            pass
        found.append(absolute_errors(one.poses, TRUTH))
    assert found[1].distance_m.max() < found[0].distance_m.max() + 0.002
    assert found[1].turn_rad.max() < found[0].turn_rad.max() + 0.001


def test_odometry_alone_says_how_the_robot_went_and_not_where_it_is() -> None:
    """It ends 0.9 m astray, though it says that it is sure to 1 cm."""
    odometry = drifted(TRUTH, (0.05, 0.09, 0.03))
    assert np.hypot(*(odometry - TRUTH)[-1, :2]) > 0.8
    beliefs = [PoseBelief(pose, np.diag([1e-4, 1e-4, 1e-4])) for pose in poses_of(odometry)]
    placed = list(zip(SCANS, beliefs, strict=True))
    one = TrajectoryRefinement(placed, TrajectoryConfig(draws=2), drifting=True)
    assert len(list(one.run())) <= one.n_steps
    off = relative_poses(one.poses[:-1], one.poses[1:]) - relative_poses(TRUTH[:-1], TRUTH[1:])
    assert np.abs(off).max() < 0.03
    assert absolute_errors(one.poses, TRUTH).distance_m.max() < 0.03
    assert one.belief_scale == 1.0


def test_of_odometry_alone_the_map_as_a_whole_is_as_open_as_one_pose_is() -> None:
    placed = list(zip(SCANS, [PoseBelief(pose) for pose in poses_of(TRUTH)], strict=True))
    one = TrajectoryRefinement(placed, TrajectoryConfig(draws=200), drifting=True)
    for _ in one.run():
        pass
    spread = np.array(one.config.standard_deviations)
    from_middle = one.poses[:, :2] - one.poses[:, :2].mean(axis=0)
    swing = spread[2] * np.abs(from_middle[:, ::-1])
    expected = np.column_stack((np.hypot(spread[0], swing), np.full(len(TRUTH), spread[2])))
    found = np.sqrt(np.diagonal(one.covariances(), axis1=1, axis2=2))
    assert np.abs(found / expected - 1.0).max() < 0.2  # of 200 draws: four standard errors
    assert (one.covariances(apart=True)[:, 0, 0] < 0.01**2).all()


def test_drift_is_learned_and_widens_what_is_said_of_the_whole_map() -> None:
    """Beliefs that are off by the same shift: it stays, and intervals say that it may."""
    truth = path_through(24)
    start = truth + (0.05, 0.04, 0.0) + 1e-4 * np.random.default_rng(4).normal(size=truth.shape)
    beliefs = [PoseBelief(pose, SPREAD) for pose in poses_of(start)]
    placed = list(zip(scans_of(truth, 48, 0.01), beliefs, strict=True))
    spreads = {}
    for correlation in (0.0, -1.0):
        one = TrajectoryRefinement(placed, TrajectoryConfig(draws=20, correlation=correlation))
        for _ in one.run():
            pass
        off = np.abs(one.poses - truth)
        spreads[correlation] = np.sqrt([np.diag(belief.covariance) for belief in one.beliefs()])
        inside = (off < 1.96 * spreads[correlation])[:, :2].mean()
        assert inside > 0.9 if correlation else inside < 0.3
    assert (one.correlation > 0.8).all()
    assert (spreads[-1.0][:, :2] > 1.5 * spreads[0.0][:, :2]).all()
    assert (spreads[0.0][:, :2] < 0.02).all()

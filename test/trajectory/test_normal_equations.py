"""Points and factors solved together: against dense matrices, and in a room with known poses."""

import numpy as np
import pytest
from support.rooms import path_through, scans_of

from ogm_mcmc.evaluation.trajectories import absolute_errors
from ogm_mcmc.geometry import PoseBelief
from ogm_mcmc.trajectory.alike import Alike
from ogm_mcmc.trajectory.factors import PoseFactors
from ogm_mcmc.trajectory.normal_equations import NormalEquations, align
from ogm_mcmc.trajectory.points import ScanPoints, poses_of
from ogm_mcmc.trajectory.surfels import Stage, SurfelSystem

COUNT = 6
STAGE = Stage(side_m=0.4, cut_m=0.1, flatness=0.3, steps=1)
TRUTH = path_through(COUNT)
POINTS = ScanPoints.of(scans_of(TRUTH, 90, 0.01))


def factors_around(poses: np.ndarray, spread: tuple[float, float, float]) -> PoseFactors:
    return PoseFactors.of([PoseBelief(pose) for pose in poses_of(poses)], spread)


@pytest.mark.parametrize('correlation', [0.0, 0.9])
def test_solutions_are_those_of_the_matrix(correlation: float) -> None:
    system = SurfelSystem.around(POINTS, TRUTH, STAGE)
    factors = factors_around(TRUTH, (0.3, 0.3, 0.1))
    if correlation:
        factors = factors._replace(alike=Alike.in_order(np.arange(COUNT), correlation))
    equations = NormalEquations.around(system, factors, TRUTH)
    assert (equations.soft is None) == (correlation == 0.0)
    units = np.eye(3 * COUNT).reshape(-1, COUNT, 3)
    at = factors.linearised(TRUTH)
    matrix = np.array([(system.times(one) + factors.times(at, one)).ravel() for one in units]).T
    np.testing.assert_allclose(np.linalg.inv(equations.inverse), system.blocks + at.blocks)
    np.testing.assert_array_equal(equations.gradient, system.gradient + at.gradient)
    right = np.random.default_rng(0).normal(size=(COUNT, 3))
    np.testing.assert_allclose(equations.times(right).ravel(), matrix @ right.ravel())
    found = equations.solve(right, most=200, accuracy=1e-9)
    expected = np.linalg.solve(matrix, right.ravel())
    np.testing.assert_allclose(found.ravel(), expected, rtol=1e-5, atol=1e-9)


@pytest.mark.parametrize('noise_m', [0.0, 0.01])
def test_perturbed_poses_find_their_way_back(noise_m: float) -> None:
    points = ScanPoints.of(scans_of(TRUTH, 180, noise_m))
    start = TRUTH + np.random.default_rng(2).normal(size=TRUTH.shape) * (0.05, 0.05, 0.02)
    factors, poses = factors_around(start, (0.3, 0.3, 0.1)), start
    for stage in (STAGE, STAGE._replace(side_m=0.2, cut_m=0.04)):
        for _ in range(8):
            poses, equations = align(points, poses, factors, stage)
    before, after = absolute_errors(start, TRUTH), absolute_errors(poses, TRUTH)
    assert before.distance_m.mean() > 0.04
    assert after.distance_m.mean() < 0.002 + 0.2 * noise_m
    assert np.degrees(after.turn_rad.mean()) < 0.1
    if noise_m:
        # Across a wall the noise of a range counts in part only.
        assert 0.4 * noise_m < np.sqrt(equations.system.variance) < 1.3 * noise_m


def test_scans_that_share_nothing_stay_as_believed() -> None:
    apart = np.array([(0.0, 0.0, 0.0), (100.0, 0.0, 0.0)])
    points = ScanPoints.of(scans_of(TRUTH[:2], 2, 0.0))
    poses, _ = align(points, apart, factors_around(apart, (0.3, 0.3, 0.1)), STAGE)
    np.testing.assert_allclose(poses, apart)

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.strategies import REPEATABLE, poses

from ogm_mcmc.errors import PoseError
from ogm_mcmc.geometry import (
    Pose2D,
    PoseBelief,
    PoseSamples,
    SensorMount,
    interpolate,
    pose_from_quaternion,
    wrap_angle,
)

approx = pytest.approx


def as_matrix(pose):
    c, s = math.cos(pose.yaw_rad), math.sin(pose.yaw_rad)
    return np.array([[c, -s, pose.x_m], [s, c, pose.y_m], [0.0, 0.0, 1.0]])


def quaternion(axis, angle):
    """x, y, z, w of a turn around an axis."""
    axis = np.asarray(axis) / np.linalg.norm(axis)
    return (*(math.sin(angle / 2) * axis).tolist(), math.cos(angle / 2))


def product(p, q):
    """Hamilton product of quaternions x, y, z, w: the turn q, then p."""
    (a, b, c, d), (e, f, g, h) = p, q
    return (
        d * e + a * h + b * g - c * f,
        d * f - a * g + b * h + c * e,
        d * g + a * f - b * e + c * h,
        d * h - a * e - b * f - c * g,
    )


@given(angle=st.floats(-50.0, 50.0))
@REPEATABLE
def test_wrapped_angle_is_the_same_direction(angle):
    wrapped = wrap_angle(angle)
    assert -math.pi <= wrapped <= math.pi
    assert math.cos(wrapped - angle) == approx(1.0)


def test_half_a_turn_wraps_to_minus_pi():
    assert wrap_angle(math.pi) == wrap_angle(-math.pi) == -math.pi


def test_compose_by_hand():
    """A quarter turn to the left, then two metres ahead is two metres up."""
    robot, ahead = Pose2D(1.0, 2.0, math.pi / 2), Pose2D(2.0, 0.0, math.pi / 2)
    assert robot.compose(ahead).x_m == approx(1.0)
    assert robot.compose(ahead).y_m == approx(4.0)
    assert abs(robot.compose(ahead).yaw_rad) == approx(math.pi)


@given(a=poses(), b=poses())
@REPEATABLE
def test_compose_and_inverse_are_those_of_matrices(a, b):
    assert as_matrix(a.compose(b)) == approx(as_matrix(a) @ as_matrix(b), abs=1e-9)
    assert as_matrix(a.inverse()) == approx(np.linalg.inv(as_matrix(a)), abs=1e-9)
    assert as_matrix(a.inverse().compose(a.compose(b))) == approx(as_matrix(b), abs=1e-9)


@pytest.mark.parametrize('bad', [(math.nan, 0, 0), (0, math.inf, 0), (0, 0, math.nan)])
def test_a_pose_is_finite(bad):
    with pytest.raises(PoseError, match='expected finite numbers'):
        Pose2D(*bad)


def test_interpolation_turns_the_short_way_round():
    a, b = Pose2D(0.0, 0.0, math.radians(170)), Pose2D(4.0, -8.0, math.radians(-170))
    quarter = interpolate(a, b, 0.25)
    assert (quarter.x_m, quarter.y_m) == (1.0, -2.0)
    assert math.degrees(quarter.yaw_rad) == approx(175)
    assert math.degrees(interpolate(a, b, 0.75).yaw_rad) == approx(-175)
    assert math.degrees(interpolate(b, a, 0.25).yaw_rad) == approx(-175)


@given(a=poses(), b=poses(), fraction=st.floats(0.0, 1.0))
@REPEATABLE
def test_interpolation_starts_and_ends_at_the_poses(a, b, fraction):
    assert as_matrix(interpolate(a, b, 0.0)) == approx(as_matrix(a), abs=1e-9)
    assert as_matrix(interpolate(a, b, 1.0)) == approx(as_matrix(b), abs=1e-9)
    there, back = interpolate(a, b, fraction), interpolate(b, a, 1.0 - fraction)
    assert (there.x_m, there.y_m) == approx((back.x_m, back.y_m), abs=1e-9)
    turned = abs(wrap_angle(there.yaw_rad - a.yaw_rad))
    assert turned <= abs(wrap_angle(b.yaw_rad - a.yaw_rad)) + 1e-9


def test_samples_get_equal_weights_or_normalised_ones():
    three = [[0, 0, 0], [1, 0, 0], [2, 0, 0]]
    assert PoseSamples.checked(three).weights.tolist() == approx([1 / 3] * 3)
    assert PoseSamples.checked(three, [1, 2, 5]).weights.tolist() == approx([1 / 8, 1 / 4, 5 / 8])


@pytest.mark.parametrize(
    ('samples', 'weights', 'message'),
    [
        ([], None, 'particles: expected at least one, got none'),
        ([[0, 0, math.nan]], None, 'particles: expected finite poses'),
        ([[0, 0, 0]], [1, 1], 'weights: expected one per particle'),
        ([[0, 0, 0]], [0], 'a positive sum, got 0.0'),
        ([[0, 0, 0]], [math.inf], 'a positive sum, got inf'),
        ([[0, 0, 0]], [math.nan], 'a positive sum, got nan'),
        ([[0, 0, 0], [1, 1, 1]], [2, -1], 'weights: expected none below 0, got -1'),
    ],
)
def test_samples_refused(samples, weights, message):
    with pytest.raises(PoseError, match=message):
        PoseSamples.checked(samples, weights)


def test_mean_and_covariance_by_hand():
    samples = PoseSamples.checked([[0, 0, 0.1], [4, 8, 0.5]], [3, 1])
    mean = samples.mean()
    assert (mean.x_m, mean.y_m) == (1.0, 2.0)
    # 1/4 of (3, 6) and 3/4 of (-1, -2), squared: 9/4 + 3/4, 18/4 + 6/4, 36/4 + 12/4.
    assert samples.covariance()[:2, :2] == approx(np.array([[3.0, 6.0], [6.0, 12.0]]))


def test_mean_and_covariance_across_the_seam():
    """Headings of 175 and -175 degrees: five degrees of deviation around 180, not 175 around 0."""
    samples = PoseSamples.checked([[0, 0, math.radians(175)], [0, 0, math.radians(-175)]])
    assert abs(samples.mean().yaw_rad) == approx(math.pi)
    assert samples.covariance()[2, 2] == approx(math.radians(5) ** 2)


@given(mounted=poses(3.0), seed=st.integers(0, 99))
@REPEATABLE
def test_moved_samples_are_composed_one_by_one(mounted, seed):
    samples = PoseSamples.checked(np.random.default_rng(seed).uniform(-3, 3, (4, 3)))
    moved = samples.moved(mounted)
    for before, after in zip(samples.poses, moved.poses, strict=True):
        expected = Pose2D(*before).compose(mounted)
        assert as_matrix(Pose2D(*after)) == approx(as_matrix(expected), abs=1e-9)
    assert moved.weights is samples.weights


def test_moved_belief_knows_nothing_more_than_before():
    moved = PoseBelief(Pose2D(1.0, 0.0, 0.0)).moved(Pose2D(2.0, 0.0, 0.5))
    assert moved == PoseBelief(Pose2D(3.0, 0.0, 0.5), offset=Pose2D(2.0, 0.0, 0.5))


def test_moved_covariance_by_hand():
    """A sensor 2 m ahead swings sideways by 2 m per radian of the robot's turn."""
    covariance = np.diag([0.01, 0.02, 0.04])
    moved = PoseBelief(Pose2D(), covariance).moved(Pose2D(2.0, 0.0, 0.0)).covariance
    assert moved == approx(np.array([[0.01, 0, 0], [0, 0.02 + 4 * 0.04, 0.08], [0, 0.08, 0.04]]))


@given(robot=poses(), mounted=poses(3.0))
@REPEATABLE
def test_moved_covariance_is_first_order_propagation(robot, mounted):
    """The Jacobian of composing, by central differences."""
    root = np.array([[0.3, 0.0, 0.0], [-0.1, 0.2, 0.0], [0.05, -0.02, 0.1]])
    jacobian, h = np.empty((3, 3)), 1e-5
    for k in range(3):
        step = h * np.eye(3)[k]
        ahead, behind = (
            Pose2D(robot.x_m + d[0], robot.y_m + d[1], robot.yaw_rad + d[2]).compose(mounted)
            for d in (step, -step)
        )
        turn = wrap_angle(ahead.yaw_rad - behind.yaw_rad)
        difference = ahead.x_m - behind.x_m, ahead.y_m - behind.y_m, turn
        jacobian[:, k] = np.array(difference) / (2 * h)
    expected = jacobian @ root @ root.T @ jacobian.T
    moved = PoseBelief(robot, root @ root.T).moved(mounted).covariance
    assert moved == approx(expected, abs=1e-6)


def test_moved_covariance_agrees_with_moved_particles():
    """Monte Carlo: 200 000 particles, narrow enough in heading for first order to hold."""
    rng = np.random.default_rng(11)
    robot, mounted = Pose2D(3.0, -1.0, 2.0), Pose2D(0.8, -0.5, 1.0)
    root = np.array([[0.1, 0.0, 0.0], [0.05, 0.08, 0.0], [0.01, -0.02, 0.03]])
    mean = np.array([robot.x_m, robot.y_m, robot.yaw_rad])
    cloud = PoseSamples.checked(mean + rng.standard_normal((200_000, 3)) @ root.T)
    moved = PoseBelief(robot, root @ root.T, cloud).moved(mounted)
    # Standard error of a variance of 0.016 from 200 000 draws: 5e-5; second order: 4e-6.
    assert moved.particles.covariance() == approx(moved.covariance, abs=2.5e-4)
    assert moved.particles.mean().y_m == approx(moved.mean.y_m, abs=2e-3)


@given(yaw=st.floats(-math.pi, math.pi), sign=st.sampled_from([1.0, -1.0]))
@REPEATABLE
def test_quaternion_of_an_upright_frame(yaw, sign):
    q = tuple(sign * part for part in quaternion((0, 0, 1), yaw))
    pose, upside_down = pose_from_quaternion((1.5, -2.5), q)
    assert (pose.x_m, pose.y_m, upside_down) == (1.5, -2.5, False)
    assert math.cos(pose.yaw_rad - yaw) == approx(1.0)


@given(
    yaw=st.floats(-math.pi, math.pi),
    bearing=st.floats(-math.pi, math.pi),
    flip=st.floats(0.0, math.pi),
)
@REPEATABLE
def test_quaternion_of_an_upside_down_frame(yaw, bearing, flip):
    """Turned over around any axis in its plane; a beam goes where the rotation sends it."""
    over = quaternion((math.cos(flip), math.sin(flip), 0.0), math.pi)
    pose, upside_down = pose_from_quaternion((0.0, 0.0), product(quaternion((0, 0, 1), yaw), over))
    assert upside_down
    # Mirrored at the axis `flip`, then turned by yaw.
    heading = yaw + 2.0 * flip - bearing
    assert math.cos(pose.yaw_rad - bearing - heading) == approx(1.0)


@pytest.mark.parametrize('degrees', [8.0, 172.0])
def test_a_little_tilt_is_allowed(degrees):
    tilted = quaternion((1, 0, 0), math.radians(degrees))
    _, upside_down = pose_from_quaternion((0.0, 0.0), tilted)
    assert upside_down == (degrees > 90.0)


@pytest.mark.parametrize(('degrees', 'said'), [(12.0, 12), (45.0, 45), (90.0, 90), (135.0, 45)])
def test_a_tilted_frame_is_refused(degrees, said):
    with pytest.raises(PoseError, match=f'tilted by {said} degrees'):
        pose_from_quaternion((0.0, 0.0), quaternion((0.3, 1, 0), math.radians(degrees)))


@pytest.mark.parametrize('q', [(0, 0, 0, 0), (0, 0, 0, 2), (math.nan, 0, 0, 1)])
def test_a_quaternion_has_unit_length(q):
    with pytest.raises(PoseError, match='expected unit length'):
        pose_from_quaternion((0.0, 0.0), q)


def test_a_slightly_long_quaternion_is_normalised():
    pose, _ = pose_from_quaternion((0.0, 0.0), (0.0, 0.0, 1.005 * 0.6, 1.005 * 0.8))
    assert math.cos(pose.yaw_rad) == approx(0.8**2 - 0.6**2)


def test_mount_is_upright_at_the_centre_unless_said_otherwise():
    assert SensorMount() == SensorMount(Pose2D(0.0, 0.0, 0.0), upside_down=False)


def test_a_belief_knows_the_way_back_to_the_robot():
    robot = PoseBelief(Pose2D(1.0, 2.0, 0.5), np.diag([0.01, 0.02, 0.003]))
    sensor = robot.moved(Pose2D(0.2, 0.1, 1.0)).moved(Pose2D(0.0, 0.3, -0.4))
    back = sensor.of_robot()
    assert back.mean.x_m == pytest.approx(1.0)
    assert back.mean.y_m == pytest.approx(2.0)
    assert back.mean.yaw_rad == pytest.approx(0.5)
    np.testing.assert_allclose(back.covariance, robot.covariance, atol=1e-12)
    assert back.of_robot().mean == back.mean

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.strategies import REPEATABLE

from ogm_mcmc.errors import PoseError
from ogm_mcmc.geometry import Pose2D, interpolate
from ogm_mcmc.geometry.rigid_transform import RigidTransform

approx = pytest.approx
HALF = math.sqrt(0.5)

numbers = st.floats(-100.0, 100.0)
quaternions = (
    st.tuples(*[st.floats(-1.0, 1.0)] * 4)
    .filter(lambda q: math.hypot(*q) > 0.1)
    .map(lambda q: tuple(value / math.hypot(*q) for value in q))
)
transforms = st.builds(RigidTransform.checked, st.tuples(*[numbers] * 3), quaternions)


def matrix(transform):
    """The same as 4 x 4 matrix, by the textbook."""
    x, y, z, w = transform.quaternion
    result = np.eye(4)
    result[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    result[:3, 3] = transform.translation
    return result


def yawed(x, y, yaw):
    return RigidTransform((x, y, 0.0), (0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)))


@REPEATABLE
@given(transforms, transforms)
def test_composing_is_the_product_of_matrices(a, b):
    np.testing.assert_allclose(matrix(a.compose(b)), matrix(a) @ matrix(b), atol=1e-9)


@REPEATABLE
@given(transforms)
def test_the_inverse_undoes(a):
    np.testing.assert_allclose(matrix(a.compose(a.inverse())), np.eye(4), atol=1e-9)


@REPEATABLE
@given(transforms, transforms, st.floats(0.0, 1.0))
def test_on_the_way_the_turn_is_even(a, b, fraction):
    between = a.towards(b, fraction)
    np.testing.assert_allclose(
        between.translation,
        [p + fraction * (q - p) for p, q in zip(a.translation, b.translation, strict=True)],
        atol=1e-9,
    )
    whole = angle(a.quaternion, b.quaternion)
    assert angle(a.quaternion, between.quaternion) == approx(fraction * whole, abs=1e-6)
    assert angle(between.quaternion, b.quaternion) == approx((1 - fraction) * whole, abs=1e-6)


def angle(p, q):
    """Angle between two turns, by the difference of the quaternions (exact for small ones)."""
    apart = min(math.dist(p, q), math.dist(p, [-value for value in q]))
    return 4.0 * math.asin(min(apart / 2.0, 1.0))


@REPEATABLE
@given(numbers, numbers, st.floats(-3.1, 3.1), st.floats(-3.0, 3.0), st.floats(0.0, 1.0))
def test_in_the_plane_it_is_what_poses_do(x, y, yaw, turn, fraction):
    a, b = Pose2D(x, y, yaw), Pose2D(y, x, yaw + turn)
    expected = interpolate(a, b, fraction)
    got, upside_down = (
        yawed(a.x_m, a.y_m, a.yaw_rad).towards(yawed(b.x_m, b.y_m, b.yaw_rad), fraction).planar()
    )
    assert (got.x_m, got.y_m) == approx((expected.x_m, expected.y_m), abs=1e-9)
    assert math.remainder(got.yaw_rad - expected.yaw_rad, 2 * math.pi) == approx(0.0, abs=1e-9)
    assert not upside_down


def test_a_quarter_turn_by_hand():
    on_robot = RigidTransform((1.0, 0.0, 0.5))
    robot = RigidTransform((10.0, 20.0, 0.0), (0.0, 0.0, HALF, HALF))
    assert robot.compose(on_robot).translation == approx((10.0, 21.0, 0.5))


def test_head_down_twice_is_upright():
    """A bracket rolled over that carries a laser rolled over."""
    rolled = RigidTransform((0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))
    assert rolled.planar()[1]
    assert rolled.compose(rolled).planar() == (Pose2D(0.0, 0.0, 0.0), False)


def test_tilted_frames_may_make_a_level_one():
    tilt = RigidTransform((0.0, 0.0, 0.0), (0.0, math.sin(0.2), 0.0, math.cos(0.2)))
    with pytest.raises(PoseError, match='tilted by 23 degrees'):
        tilt.planar()
    assert tilt.compose(tilt.inverse()).planar()[0] == Pose2D()


@pytest.mark.parametrize(
    ('translation', 'quaternion', 'message'),
    [
        ((0.0, math.nan, 0.0), (0.0, 0.0, 0.0, 1.0), 'expected finite numbers'),
        ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0), 'expected unit length, got 0'),
        ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.02), 'expected unit length, got 1.02'),
    ],
)
def test_what_is_no_transform_is_refused(translation, quaternion, message):
    with pytest.raises(PoseError, match=message):
        RigidTransform.checked(translation, quaternion)


def test_a_rounded_quaternion_is_normalised():
    turned = RigidTransform.checked((0.0, 0.0, 0.0), (0.0, 0.0, 0.7071, 0.7071))
    assert math.hypot(*turned.quaternion) == approx(1.0, abs=1e-15)

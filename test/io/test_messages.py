"""Messages of rclpy's shape (plain attributes) and of the rosbags library."""

import array
import math
from types import SimpleNamespace

import numpy as np
import pytest

from ogm_mcmc.errors import PoseError, ScanError
from ogm_mcmc.geometry import Pose2D
from ogm_mcmc.io import ros_types
from ogm_mcmc.io.messages import (
    frame_of,
    plain_frame,
    read_particles,
    read_path,
    read_pose,
    read_range,
    read_scan,
    stamp_of,
    time_parts,
)


def plain(message):
    """Return the rclpy look-alike: plain attributes, sequences as array.array."""
    if hasattr(message, '__dataclass_fields__'):
        names = [name for name in message.__dataclass_fields__ if name != '__msgtype__']
        return SimpleNamespace(**{name: plain(getattr(message, name)) for name in names})
    if isinstance(message, list):
        return [plain(member) for member in message]
    if isinstance(message, np.ndarray) and message.dtype == np.float32:
        return array.array('f', message.tolist())
    return message


@pytest.fixture(params=[lambda message: message, plain], ids=['rosbags', 'rclpy'])
def shape(request):
    return request.param


def stamped(x, y, z, w, position=(1.0, 2.0)):
    """Make a geometry_msgs/PoseStamped look-alike."""
    return SimpleNamespace(
        pose=SimpleNamespace(
            position=SimpleNamespace(x=position[0], y=position[1], z=9.0),
            orientation=SimpleNamespace(x=x, y=y, z=z, w=w),
        )
    )


def test_stamps_and_frames(make_scan, shape):
    stamp_ns = 1_134_864_629 * 10**9 + 895_182_001
    message = shape(make_scan(stamp_ns, frame='/laser'))
    assert time_parts(stamp_ns) == (1_134_864_629, 895_182_001)
    assert stamp_of(message) == stamp_ns
    assert frame_of(message) == 'laser'


def test_read_scan(make_scan, shape):
    ranges = [1.25, math.inf, math.nan, -math.inf, 0.0]
    scan = read_scan(shape(make_scan(7, ranges=ranges, frame='/laser', range_min=0.25)))
    assert scan.ranges_m.dtype == np.float32
    assert np.array_equal(scan.ranges_m, np.array(ranges, np.float32), equal_nan=True)
    assert (scan.angle_min_rad, scan.angle_increment_rad) == (-1.0, 0.5)
    assert (scan.range_min_m, scan.range_max_m) == (0.25, 10.0)
    assert (scan.stamp_ns, scan.frame_id) == (7, 'laser')


def test_scan_is_a_copy(make_scan):
    message = make_scan(7)
    scan = read_scan(message)
    message.ranges[:] = 5.0
    assert scan.ranges_m[0] == 1.0
    assert scan.ranges_m.flags.writeable


@pytest.mark.parametrize('last', [0.5, 1.0, 1.5])
def test_last_angle_may_be_one_beam_off(make_scan, shape, last):
    assert read_scan(shape(make_scan(7, angle_max=last))).ranges_m.size == 5


def test_clockwise_and_single_beams_are_fine(make_scan, shape):
    clockwise = read_scan(shape(make_scan(7, angle_increment=-0.5, angle_max=-3.0)))
    assert clockwise.angle_increment_rad == -0.5
    single = make_scan(7, ranges=[2.0], angle_increment=0.0, angle_max=-1.0)
    assert read_scan(shape(single)).ranges_m.tolist() == [2.0]


@pytest.mark.parametrize(
    ('fields', 'reason'),
    [
        ({'ranges': np.zeros(0, np.float32)}, 'ranges: expected at least one beam, got 0'),
        ({'ranges': np.zeros(50, np.float32)}, 'ranges: 50 of them'),
        ({'angle_increment': 0.0}, 'angle_increment is 0 with 5 ranges'),
        ({'angle_increment': -0.5}, 'wrong sign'),
        ({'angle_increment': math.inf}, 'expected finite numbers'),
        ({'angle_min': math.nan}, 'angle_min nan'),
        ({'range_min': -0.5}, 'range_min -0.5'),
        ({'range_max': 0.0}, 'range_max 0.0'),
        ({'range_max': math.nan}, 'range_max nan: expected 0 <= range_min < range_max'),
    ],
)
def test_scan_that_contradicts_itself(make_scan, shape, fields, reason):
    message = make_scan(7)
    for name, value in fields.items():
        setattr(message, name, value)
    with pytest.raises(ScanError, match=reason):
        read_scan(shape(message))


def test_a_reading_of_range_max_is_no_return(make_scan, shape):
    """And one float32 step beside it; a millimetre before it there is something."""
    # 3.3 and 5.6 are no float32: the header's digits may be more than those of the readings.
    for furthest in (3.5, 3.3, 5.6, float(np.float32(5.6)), 81.91):
        own = np.float32(furthest)
        beside = [np.nextafter(own, np.float32(0.0)), np.nextafter(own, np.float32(np.inf))]
        ranges = [1.0, furthest, *beside, furthest - 0.001, math.nan]
        scan = read_scan(shape(make_scan(7, ranges=ranges, range_max=furthest, angle_max=1.5)))
        expected = np.array([1.0, *[math.inf] * 3, furthest - 0.001, math.nan], np.float32)
        assert np.array_equal(scan.ranges_m, expected, equal_nan=True)


def test_a_sensor_without_range_max(make_scan, shape):
    scan = read_scan(shape(make_scan(7, range_max=math.inf)))
    assert scan.range_max_m == math.inf
    assert scan.ranges_m.tolist() == [1.0, 2.0, math.inf, 3.0, 4.0]


@pytest.mark.parametrize('angle_max', [2.0, -1.0, math.nan, math.inf])
def test_count_that_disagrees_with_the_header_is_remarked(make_scan, shape, angle_max):
    remarks = []
    scan = read_scan(shape(make_scan(7, angle_max=angle_max)), remarks.append)
    assert (scan.angle_min_rad, scan.angle_increment_rad, scan.ranges_m.size) == (-1.0, 0.5, 5)
    assert len(remarks) == 1
    assert 'angle_min and angle_increment are used' in remarks[0]


def test_times_of_a_scan(make_scan, shape):
    scan = read_scan(shape(make_scan(7, time_increment=0.001, scan_time=0.1)))
    assert (scan.time_increment_s, scan.scan_time_s) == (0.001, 0.1)
    assert read_scan(shape(make_scan(7, time_increment=-0.001))).time_increment_s == 0.0


def test_read_pose_with_covariance(make_pose, shape):
    message = make_pose(7, x=1.5, y=-2.5, yaw=-3.0)
    full = np.arange(36.0).reshape(6, 6)
    for row, column, value in [(0, 0, 2), (1, 1, 3), (5, 5, 1), (0, 1, 0.5), (0, 5, 0.25)]:
        full[row, column] = full[column, row] = value
    full[1, 5] = full[5, 1] = -0.125
    message.pose.covariance = full.reshape(36)
    belief = read_pose(shape(message))
    assert (belief.mean.x_m, belief.mean.y_m) == (1.5, -2.5)
    assert belief.mean.yaw_rad == pytest.approx(-3.0)
    expected = [[2, 0.5, 0.25], [0.5, 3, -0.125], [0.25, -0.125, 1]]
    assert belief.covariance.tolist() == expected


def test_read_odometry(shape):
    message = ros_types.odometry(7, Pose2D(1.5, 2.5, 0.5), 0.0, 0.0)
    belief = read_pose(shape(message))
    assert belief.mean.x_m == 1.5
    assert belief.mean.yaw_rad == pytest.approx(0.5)
    assert not belief.covariance.any()


def test_read_pose_stamped():
    belief = read_pose(stamped(0.0, 0.0, math.sin(0.5), math.cos(0.5)))
    assert (belief.mean.x_m, belief.mean.y_m) == (1.0, 2.0)
    assert belief.mean.yaw_rad == pytest.approx(1.0)
    assert belief.covariance is None
    assert belief.particles is None


def test_quaternion_is_normalised_and_may_be_negated():
    by_sign = [read_pose(stamped(0, 0, s * 0.6045, s * 0.8045)) for s in (1, -1)]
    assert by_sign[0].mean.yaw_rad == pytest.approx(2 * math.atan2(0.6045, 0.8045))
    assert by_sign[1].mean.yaw_rad == pytest.approx(by_sign[0].mean.yaw_rad)


@pytest.mark.parametrize(
    ('quaternion', 'reason'),
    [
        ((0, 0, 0, 0), 'unit length'),
        ((0, 0, 0, 1.02), 'unit length'),
        ((0, 0, math.nan, 1), 'finite'),
        ((0, 0, 0, math.inf), 'finite'),
        ((math.sin(0.2), 0, 0, math.cos(0.2)), 'tilted by 23 degrees'),
        ((1, 0, 0, 0), 'upside down'),
    ],
)
def test_orientation_that_is_no_heading(quaternion, reason):
    with pytest.raises(PoseError, match=reason):
        read_pose(stamped(*quaternion))


def test_position_that_is_nowhere():
    for position in ((math.nan, 0.0), (0.0, math.inf)):
        with pytest.raises(PoseError, match='expected finite'):
            read_pose(stamped(0, 0, 0, 1, position))


@pytest.mark.parametrize(('lowest', 'fine'), [(-1e-12, True), (-1e-6, False), (-1.0, False)])
def test_covariance_may_be_negative_by_rounding_only(make_pose, shape, lowest, fine):
    message = shape(make_pose(7, variances=(0.5, lowest, 0.5)))
    if fine:
        assert read_pose(message).covariance[1, 1] == lowest
    else:
        with pytest.raises(PoseError, match='positive semi-definite'):
            read_pose(message)


@pytest.mark.parametrize('value', [math.nan, math.inf, -math.inf, 1e308, -1e308, 2e6])
def test_covariance_that_says_nothing(make_pose, shape, value):
    message = make_pose(7, x=1.0)
    message.pose.covariance[5 * 6 + 5] = value
    with pytest.raises(PoseError, match=r'covariance of x, y, yaw has .* expected finite'):
        read_pose(shape(message))
    belief = read_pose(shape(message), with_covariance=False)
    assert belief[:3] == (Pose2D(1.0, 0.0, 0.0), None, None)


@pytest.mark.parametrize('where', [1.1e7, -1.1e7, 1e308, math.nan, math.inf])
def test_pose_further_than_any_robot_goes(make_pose, shape, where):
    message = make_pose(7)
    message.pose.pose.position.y = where
    with pytest.raises(PoseError, match=r'position .*: expected finite numbers up to 1e\+07 m'):
        read_pose(shape(message))


def test_read_particles(shape):
    poses = np.array([[1.0, 2.0, 3.0], [1.5, 2.5, -3.0], [0.5, 1.5, 3.1]])
    belief = read_particles(shape(ros_types.pose_array(7, 'map', poses)))
    assert belief.particles.poses == pytest.approx(poses)
    assert belief.particles.weights.tolist() == pytest.approx([1 / 3] * 3)
    assert (belief.mean.x_m, belief.mean.y_m) == pytest.approx((1.0, 2.0))
    mean_yaw = (3.0 + (2 * math.pi - 3.0) + 3.1) / 3
    assert belief.mean.yaw_rad % (2 * math.pi) == pytest.approx(mean_yaw, abs=1e-3)
    assert belief.covariance[0, 0] == pytest.approx(1 / 6)


def test_particles_that_cannot_be_used(shape):
    with pytest.raises(PoseError, match='at least one, got none'):
        read_particles(shape(ros_types.pose_array(7, 'map', np.zeros((0, 3)))))
    message = ros_types.pose_array(7, 'map', np.zeros((3, 3)))
    message.poses[1].position.y = math.nan
    with pytest.raises(PoseError, match='finite'):
        read_particles(shape(message))


# -- sonars and weighted particles --------------------------------------------------------------


def ranged(reading, shape, **changes):
    fields = {'field_of_view': 0.5, 'range_min': 0.1, 'range_max': 4.0, **changes}
    return shape(ros_types.range_reading(5_000_000_007, 'sonar_3', reading, **fields))


def test_read_range(shape):
    scan = read_range(ranged(1.25, shape))
    assert scan.ranges_m.tolist() == [1.25]
    assert (scan.range_min_m, scan.range_max_m, scan.beam_width_rad) == (0.1, 4.0, 0.5)
    assert (scan.stamp_ns, scan.frame_id, scan.angle_min_rad) == (5_000_000_007, 'sonar_3', 0.0)


@pytest.mark.parametrize('reading', [4.0, float(np.nextafter(np.float32(4), 0)), math.inf])
def test_no_echo(shape, reading):
    assert read_range(ranged(reading, shape)).ranges_m.tolist() == [math.inf]


@pytest.mark.parametrize(
    ('changes', 'message'),
    [
        ({'field_of_view': math.nan}, 'beam width nan'),
        ({'field_of_view': 3.2}, 'beam width 3.2'),
        ({'field_of_view': -0.1}, 'beam width -0.1'),
        ({'range_min': 5.0}, 'range_min 5.0'),
        ({'range_min': 4.0}, 'both 4: expected a sensor that measures distances'),
    ],
)
def test_ranges_that_contradict_themselves(shape, changes, message):
    with pytest.raises(ScanError, match=message):
        read_range(ranged(1.0, shape, **changes))


def test_read_path_sorts_by_the_stamps_of_its_poses():
    poses = [Pose2D(1.0, 2.0, 0.5), Pose2D(3.0, 4.0, -0.5)]
    message = ros_types.path(9, 'map', [2_000_000_007, 1_000_000_001], poses)
    stamps, rows = read_path(message)
    assert stamps.tolist() == [1_000_000_001, 2_000_000_007]
    assert rows == pytest.approx(np.array([(3.0, 4.0, -0.5), (1.0, 2.0, 0.5)]))


@pytest.mark.parametrize(
    ('stamps', 'x', 'reason'),
    [
        ([], 0.0, 'no pose in it'),
        ([5, 5], 0.0, 'expected poses that carry their own stamps'),
        ([5, 6], 2e7, 'expected finite numbers up to 1e\\+07 m'),
    ],
)
def test_a_path_that_corrects_nothing(stamps, x, reason):
    message = ros_types.path(9, 'map', stamps, [Pose2D(x)] * len(stamps))
    with pytest.raises(PoseError, match=reason):
        read_path(message)


def test_no_frame_has_a_name_that_fills_logs_and_memory():
    msg = SimpleNamespace(header=SimpleNamespace(frame_id='/' + 10_000_000 * 'x'))
    assert frame_of(msg) == 255 * 'x'
    assert plain_frame('/odom') == 'odom'

"""Small bags made here, read as the offline commands read them."""

import math

import numpy as np
import pytest
from support.transforms import transform

from ogm_mcmc.config import MountConfig
from ogm_mcmc.engine.bag_scans import PlacedScans, StreamChoice, choose_topics
from ogm_mcmc.errors import BagError
from ogm_mcmc.geometry import PlacedScan, Pose2D, SensorMount
from ogm_mcmc.io import ros_types
from ogm_mcmc.io.bags import BagReader

SECOND = 1_000_000_000
TENTH = SECOND // 10
STAMPS = [20 * SECOND + k * TENTH for k in range(6)]


@pytest.fixture
def place(write_bag):
    """Write (topic, time, message) records, place the scans: (placed, placer)."""

    def run(records, choice=None, kind='mcap', on_scan=lambda: None):
        choice = choice or StreamChoice()
        with BagReader(write_bag(records, kind)) as bag:
            stream = PlacedScans(bag, choose_topics(bag, choice), choice, on_scan)
            return list(stream), stream.placer

    return run


@pytest.fixture
def good(make_scan, make_pose):
    """Six scans, each with its pose at the same stamp."""
    records = []
    for k, stamp in enumerate(STAMPS):
        pose = make_pose(stamp, x=0.5 * k, y=1.0, yaw=0.1 * k, variances=(0.5, 0.25, 0.125))
        records += [('/pose', stamp, pose), ('/scan', stamp, make_scan(stamp, ranges=[k] * 5))]
    return records


@pytest.mark.parametrize('kind', ['mcap', 'sqlite3', 'ros1'])
def test_good_bag(place, good, kind):
    calls = []
    placed, placer = place(good, kind=kind, on_scan=lambda: calls.append(1))
    assert [placement.scan.stamp_ns for placement in placed] == STAMPS
    assert [placement.scan.ranges_m[0] for placement in placed] == [0, 1, 2, 3, 4, 5]
    for k, (scan, belief) in enumerate(placed):
        assert (scan.angle_min_rad, scan.angle_increment_rad) == (-1.0, 0.5)
        assert (scan.range_max_m, scan.frame_id) == (10.0, 'laser')
        assert (belief.mean.x_m, belief.mean.y_m) == (0.5 * k, 1.0)
        assert belief.mean.yaw_rad == pytest.approx(0.1 * k)
        assert belief.covariance == pytest.approx(np.diag([0.5, 0.25, 0.125]))
        assert belief.particles is None
    assert len(calls) == 6
    assert not placer.dropped
    assert len(placer) == 0


def test_bag_without_scans(place, good):
    with pytest.raises(BagError, match=r'no scans in it: expected sensor_msgs.*holds /pose'):
        place([record for record in good if record[0] == '/pose'])


def test_bag_without_poses(place, good):
    with pytest.raises(BagError, match=r'no poses in it: expected .*holds /scan'):
        place([record for record in good if record[0] == '/scan'])


def test_poses_in_a_frame_of_the_robot(place, good, make_pose):
    """They were called none, beside the topic that holds them."""
    poses = [('/pose', time_ns, make_pose(time_ns, frame='base_link')) for _, time_ns, _ in good]
    message = r"those of /pose are in 'base_link', a frame of the robot; it holds /pose"
    with pytest.raises(BagError, match=message):
        place([*poses, *(record for record in good if record[0] == '/scan')])


def changed(path, value):
    """Return what sets a field of a message, given as a dotted path."""

    def change(message):
        *parents, name = path.split('.')
        for parent in parents:
            message = getattr(message, parent)
        setattr(message, name, value)

    return change


def covariance(*entries):
    full = np.diag([0.5, 0.5, 0.0, 0.0, 0.0, 0.5])
    for row, column, value in entries:
        full[row, column] = value
    return changed('pose.covariance', full.reshape(36))


FAULTS = {
    'no beams': ('/scan', changed('ranges', np.zeros(0, np.float32)), 'at least one beam'),
    'no increment': ('/scan', changed('angle_increment', 0.0), 'angle_increment is 0'),
    'wrong sign': ('/scan', changed('angle_increment', -0.5), 'wrong sign'),
    'nan increment': ('/scan', changed('angle_increment', math.nan), 'finite'),
    'too many': ('/scan', changed('ranges', np.ones(99, np.float32)), 'ranges: 99 of them'),
    'limits': ('/scan', changed('range_min', 11.0), 'range_min 11'),
    'nan pose': ('/pose', changed('pose.pose.position.x', math.nan), 'finite'),
    'inf pose': ('/pose', changed('pose.pose.position.y', -math.inf), 'finite'),
    'nan heading': ('/pose', changed('pose.pose.orientation.w', math.nan), 'finite'),
    'no heading': ('/pose', changed('pose.pose.orientation.w', 0.0), 'unit length'),
    'tilted': ('/pose', changed('pose.pose.orientation.x', 0.7071), 'expected'),
    'negative variance': ('/pose', covariance((1, 1, -0.01)), 'positive semi-definite'),
    'too correlated': ('/pose', covariance((0, 1, 0.6), (1, 0, 0.6)), 'positive semi-definite'),
    'lopsided': ('/pose', covariance((0, 5, 0.2)), 'symmetric'),
    'nan covariance': ('/pose', covariance((5, 5, math.nan)), 'finite'),
}


@pytest.mark.parametrize(('topic', 'change', 'reason'), FAULTS.values(), ids=FAULTS)
def test_one_bad_message_is_one_dropped_message(write_bag, good, topic, change, reason):
    """The fourth message of a topic is at fault: counted, and the others are used."""
    at_fault = next(r for r in good if r[:2] == (topic, STAMPS[3]))
    change(at_fault[2])
    path, choice = write_bag(good), StreamChoice()
    with BagReader(path) as bag:
        stream = PlacedScans(bag, choose_topics(bag, choice), choice)
        placed = list(stream)
    kind = 'scan_invalid' if topic == '/scan' else 'pose_invalid'
    assert stream.placer.dropped[kind] == 1
    assert stream.first_fault.startswith(f'{path}: {topic} at 20.300 s: ')
    assert reason in stream.first_fault
    assert '\n' not in stream.first_fault
    stamps = [one.scan.stamp_ns for one in placed]
    # Between its neighbours a scan without a pose of its own has one all the same.
    assert stamps == [t for t in STAMPS if topic == '/pose' or t != STAMPS[3]]


def test_a_pose_in_another_frame_is_dropped(write_bag, good):
    at_fault = next(r for r in good if r[:2] == ('/pose', STAMPS[3]))
    at_fault[2].header.frame_id = 'odom'
    choice = StreamChoice()
    with BagReader(write_bag(good)) as bag:
        stream = PlacedScans(bag, choose_topics(bag, choice), choice)
        assert len(list(stream)) == 6
    assert stream.placer.dropped == {'pose_wrong_frame': 1}


def test_the_mount_comes_from_tf_unless_parameters_say_otherwise(place, good):
    """A laser turned by 90 degrees and upside down, 0.2 m ahead of the base."""
    said = transform(STAMPS[0], 'base_link', 'laser', 0.2, 0.1, math.pi / 2, math.pi)
    records = [*good, ('/tf_static', STAMPS[0] - 1, said)]
    without, _ = place(good)
    placed, _ = place(records)
    mount = SensorMount(Pose2D(0.2, 0.1, math.pi / 2), True)
    for (scan, robot), found in zip(without, placed, strict=True):
        expected = PlacedScan.on_robot(scan, robot, mount)
        assert np.array_equal(found.scan.ranges_m, expected.scan.ranges_m)
        assert found.scan.angle_min_rad == expected.scan.angle_min_rad
        where, wanted = found.pose, expected.pose
        assert (where.x_m, where.y_m) == pytest.approx((wanted.x_m, wanted.y_m))
        assert math.cos(where.yaw_rad - wanted.yaw_rad) == pytest.approx(1.0)
    by_hand, _ = place(records, StreamChoice(mounts=MountConfig(x=0.5)))
    assert by_hand[0].pose.x_m == pytest.approx(without[0].pose.x_m + 0.5)


def test_a_sensor_that_is_not_level_is_told_by_name(write_bag, good, make_scan):
    """The optical frame of a camera; beside it a laser that is level is used."""
    tilted = transform(STAMPS[0], 'base_link', 'optical', 0.0, 0.0, 0.0, math.pi / 2)
    level = transform(STAMPS[0], 'base_link', 'laser', 0.0, 0.0, 0.0)
    depth = [('/depth/scan', stamp, make_scan(stamp, frame='optical')) for stamp in STAMPS]
    static = [('/tf_static', STAMPS[0] - 1, one) for one in (tilted, level)]
    fault = 'optical on base_link: orientation is tilted by 90 degrees: expected a frame level'
    path, choice, said = write_bag([*good, *depth, *static]), StreamChoice(), []
    with BagReader(path) as bag:
        stream = PlacedScans(bag, choose_topics(bag, choice), choice, tell=said.append)
        assert len(list(stream)) == 6
    assert stream.placer.dropped == {'scan_bad_mount': 6}
    assert said[-1].startswith(f'scans left out: {fault}')
    with BagReader(path) as bag:
        choice = StreamChoice(scan_topic='/depth/scan')
        stream = PlacedScans(bag, choose_topics(bag, choice), choice)
        with pytest.raises(BagError, match=f'scan_bad_mount 6: its sensor .*fault: {fault}'):
            list(stream)


def test_poses_from_tf(place, good):
    """map -> odom -> base_link -> laser, the base where the poses of the other topic are."""
    expected, _ = place(good)
    scans = [record for record in good if record[0] == '/scan']
    moving = []
    for placed in expected:
        stamp, pose = placed.scan.stamp_ns, placed.pose
        moving.append(('/tf', stamp, transform(stamp, 'map', 'odom', 1.0, 0.0, 0.0)))
        base = transform(stamp, 'odom', 'base_link', pose.x_m - 1.0, pose.y_m, pose.yaw_rad)
        moving.append(('/tf', stamp, base))
    laser = transform(STAMPS[0], 'base_link', 'laser', 0.0, 0.0, 0.0)
    records = [*scans, *moving, ('/tf_static', STAMPS[0] - 1, laser)]
    found, placer = place(records, StreamChoice(pose_source='tf'))
    assert not placer.dropped
    assert len(found) == len(expected) > 0
    for one, other in zip(found, expected, strict=True):
        assert (one.pose.x_m, one.pose.y_m) == pytest.approx((other.pose.x_m, other.pose.y_m))
    assert len(place(records)[0]) == len(expected)  # auto
    with pytest.raises(BagError, match=r'no poses in it.*there are tf \(--pose-source tf\)'):
        place(records, StreamChoice(pose_source='odom'))
    with pytest.raises(BagError, match=r"frame 'laser' of /scan is not in its transforms"):
        place(
            [*scans, ('/tf', STAMPS[0], transform(STAMPS[0], 'map', 'odom', 0, 0, 0))],
            StreamChoice(pose_source='tf'),
        )


def test_poses_at_half_the_rate(place, make_scan, make_pose):
    """Between two poses the mean lies halfway, the heading the short way round."""
    records = [('/scan', stamp, make_scan(stamp)) for stamp in STAMPS[:5]]
    for k, yaw in enumerate([3.0, -3.0, -2.0]):
        stamp = STAMPS[2 * k]
        pose = make_pose(stamp, x=0.2 * k, y=-k, yaw=yaw, variances=(0.1 + 0.2 * k, 0.5, 0.0))
        records.append(('/pose', stamp, pose))
    placed, placer = place(records)
    means = [belief.mean for _, belief in placed]
    assert [mean.x_m for mean in means] == pytest.approx([0, 0.1, 0.2, 0.3, 0.4])
    assert [mean.y_m for mean in means] == pytest.approx([0, -0.5, -1, -1.5, -2])
    turned = [mean.yaw_rad % (2 * math.pi) for mean in means]
    full = 2 * math.pi
    assert turned == pytest.approx([3.0, math.pi, full - 3.0, full - 2.5, full - 2.0])
    variances = [belief.covariance[0, 0] for _, belief in placed]
    assert variances == pytest.approx([0.1, 0.2, 0.3, 0.4, 0.5])
    assert not placer.dropped


def test_scans_outside_the_poses_are_counted(place, make_scan, make_pose):
    records = [('/scan', stamp, make_scan(stamp)) for stamp in STAMPS]
    records += [('/pose', stamp, make_pose(stamp)) for stamp in (STAMPS[1], STAMPS[3])]
    placed, placer = place(records)
    assert [placement.scan.stamp_ns for placement in placed] == STAMPS[1:4]
    assert placer.dropped == {'scan_before_poses': 1, 'pose_timeout': 2}


@pytest.mark.parametrize(('max_gap_s', 'kept'), [(2.5, [1, 2, 5]), (3.0, [1, 2, 3, 4, 5])])
def test_gap_between_poses(place, make_scan, make_pose, max_gap_s, kept):
    """Poses at 1, 2 and 5 s."""
    records = [('/scan', k * SECOND, make_scan(k * SECOND)) for k in range(1, 6)]
    records += [('/pose', k * SECOND, make_pose(k * SECOND)) for k in (1, 2, 5)]
    placed, placer = place(records, StreamChoice(max_pose_gap_s=max_gap_s))
    assert [placement.scan.stamp_ns for placement in placed] == [k * SECOND for k in kept]
    assert placer.dropped == ({'pose_gap': 2} if len(kept) == 3 else {})


@pytest.mark.parametrize(('limits', 'kept'), [({}, 1), ({'max_speed_m_s': 60.0}, 2)])
def test_no_scan_between_poses_that_jump(place, make_scan, make_pose, limits, kept):
    records = [('/pose', k, make_pose(STAMPS[k], x=5.0 * (k > 0))) for k in range(3)]
    records += [('/scan', 9, make_scan(STAMPS[k] + TENTH // 2)) for k in range(2)]
    placed, placer = place(records, StreamChoice(**limits))
    assert len(placed) == kept
    assert placer.dropped == ({'pose_jump': 1} if kept == 1 else {})


def test_poses_recorded_long_after_their_scans(place, make_scan, make_pose):
    """In a file nothing comes late: the stamps in the headers count."""
    records = [('/scan', stamp, make_scan(stamp)) for stamp in STAMPS]
    records += [('/pose', stamp + 600 * SECOND, make_pose(stamp)) for stamp in STAMPS]
    placed, placer = place(records)
    assert [placement.scan.stamp_ns for placement in placed] == STAMPS
    assert not placer.dropped


def test_scans_out_of_order_are_counted(place, make_scan, make_pose):
    headers = [STAMPS[k] for k in (0, 2, 1, 2, 3)]
    records = [('/scan', time, make_scan(h)) for time, h in zip(STAMPS, headers, strict=False)]
    records += [('/pose', stamp, make_pose(stamp)) for stamp in STAMPS]
    placed, placer = place(records)
    assert [placement.scan.stamp_ns for placement in placed] == [STAMPS[k] for k in (0, 2, 3)]
    assert placer.dropped == {'scan_out_of_order': 2}


def test_particles(place, make_scan):
    poses = np.array([[1.0, 2.0, 0.25], [3.0, 2.0, 0.75]])
    records = []
    for stamp in STAMPS:
        records.append(('/particles', stamp, ros_types.pose_array(stamp, 'map', poses)))
        records.append(('/scan', stamp, make_scan(stamp)))
    placed, _ = place(records, StreamChoice(pose_source='particles'))
    assert len(placed) == 6
    for _, belief in placed:
        assert belief.particles.poses == pytest.approx(poses)
        assert belief.particles.weights.tolist() == [0.5, 0.5]
        assert (belief.mean.x_m, belief.mean.y_m) == pytest.approx((2.0, 2.0))
        assert belief.mean.yaw_rad == pytest.approx(0.5)


def test_no_particles_in_a_message(place, good):
    empty = ros_types.pose_array(STAMPS[2], 'map', np.zeros((0, 3)))
    records = [*good, ('/particles', STAMPS[2], empty)]
    with pytest.raises(BagError, match=r'/particles at 20\.200 s: particles: expected at least'):
        place(records, StreamChoice(pose_source='particles'))


def test_a_code_below_range_max_is_found_before_the_first_scan(place, make_pose, make_scan):
    """The first scan alone would not have told; the user hears of it in one line."""
    few = [*np.linspace(1.0, 3.0, 19), 3.499]
    many = [*np.linspace(1.0, 3.0, 12), *[3.499] * 8]
    records = []
    for k, stamp in enumerate(STAMPS):
        scan = make_scan(stamp, few if k == 0 else many, angle_increment=0.1, range_max=3.5)
        scan.angle_max = 0.9
        records += [('/pose', stamp, make_pose(stamp)), ('/scan', stamp, scan)]
    placed, _ = place(records)
    assert [np.isinf(one.scan.ranges_m).sum() for one in placed] == [1, 8, 8, 8, 8, 8]
    kept, _ = place(records, StreamChoice(no_return_code_m=3.5))
    assert not any(np.isinf(one.scan.ranges_m).any() for one in kept)

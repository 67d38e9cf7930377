"""Logs whose laser lines name no pose: the odometry around them does."""

import math

import numpy as np
import pytest

from ogm_mcmc.errors import LogError
from ogm_mcmc.geometry import Pose2D
from ogm_mcmc.io.bags import BagReader
from ogm_mcmc.io.carmen import LogOdometry, read_carmen
from ogm_mcmc.io.carmen_import import ImportOptions, import_carmen
from ogm_mcmc.io.carmen_raw import laser_place


def raw(time, laser=1, ranges='1.0 60.0 2.0', rest=''):
    return f'RAWLASER{laser} 0 -1.5 3.0 0.25 50.0 0.01 0 3 {ranges} 0 {time} host {time}{rest}'


def odom(time, x=0.0, y=0.0, yaw=0.0):
    return f'ODOM {x} {y} {yaw} 0.1 0.2 0.3 {time} host {time}'


def poses(log):
    return [scan.laser_pose for scan in log.scans]


def test_a_raw_scan_lies_between_the_odometry_around_it(write_log):
    lines = [odom(10), odom(10.5, 1.0, 0.0, 0.4), raw(10.25), raw(10.5), odom(11, 2.0, 1.0, 0.8)]
    log = read_carmen(write_log(*lines, raw(10.75)))
    expected = [(0.5, 0.0, 0.2), (1.0, 0.0, 0.4), (1.5, 0.5, 0.6)]
    found = [(pose.x_m, pose.y_m, pose.yaw_rad) for pose in poses(log)]
    np.testing.assert_allclose(found, expected, atol=1e-12)
    assert [scan.ranges_m.tolist() for scan in log.scans] == [[1.0, 60.0, 2.0]] * 3
    assert [scan.time_s for scan in log.scans] == [10.25, 10.5, 10.75]
    assert (log.scans[0].start_angle_rad, log.scans[0].increment_rad) == (-1.5, 0.25)
    assert log.scans[0].max_range_m == 50.0
    kinds = [isinstance(record, LogOdometry) for record in log.records]
    assert kinds == [True, True, False, False, True, False]  # the order of the file
    assert (log.raw_scans, log.without_odometry, log.damaged) == (3, 0, 0)
    assert not log.left_alone


def test_what_the_odometry_does_not_cover_is_left_out_and_counted(write_log):
    lines = [odom(10), raw(9), raw(10), raw(11.2), odom(12.5, 1.0), raw(12.6), odom(12.7, 1.1)]
    lines += [raw(15), odom(17, 1.1), raw(17.5), odom(18, 90.0), raw(19)]
    log = read_carmen(write_log(*lines))
    # 9 and 19 lie outside, 11.2 in a gap of 2.5 s; at 15 the robot stands; 17.5 is in a jump.
    assert [scan.time_s for scan in log.scans] == [10, 12.6, 15]
    assert poses(log)[2] == Pose2D(1.1, 0.0, 0.0)
    assert (log.raw_scans, log.without_odometry) == (3, 4)


def test_other_laser_lines_come_first(write_log, laser_line):
    placed = laser_line(11.0, [1.5] * 180)
    for lines in ([raw(10), 'RAWLASER2 x', placed, raw(12)], [placed, raw(10), 'RAWLASER2 x']):
        log = read_carmen(write_log(odom(9), *lines, odom(20)))
        assert [scan.time_s for scan in log.scans] == [11.0]
        assert sum(log.left_alone.values()) == len(lines) - 1
        assert (log.raw_scans, log.damaged) == (0, 0)


def test_parameters_say_where_the_lasers_sit(write_log):
    lines = ['PARAM robot_frontlaser_offset 0.3', 'PARAM robot_rearlaser_offset -0.2']
    log = read_carmen(write_log(*lines, odom(10, 1.0, 2.0, math.pi / 2), raw(10), raw(10, 2)))
    front, rear = poses(log)
    assert (front.x_m, front.y_m, front.yaw_rad) == pytest.approx((1.0, 2.3, math.pi / 2))
    assert (rear.x_m, rear.y_m, rear.yaw_rad) == pytest.approx((1.0, 1.8, -math.pi / 2))
    turned = {f'robot_frontlaser_{name}': '0.5' for name in ('side_offset', 'angular_offset')}
    assert laser_place('1', turned) == Pose2D(0.0, 0.5, 0.5)
    assert laser_place('3', turned | {'robot_frontlaser_id': '3'}) == Pose2D(0.0, 0.5, 0.5)
    assert laser_place('1', {'robot_frontlaser_offset': 'nan'}) == Pose2D(0.0, 0.0, 0.0)
    assert laser_place('2', {}) == Pose2D(0.0, 0.0, 0.0)


def test_times_that_wrap_are_interpolated_in_the_order_of_the_file(write_log):
    end = 2.0**32
    lines = [odom(-1), raw(-0.5), odom(0.0, 1.0), odom(end - 1, 1.0), raw(end - 0.5)]
    log = read_carmen(write_log(*lines, odom(end, 2.0)))
    assert [pose.x_m for pose in poses(log)] == pytest.approx([0.5, 1.5])


def test_damaged_raw_lines_cost_those_lines(write_log):
    short = ' '.join(raw(10.2).split()[:9])
    log = read_carmen(write_log(odom(10), raw(10), short, raw(10), raw(10, ranges='1 x 2')))
    assert (len(log.scans), log.damaged) == (2, 2)
    assert log.first_damage.startswith('line 3: RAWLASER1 line ends too early')
    path = write_log(odom(10), raw(10), odom(11))
    cut = raw(11).partition('1 host')[0]  # its time lost a digit
    path.write_bytes(path.read_bytes() + cut.encode())
    log = read_carmen(path)
    assert (len(log.scans), log.damaged) == (1, 1)
    assert 'cut off' in log.first_damage


FAR = 'but none at or between ODOM lines that are at most 2 s apart and do not jump'


@pytest.mark.parametrize(
    ('lines', 'reason'),
    [
        ([raw(10)], 'but no ODOM line'),
        ([raw(10), odom(11), raw(12)], FAR),
        ([odom(10), raw(11), odom(13, 1.0)], FAR),
        ([odom(10), raw(10.5), odom(11, 500.0)], FAR),
    ],
)
def test_without_odometry_there_are_no_poses(write_log, lines, reason):
    with pytest.raises(LogError) as caught:
        read_carmen(write_log(*lines))
    assert f'RAWLASER lines, {reason})' in str(caught.value)
    assert 'LASER_READING, or RAWLASER1 with ODOM' in str(caught.value)


def test_a_field_of_view_gives_raw_lines_angles(write_log):
    plain = raw(10).replace(' -1.5 3.0 0.25 50.0', ' 0 0 0 50.0')
    (scan,) = read_carmen(write_log(odom(10), plain), math.radians(180)).scans
    assert scan.start_angle_rad == pytest.approx(-math.pi / 2)
    assert scan.increment_rad == pytest.approx(math.pi / 2)
    with pytest.raises(LogError, match='--field-of-view'):
        read_carmen(write_log(odom(10), plain))


def test_the_bag_holds_poses_at_the_scans(write_log, tmp_path):
    log = write_log(odom(10), raw(10.25), raw(10.25, 2), odom(10.5, 1.0), raw(11))
    summary = import_carmen(log, tmp_path / 'bag', ImportOptions())
    assert (summary.raw_scans, summary.without_odometry) == (2, 1)
    assert summary.odometry_to_pose_median_m is None
    with BagReader(tmp_path / 'bag') as bag:
        held = {topic.name: topic.n_messages for topic in bag.topics()}
        assert held == {'/odom': 2, '/pose': 1, '/scan': 1, '/pose_2': 1, '/scan_2': 1}
        (record,) = bag.records(['/pose'])
        assert bag.decode(record).pose.pose.position.x == 0.5

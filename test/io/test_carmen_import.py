"""From log to bag: what is read back, and what the summary claims."""

import json
import math

import numpy as np
import pytest
from rosbags import rosbag2

from ogm_mcmc.cli.import_carmen import describe
from ogm_mcmc.errors import LogError, OutputError
from ogm_mcmc.io import carmen_import, ros_types
from ogm_mcmc.io.carmen_import import ImportOptions, import_carmen

SECOND = 1_000_000_000
ODOM = 'ODOM {x} 2 0.5 0.25 -0.125 0 {time} host 0'


@pytest.fixture
def convert(write_log, tmp_path, read_bag):
    """Write a log, import it, read the bag: (summary, bag)."""

    def run(*lines, **options):
        target = tmp_path / 'out'
        summary = import_carmen(write_log(*lines), target, ImportOptions(**options))
        return summary, read_bag(target)

    return run


def header_ns(message):
    return message.header.stamp.sec * SECOND + message.header.stamp.nanosec


def yaw_of(pose):
    return 2.0 * math.atan2(pose.orientation.z, pose.orientation.w)


def test_bag_equals_log(convert, robot_laser_line):
    _, bag = convert(
        'ODOM 4.5 5.5 0.5 0.25 -0.125 9 1000.25 host 0',
        robot_laser_line(1000.5, (1.25, 2.5, 49.75), pose=(1.5, -2.5, 3.0)),
    )
    assert bag.order == [
        (1000 * SECOND + SECOND // 4, '/odom'),
        (1000 * SECOND + SECOND // 2, '/pose'),
        (1000 * SECOND + SECOND // 2, '/scan'),
    ]
    (_, odometry), (_, pose), (_, scan) = (bag.topics[t][0] for t in ('/odom', '/pose', '/scan'))
    for time_and_topic, message in zip(bag.order, (odometry, pose, scan), strict=True):
        assert header_ns(message) == time_and_topic[0]
    assert (odometry.header.frame_id, odometry.child_frame_id) == ('odom', 'base_link')
    assert (odometry.pose.pose.position.x, odometry.pose.pose.position.y) == (4.5, 5.5)
    assert yaw_of(odometry.pose.pose) == pytest.approx(0.5)
    assert (odometry.twist.twist.linear.x, odometry.twist.twist.angular.z) == (0.25, -0.125)
    assert pose.header.frame_id == 'map'
    assert (pose.pose.pose.position.x, pose.pose.pose.position.y) == (1.5, -2.5)
    assert yaw_of(pose.pose.pose) == pytest.approx(3.0)
    assert not pose.pose.covariance.any()
    assert scan.header.frame_id == 'laser'
    assert scan.ranges.tolist() == [1.25, 2.5, 49.75]
    assert (scan.angle_min, scan.angle_max, scan.angle_increment) == (-0.5, 0.5, 0.5)
    assert (scan.range_min, scan.range_max) == (0.0, 50.0)


def test_several_lasers_get_their_own_topics(convert, laser_line):
    summary, bag = convert(
        laser_line(1, [2.0] * 181, kind='RLASER', pose=(1, 0, 0)),
        laser_line(1, [3.0] * 361, pose=(2, 0, 0)),
        laser_line(2, [4.0] * 181, kind='RLASER', pose=(3, 0, 0)),
    )
    assert summary.scans == {'scan': 2, 'scan_front': 1}
    assert summary.beams == [181, 361]
    assert summary.angle_increment_deg == [0.5, 1.0]
    assert sorted(bag.topics) == ['/pose', '/pose_front', '/scan', '/scan_front']
    assert [m.ranges[0] for _, m in bag.topics['/scan']] == [2.0, 4.0]
    assert [m.pose.pose.position.x for _, m in bag.topics['/pose']] == [1.0, 3.0]
    assert [m.ranges[0] for _, m in bag.topics['/scan_front']] == [3.0]
    assert [m.pose.pose.position.x for _, m in bag.topics['/pose_front']] == [2.0]
    assert bag.topics['/scan'][0][1].header.frame_id == 'laser'
    assert bag.topics['/scan_front'][0][1].header.frame_id == 'laser_front'


def test_records_out_of_order_are_sorted(convert, laser_line):
    times = [3.0, 1.0, 2.0, 5.0, 4.0]
    summary, bag = convert(
        *(laser_line(time, pose=(10 * time, 0, 0)) for time in times),
        *(ODOM.format(x=time, time=time) for time in (4.5, 0.5)),
    )
    assert [m.pose.pose.position.x for _, m in bag.topics['/pose']] == [10, 20, 30, 40, 50]
    assert [m.pose.pose.position.x for _, m in bag.topics['/odom']] == [0.5, 4.5]
    assert [time for time, _ in bag.topics['/scan']] == [k * SECOND for k in range(1, 6)]
    assert summary.out_of_order == {'front': 2, 'odometry': 1}
    assert summary.repeated_stamps == 0
    assert summary.largest_shift_s < 1e-9


def test_repeated_stamps_and_time_offset(convert, laser_line):
    summary, bag = convert(
        *(laser_line(7, pose=(x, 0, 0)) for x in (3, 1, 2)),
        laser_line(9, pose=(4, 0, 0)),
        repeat_step_s=0.5,
        time_offset_s=100.0,
    )
    assert [time for time, _ in bag.topics['/scan']] == [
        107 * SECOND,
        107 * SECOND + SECOND // 2,
        108 * SECOND,
        109 * SECOND,
    ]
    assert [m.pose.pose.position.x for _, m in bag.topics['/pose']] == [3, 1, 2, 4]
    for topic in ('/pose', '/scan'):
        assert all(header_ns(message) == time for time, message in bag.topics[topic])
    assert (summary.repeated_stamps, summary.without_times) == (2, False)
    assert summary.largest_shift_s == pytest.approx(1.0)


def test_a_log_without_times_is_said_to_be_one(convert, laser_line):
    """Belgioioso: whatever is told in seconds, as the times of beams, is by what was made up."""
    summary, _ = convert(*(laser_line(7, pose=(x, 0, 0)) for x in (3, 1, 2)))
    assert summary.without_times
    assert 'all are the same: times between scans are made up' in describe(summary)


def test_particles_with_mean_and_covariance(convert):
    poses = np.array([[1.0, 2.0, 0.5], [1.5, 2.5, 0.75], [0.5, 3.0, 0.25]])
    weights = np.array([4.0, 2.0, 1.0]) / 7.0
    log_weights = 9.0 * np.log(weights)
    rows = ' '.join(f'{x} {y} {a} {w}' for (x, y, a), w in zip(poses, log_weights, strict=True))
    lines = (f'LASER_READING 180 {"1.5 " * 180}70 80 0.9 5.0', f'SM_UPDATE 3 {rows}')
    summary, bag = convert(*lines, particles=7)
    assert summary.particles_per_scan == 7
    (_, cloud), (_, pose) = bag.topics['/particles'][0], bag.topics['/pose'][0]
    assert (cloud.header.frame_id, header_ns(cloud)) == ('map', 5 * SECOND)
    assert [p.position.x for p in cloud.poses] == [1.0] * 4 + [1.5] * 2 + [0.5]
    assert [yaw_of(p) for p in cloud.poses] == pytest.approx([0.5] * 4 + [0.75] * 2 + [0.25])
    mean = weights @ poses
    assert pose.pose.pose.position.x == pytest.approx(mean[0])
    assert pose.pose.pose.position.y == pytest.approx(mean[1])
    # The direction of the mean unit vector, a little off the mean of the angles.
    heading = math.atan2(weights @ np.sin(poses[:, 2]), weights @ np.cos(poses[:, 2]))
    assert yaw_of(pose.pose.pose) == pytest.approx(heading)
    difference = poses - [mean[0], mean[1], heading]
    expected = sum(w * np.outer(d, d) for w, d in zip(weights, difference, strict=True))
    full = pose.pose.covariance.reshape(6, 6)
    assert full[np.ix_((0, 1, 5), (0, 1, 5))] == pytest.approx(expected)
    assert np.count_nonzero(full) == 9


def test_as_many_particles_as_in_the_log(convert):
    rows = ' '.join(f'{k} 0 0 -1' for k in range(5))
    summary, bag = convert(f'LASER_READING 180 {"1.5 " * 180}0 0 0 5', f'SM_UPDATE 5 {rows}')
    assert [p.position.x for p in bag.topics['/particles'][0][1].poses] == [0, 1, 2, 3, 4]
    assert summary.particles_per_scan == 5


def test_summary_is_true(convert, laser_line):
    """Counted a second time here, from the lines of the log alone."""
    rng = np.random.default_rng(4)
    lines = []
    for k in range(12):
        readings = rng.choice([1.5, 20.25, 81.83, 81.91], 180, p=[0.5, 0.4, 0.07, 0.03])
        lines.append(laser_line(float(k // 2), readings.tolist(), pose=(k, 1, 0)))
        lines.append(
            f'ODOM {k} 1 0 0 0 0 99999 host 0' if k % 3 == 0 else ODOM.format(x=k, time=k)
        )
        lines.append('NEFF 3')
    summary, bag = convert(*lines)
    words = [word for line in lines if 'FLASER' in line for word in line.split()[2:182]]
    codes = {code: words.count(code) for code in ('81.83', '81.91')}
    assert summary.readings == len(words) == 12 * 180
    assert summary.no_return_codes_m == codes
    assert summary.no_return == sum(codes.values())
    assert summary.scans == {'scan': 12}
    assert summary.repeated_stamps == 6
    assert summary.odometry == len(bag.topics['/odom']) == 8
    assert summary.odometry_echoes == 4
    assert summary.left_alone == {'NEFF': 12}
    infinite = sum(np.isinf(message.ranges).sum() for _, message in bag.topics['/scan'])
    assert infinite == summary.no_return
    assert json.loads(json.dumps(summary.as_dict()))['no_return'] == summary.no_return


def test_distance_of_odometry_to_poses(convert, laser_line):
    """Median over the scans that have an ODOM before them: 1, 3 and 8 m away."""
    summary, _ = convert(
        laser_line(1, pose=(50, 0, 0)),
        ODOM.replace('{x} 2', '0 0').format(time=2),
        laser_line(3, pose=(0, 1, 0)),
        laser_line(4, pose=(3, 0, 0)),
        laser_line(5, pose=(0, 8, 0)),
    )
    assert summary.odometry_to_pose_median_m == pytest.approx(3.0)


def test_times_no_stamp_can_hold(convert, laser_line):
    with pytest.raises(LogError, match=r'small\.log.*expected'):
        convert(laser_line(1.0), laser_line(2.0), time_offset_s=-1.5)


@pytest.mark.parametrize('time', ['1.2e12', '1e300'])
def test_times_beyond_a_ros_stamp(convert, laser_line, time):
    """The seconds of a ROS stamp end at 2147483647; milliseconds in a log are well past that."""
    with pytest.raises(LogError, match=r'small\.log.*expected'):
        convert(laser_line(time), laser_line(time))


def test_times_that_wrap_follow_the_file(convert, laser_line):
    """-0.5 and -0.25, then 2**32 - 10 ...: from 0 on, in the order of the file, and said so."""
    times = [-0.5, -0.25, 2.0**32 - 10.0, 2.0**32 - 9.75, 2.0**32 - 9.5]
    summary, bag = convert(*(laser_line(time, pose=(k, 0, 0)) for k, time in enumerate(times)))
    assert [m.pose.pose.position.x for _, m in bag.topics['/pose']] == [0, 1, 2, 3, 4]
    assert bag.topics['/scan'][0][0] == 0
    assert bag.topics['/scan'][-1][0] == SECOND * 3 // 4
    assert (summary.clock_shift_s, summary.clock_jumps) == (0.5, 1)
    assert 'shifted by 0.5 s to start at 0, 1 jumps closed' in describe(summary)


def test_what_was_left_out_is_said(convert, laser_line):
    summary, bag = convert(
        laser_line(1), laser_line('soon'), laser_line(2, [1.5] * 682), laser_line(3), laser_line(4)
    )
    assert len(bag.topics['/scan']) == 3
    assert summary.damaged_lines == 2
    assert summary.without_angles == {682: 1}
    text = describe(summary)
    assert "2 lines that cannot be used, the first: line 2: time is 'soon'" in text
    assert '1 of 682; --field-of-view gives them angles' in text


def test_a_field_of_view_reaches_the_scans(convert, laser_line):
    summary, bag = convert(laser_line(1, [1.5] * 682), field_of_view_deg=240.0)
    (_, scan) = bag.topics['/scan'][0]
    assert np.degrees([scan.angle_min, scan.angle_max]) == pytest.approx([-120.0, 120.0])
    assert summary.damaged_lines == 0


def test_existing_bag_is_refused(write_log, laser_line, tmp_path, read_bag):
    log, target = write_log(laser_line(1)), tmp_path / 'out'
    import_carmen(log, target, ImportOptions())
    with pytest.raises(OutputError, match='exists already'):
        import_carmen(log, target, ImportOptions())
    import_carmen(write_log(laser_line(1), laser_line(2)), target, ImportOptions(), overwrite=True)
    assert len(read_bag(target).topics['/scan']) == 2
    no_bag = tmp_path / 'photos'
    no_bag.mkdir()
    with pytest.raises(OutputError, match='no rosbag2'):
        import_carmen(log, no_bag, ImportOptions(), overwrite=True)


def test_no_half_written_bag(write_log, laser_line, tmp_path, read_bag, monkeypatch):
    log, target = write_log(laser_line(1), laser_line(2)), tmp_path / 'out'
    import_carmen(log, target, ImportOptions())
    before = sorted(path.name for path in tmp_path.iterdir())
    good = ros_types.laser_scan

    def fails_on_the_second(stamp_ns, *arguments, **fields):
        if stamp_ns == 2 * SECOND:
            raise RuntimeError('cosmic ray')
        return good(stamp_ns, *arguments, **fields)

    monkeypatch.setattr(carmen_import.ros_types, 'laser_scan', fails_on_the_second)
    for name in ('out', 'new'):
        with pytest.raises(RuntimeError, match='cosmic ray'):
            import_carmen(log, tmp_path / name, ImportOptions(), overwrite=True)
        assert sorted(path.name for path in tmp_path.iterdir()) == before
    assert len(read_bag(target).topics['/scan']) == 2  # the one from before


@pytest.mark.parametrize('step', ['open', 'write', 'close'])
def test_full_disk(write_log, laser_line, tmp_path, monkeypatch, step):
    def fails(*_):
        raise OSError(28, 'No space left on device')

    log = write_log(laser_line(1), laser_line(2))
    monkeypatch.setattr(rosbag2.Writer, step, fails)
    with pytest.raises(OutputError, match='No space left'):
        import_carmen(log, tmp_path / 'out', ImportOptions())
    assert list(tmp_path.iterdir()) == [log]

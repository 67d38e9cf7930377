"""Logs written out literally, and what is read from them."""

import gzip
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ogm_mcmc.geometry import Pose2D
from ogm_mcmc.io.carmen import LogOdometry, particle_weights, read_carmen

REST = ' '.join(['2.5'] * 178)
FLASER = f'FLASER 180 0.5 {REST} 81.83 1.25 -2.5 0.75 70 80 0.9 12.5 host 0.25'
ROBOTLASER = (
    'ROBOTLASER1 0 -1.5 3.0 0.25 50.0 0.01 0 3 1.0 60.0 2.0 0 '
    '1.25 -2.5 0.75 70 80 0.9 0.1 0.2 0.3 0.4 0.5 13.5 host 0.25'
)
WITH_REMISSIONS = ROBOTLASER.replace(' 2.0 0 1.25', ' 2.0 4 900 901 902 903 1.25')


def only_scan(log):
    assert len(log.records) == len(log.scans) == 1
    return log.scans[0]


def test_old_front_laser(write_log):
    scan = only_scan(read_carmen(write_log(FLASER)))
    assert scan.line == 1
    assert scan.laser == 'front'
    assert scan.time_s == 12.5
    assert scan.ranges_m.tolist() == [0.5, *[2.5] * 178, 81.83]
    assert scan.start_angle_rad == pytest.approx(-math.pi / 2)
    assert scan.increment_rad == pytest.approx(math.pi / 180)
    assert scan.max_range_m == 0.0
    assert scan.laser_pose == Pose2D(1.25, -2.5, 0.75)
    assert scan.particles is None


@pytest.mark.parametrize(
    ('count', 'step_deg', 'start_deg'),
    [(180, 1.0, -90), (181, 1.0, -90), (360, 0.5, -90), (361, 0.5, -90), (401, 0.25, -50)],
)
def test_number_of_readings_tells_the_angles(write_log, laser_line, count, step_deg, start_deg):
    line = laser_line(3.0, [1.5] * count, kind='RLASER')
    scan = only_scan(read_carmen(write_log(line)))
    assert scan.laser == 'rear'
    assert scan.ranges_m.size == count
    assert math.degrees(scan.increment_rad) == pytest.approx(step_deg)
    assert math.degrees(scan.start_angle_rad) == pytest.approx(start_deg)


@pytest.mark.parametrize('count', [180, 682, 1081])
@pytest.mark.parametrize('kind', ['FLASER', 'RLASER', 'LASER_READING'])
def test_a_field_of_view_gives_angles(write_log, laser_line, kind, count):
    line = laser_line(3.0, [1.5] * count, kind='FLASER')
    if kind == 'LASER_READING':
        line = f'LASER_READING {count} {"1.5 " * count} 1 2 0.5 3.0'
    scan = only_scan(read_carmen(write_log(line.replace('FLASER', kind)), math.radians(270)))
    bearings = scan.start_angle_rad + scan.increment_rad * np.arange(count)
    assert np.degrees(bearings[[0, -1]]) == pytest.approx([-135.0, 135.0])


def test_new_lasers_keep_their_angles(write_log):
    scan = only_scan(read_carmen(write_log(ROBOTLASER), math.radians(270)))
    assert (scan.start_angle_rad, scan.increment_rad) == (-1.5, 0.25)


def test_new_laser_without_resolution(write_log):
    """Three readings over 3 rad are 1.5 rad apart; without any angle the old rule holds."""
    scan = only_scan(read_carmen(write_log(ROBOTLASER.replace(' 0.25 50', ' 0 50'))))
    assert (scan.start_angle_rad, scan.increment_rad) == (-1.5, 1.5)
    none = ROBOTLASER.replace(' -1.5 3.0 0.25 50', ' 0 0 0 50')
    scan = only_scan(read_carmen(write_log(none), math.radians(90)))
    assert np.degrees([scan.start_angle_rad, scan.increment_rad]) == pytest.approx([-45, 45])


@pytest.mark.parametrize('line', [ROBOTLASER, WITH_REMISSIONS])
def test_new_laser_with_and_without_remissions(write_log, line):
    scan = only_scan(read_carmen(write_log(line)))
    assert scan.laser == '1'
    assert scan.time_s == 13.5
    assert scan.ranges_m.tolist() == [1.0, 60.0, 2.0]
    assert (scan.start_angle_rad, scan.increment_rad, scan.max_range_m) == (-1.5, 0.25, 50.0)
    assert scan.laser_pose == Pose2D(1.25, -2.5, 0.75)


def test_new_lasers_keep_their_numbers(write_log):
    second = ROBOTLASER.replace('ROBOTLASER1', 'ROBOTLASER2')
    log = read_carmen(write_log(ROBOTLASER, second))
    assert [scan.laser for scan in log.scans] == ['1', '2']


@pytest.mark.parametrize(
    ('line', 'expected'),
    [
        (
            'ODOM 1.5 2.5 0.5 0.25 -0.125 9.0 12.75 host 0.5',
            LogOdometry(2, 12.75, Pose2D(1.5, 2.5, 0.5), 0.25, -0.125),
        ),
        (
            'ODOM 576.5 0.25 -2.25 1134864629.875',
            LogOdometry(2, 1134864629.875, Pose2D(576.5, 0.25, -2.25)),
        ),
    ],
    ids=['carmen', 'gmapping'],
)
def test_odometry(write_log, line, expected):
    assert read_carmen(write_log(FLASER, line)).records[1] == expected


def test_parameters_comments_and_the_rest(write_log):
    log = read_carmen(
        write_log(
            '# message formats defined: PARAM SYNC ODOM FLASER',
            '#PARAM laser_commented_out 9',
            '',
            'PARAM robot_front_laser_max 81.9 0.1 host 0.1',
            'PARAM robot_front_laser_max 5.0 0.2 host 0.2',
            'PARAM no_value',
            'NEFF 12.5',
            FLASER,
            'NEFF 12.5',
            'SYNC tags',
        )
    )
    assert log.parameters == {'robot_front_laser_max': '81.9'}
    assert log.left_alone == {'NEFF': 2, 'SYNC': 1, 'PARAM': 1}
    assert only_scan(log).line == 8
    assert not log.gmapping


def test_records_stay_in_the_order_of_the_file(write_log, laser_line):
    odometry = 'ODOM 5 5 0 0 0 0 {} host 0'
    lines = [laser_line(9.0), odometry.format(4.0), laser_line(1.0), odometry.format(2.0)]
    assert [record.time_s for record in read_carmen(write_log(*lines)).records] == [9, 4, 1, 2]


def test_gmapping_output(write_log, laser_line):
    """Weights by hand: gain 1 / (3 * 3), log-weights 0, -9 ln 2 and -18 ln 2 weigh 4 : 2 : 1."""
    unit = 9.0 * math.log(2.0)
    reading = f'LASER_READING 181 {" ".join(["1.5"] * 181)} 1.25 -2.5 0.75 1134864629.875'
    later = reading.replace('629.875', '630.875')
    log = read_carmen(
        write_log(
            'FRAME 0 0.0 0.0',
            reading,
            'ODOM 9 9 0.5 1134864630.0',
            f'SM_UPDATE 3 1 2 0.5 {100.0} 3 4 -0.5 {100.0 - unit!r} 5 6 1.5 {100.0 - 2 * unit!r}',
            later,
            'SM_UPDATE 1 7 8 9 -5000.0',
        )
    )
    first, second = log.scans
    assert log.gmapping
    assert log.left_alone == {'FRAME': 1}
    assert (first.laser, first.time_s, first.laser_pose) == (
        'front',
        1134864629.875,
        Pose2D(1.25, -2.5, 0.75),
    )
    assert math.degrees(first.increment_rad) == pytest.approx(1.0)
    assert math.degrees(first.start_angle_rad) == pytest.approx(-90.0)
    assert first.particles.poses.tolist() == [[1, 2, 0.5], [3, 4, -0.5], [5, 6, 1.5]]
    assert first.particles.weights == pytest.approx([4 / 7, 2 / 7, 1 / 7], rel=1e-12)
    assert second.particles.poses.tolist() == [[7, 8, 9]]
    assert second.particles.weights.tolist() == [1.0]


@given(log_weights=st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=40))
@settings(derandomize=True, deadline=None)
def test_particle_weights(log_weights):
    weights = particle_weights(np.array(log_weights))
    assert weights.sum() == pytest.approx(1.0)
    assert np.isfinite(weights).all()
    best = max(log_weights)
    gain = 1.0 / (3.0 * len(log_weights))
    unnormalised = [math.exp(gain * (value - best)) for value in log_weights]
    assert weights == pytest.approx(np.array(unnormalised) / sum(unnormalised), rel=1e-9)


def test_gzip_is_known_by_its_content(write_log):
    plain = write_log('PARAM a b', FLASER, 'ODOM 1 2 0.5 0 0 0 3 h 3')
    packed = plain.with_name('packed.log')
    packed.write_bytes(gzip.compress(plain.read_bytes()))
    expected, log = read_carmen(plain), read_carmen(packed)
    assert log.parameters == {'a': 'b'}
    assert log.scans[0].ranges_m.tolist() == expected.scans[0].ranges_m.tolist()
    assert log.scans[0].laser_pose == expected.scans[0].laser_pose
    assert log.records[1] == expected.records[1]


def test_echoes_of_gfs2log_are_counted_not_kept(write_log):
    echo = 'ODOM 1.25 -2.5 0.75 0 0 0 0 pippo 0'
    log = read_carmen(
        write_log(
            echo,  # before any scan: no echo
            FLASER,
            echo,
            'ODOM 1.25 -2.5 0.7501 0 0 0 4 pippo 4',  # another heading
            'ODOM 1.25 -2.5 0.75 0 0 0 5 pippo 5',  # the pose again, but not right after the scan
            FLASER,
            'ODOM 1.25 -2.5 0.75 0 0 0 -4e-310 pippo 0',  # uninitialised memory as time
        )
    )
    assert log.echoes == 2
    assert [record.time_s for record in log.records] == [0.0, 12.5, 4.0, 5.0, 12.5]

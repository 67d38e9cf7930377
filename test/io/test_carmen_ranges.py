"""Which readings of a log mean that nothing was hit, and how far the scans reach."""

import math

import numpy as np
import pytest

from ogm_mcmc.io.carmen_import import ImportOptions, import_carmen


@pytest.fixture
def first_scans(write_log, tmp_path, read_bag):
    """Import a log; return {topic: first LaserScan}."""

    def run(*lines, **options):
        import_carmen(write_log(*lines), tmp_path / 'out', ImportOptions(**options))
        topics = read_bag(tmp_path / 'out').topics
        return {name: topics[name][0][1] for name in topics if name.startswith('/scan')}

    return run


def test_codes_of_a_sick_become_inf(first_scans, laser_line):
    odd = [0.0, 1.5, 79.99, 81.79, 81.8, 81.83, 81.87, 81.91, 'nan', 'inf']
    scan = first_scans(laser_line(1, odd + [2.5] * 170))['/scan']
    expected = [0, 1.5, 79.99, 81.79, *[math.inf] * 4, math.nan, math.inf]
    assert np.array_equal(scan.ranges[:10], np.array(expected, np.float32), equal_nan=True)
    assert (scan.ranges[10:] == 2.5).all()


@pytest.mark.parametrize(
    ('largest', 'range_max'),
    [(5.0, 80.0), (79.5, 80.0), (80.5, 80.5), (81.83, 80.0), (8.1, 80.0), (8.21, 80.0)],
)
def test_range_max_of_the_old_format(first_scans, laser_line, largest, range_max):
    scan = first_scans(laser_line(1, [largest] + [2.5] * 179))['/scan']
    assert scan.range_max == pytest.approx(range_max, rel=1e-6)
    assert math.isinf(scan.ranges[0]) == (largest > 81.0)


@pytest.mark.parametrize('code', [8.18, 8.183, 8.191])
def test_sick_that_counts_millimetres(first_scans, laser_line, code):
    scan = first_scans(laser_line(1, [code, 7.999, 8.1] + [2.5] * 177))['/scan']
    assert scan.ranges[:3] == pytest.approx(np.array([math.inf, 7.999, 8.1]))
    assert scan.range_max == pytest.approx(8.1, rel=1e-6)
    assert scan.ranges[2] <= scan.range_max


def test_range_max_of_the_millimetre_sick_is_at_least_8(first_scans, laser_line):
    assert first_scans(laser_line(1, [8.191] + [2.5] * 179))['/scan'].range_max == 8.0


def test_named_range_max(first_scans, robot_laser_line):
    line = robot_laser_line(1, (29.9, 30.0, 31.0), max_range=30.0)
    scan = first_scans(line)['/scan']
    assert scan.range_max == 30.0
    assert scan.ranges == pytest.approx(np.array([29.9, math.inf, math.inf]))


def test_chosen_range_max_leaves_the_readings(first_scans, laser_line):
    scan = first_scans(laser_line(1, [9.5, 20.5, 81.83] + [2.5] * 177), range_max_m=10.0)['/scan']
    assert scan.range_max == 10.0
    assert scan.ranges[:3].tolist() == [9.5, 20.5, math.inf]


@pytest.mark.parametrize('named', [81.90, 81.91, 81.92])
def test_codes_of_a_sick_in_the_new_format(first_scans, robot_laser_line, named):
    """CARMEN's own driver names 81.90 m for every SICK LMS, more than the code 81.83."""
    scan = first_scans(robot_laser_line(1, (5.0, 81.83, 81.91), max_range=named))['/scan']
    assert scan.ranges.tolist() == [5.0, math.inf, math.inf]


def test_each_laser_has_its_own_range_max(first_scans, robot_laser_line):
    """4 m is no return for the second laser, although the first one reaches further."""
    scans = first_scans(
        robot_laser_line(1, (1.0, 4.5, 50.0), max_range=50.0),
        robot_laser_line(1, (1.0, 4.0, 2.0), max_range=4.0, laser=2),
    )
    assert scans['/scan'].ranges.tolist() == [1.0, 4.5, math.inf]
    assert scans['/scan_2'].ranges.tolist() == [1.0, math.inf, 2.0]
    assert (scans['/scan'].range_max, scans['/scan_2'].range_max) == (50.0, 4.0)

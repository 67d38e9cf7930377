"""Which readings of a log mean that nothing was hit, and how far the scans reach."""

import math

import numpy as np
import pytest

from ogm_mcmc.geometry import Pose2D
from ogm_mcmc.io.carmen import LogScan
from ogm_mcmc.io.carmen_import import ImportOptions, import_carmen
from ogm_mcmc.io.no_return import laser_range, recognised_codes


@pytest.fixture
def first_scans(write_log, tmp_path, read_bag):
    """Import a log; return {topic: first LaserScan}."""

    def run(*lines, **options):
        import_carmen(write_log(*lines), tmp_path / 'out', ImportOptions(**options))
        topics = read_bag(tmp_path / 'out').topics
        return {name: topics[name][0][1] for name in topics if name.startswith('/scan')}

    return run


def test_codes_of_a_sick_become_inf(first_scans, laser_line):
    odd = [0.0, 1.5, 79.99, 81.79, 81.82, 81.83, 81.87, 81.91, 'nan', 'inf']
    scan = first_scans(laser_line(1, odd + [2.5] * 170))['/scan']
    expected = [0, 1.5, 79.99, 81.79, 81.82, *[math.inf] * 3, math.nan, math.inf]
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


@pytest.mark.parametrize('code', [8.183, 8.187, 8.191])
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


def drive(n_scans, readings, *, step_m=0.1, max_range=0.0, increment_deg=1.0):
    """Scans along x; `readings(k)` of each."""
    return [
        LogScan(
            *(k, 'front', float(k), np.asarray(readings(k)), -math.pi / 2),
            *(math.radians(increment_deg), max_range, Pose2D(step_m * k, 0.0, 0.0)),
        )
        for k in range(n_scans)
    ]


def room(rng, n_beams=180, step_m=0.01):
    """Walls 2 to 12 m away, as a laser counts them."""
    distance = (
        7.0
        + 5.0 * np.sin(np.linspace(0.0, 9.0, n_beams) + rng.uniform(0, 6))
        + rng.normal(0.0, 0.02, n_beams)
    )
    return np.round(np.round(distance / step_m) * step_m, 6)


def with_codes(rng, codes, share=0.1):
    """Readings of a room, some of them codes."""
    ranges = room(rng)
    nothing = rng.random(ranges.size) < share
    ranges[nothing] = rng.choice(codes, int(nothing.sum()))
    return ranges


@pytest.mark.parametrize('code', [50.0, 51.15, 32.767, 80.0, 30.0, 20.0, 65.535, 100.0, 8.19 * 4])
@pytest.mark.parametrize(('n_scans', 'share'), [(1, 0.3), (3, 0.1), (40, 0.01)])
def test_a_code_is_recognised(code, n_scans, share):
    rng = np.random.default_rng(1)
    scans = drive(n_scans, lambda _: with_codes(rng, [code], share))
    reach = laser_range(scans)
    assert reach.rule == 'recognised'
    for scan in scans:
        assert (reach.missing(scan.ranges_m) == (scan.ranges_m == code)).all()
    assert reach.range_max_m == code


def test_a_laser_that_reaches_as_far_as_its_code():
    """Hits up to the last centimetre before 30 m, as outdoors, and 30 m where there is nothing."""
    rng = np.random.default_rng(2)

    def readings(_):
        ranges = np.round(rng.uniform(1.0, 45.0, 180), 2)
        return np.minimum(ranges, 30.0)

    scans = drive(50, readings)
    reach = laser_range(scans)
    hits = np.concatenate([scan.ranges_m[~reach.missing(scan.ranges_m)] for scan in scans])
    assert hits.size == sum((scan.ranges_m < 30.0).sum() for scan in scans)
    assert 29.9 < hits.max() < 30.0


def test_codes_that_tremble():
    """51.15 with neighbours, and 50.0 beside: as a public log has them; 50.5 is a hit."""
    rng = np.random.default_rng(3)
    codes = [51.15] * 90 + [51.14] * 30 + [51.11] * 12 + [51.16] * 2 + [50.0] * 10

    def readings(k):
        hits = np.round(rng.uniform(1.0, 45.0, 160), 2)
        return [*hits, *rng.choice(codes, 20), 50.5 if k == 7 else 2.0]

    scans = drive(60, readings)
    reach = laser_range(scans)
    codes_and_hit = np.array([51.15, 51.14, 51.11, 51.16, 50.0, 50.5, 12.0])
    assert reach.missing(codes_and_hit).tolist() == [True] * 5 + [False] * 2
    assert reach.range_max_m == 50.5


def far_wall(rng, k, noise_m, step_m):
    """Near things, and through a door 11 beams of a flat wall 20 m away; the scan stands still."""
    ranges = np.full(180, 3.0) + np.abs(np.linspace(-1.0, 1.0, 180))
    wall = 20.0 / np.cos(np.radians(np.arange(-5, 6)))
    ranges[80:91] = wall + 0.0 * k
    ranges = ranges + rng.normal(0.0, noise_m, 180) if noise_m else ranges
    return np.round(np.round(ranges / step_m) * step_m, 6)


@pytest.mark.parametrize('noise_m', [0.0, 0.005, 0.02])
@pytest.mark.parametrize('step_m', [0.001, 0.01, 0.1])
@pytest.mark.parametrize('n_scans', [1, 5, 200])
def test_a_robot_that_stands_before_a_far_wall(noise_m, step_m, n_scans):
    rng = np.random.default_rng(4)
    scans = drive(n_scans, lambda k: far_wall(rng, k, noise_m, step_m), step_m=0.0)
    assert recognised_codes(scans) == []


@pytest.mark.parametrize('step_m', [0.01, 0.1])
def test_a_robot_that_drives_towards_a_far_wall(step_m):
    rng = np.random.default_rng(5)
    scans = drive(
        100,
        lambda k: np.where(
            np.arange(180) < 60, np.round((30.0 - 0.1 * k) / step_m) * step_m, room(rng)
        ),
    )
    assert recognised_codes(scans) == []


def through_a_door(side_m, front_m, behind_m, left_m, right_m):
    """Ranges (720,) of a robot in a square room, and through a door the wall of the next one.

    As a lidar that triangulates counts them: in steps of 1 % at 6 m, and of their square.
    """
    angles = np.radians(0.5) * np.arange(720) + 1e-9
    cos, sin = np.cos(angles), np.sin(angles)
    in_door = (cos > 0.0) & (-right_m < front_m * sin / cos) & (front_m * sin / cos < left_m)
    ahead = np.where(in_door, behind_m, np.where(cos > 0.0, front_m, 1.4))
    ranges = np.minimum(ahead / np.abs(cos), np.where(in_door, np.inf, side_m / np.abs(sin)))
    count = 0.06 / 6.0**2
    return 1.0 / (count * np.round(1.0 / (count * ranges)))


@pytest.mark.parametrize(
    'place', [(2.6, 4.4, 9.2, 0.35, 0.55), (2.6, 4.2, 8.9, 0.3, 0.7), (2.1, 4.7, 9.6, 0.5, 0.6)]
)
def test_a_far_wall_stays_where_steps_grow_with_range(place):
    assert recognised_codes(drive(1, lambda _: through_a_door(*place), increment_deg=0.5)) == []


def test_too_little_to_tell():
    """Nine equal readings, and three different ones below many: both stay hits."""
    rng = np.random.default_rng(6)
    nine = drive(9, lambda _: [*room(rng), 50.0])
    assert recognised_codes(nine) == []
    assert recognised_codes([*nine, *drive(1, lambda _: [*room(rng), 50.0])]) != []
    assert recognised_codes(drive(5, lambda _: [1.0, 2.0, 3.0] + [4.0] * 177)) == []


def test_a_parameter_tells_of_few_readings():
    rng = np.random.default_rng(7)
    scans = drive(3, lambda _: [*room(rng), 50.0])
    assert laser_range(scans).rule == 'none found'
    reach = laser_range(scans, parameter_m=50.0)
    assert (reach.rule, reach.range_max_m) == ('named in the log', 50.0)
    assert reach.missing(np.array([49.9, 50.0, 12.0])).tolist() == [False, True, False]


def test_a_parameter_below_real_readings_says_nothing():
    """As with a planner's 10 m in the log of a laser that sees 40 m."""
    scans = drive(3, lambda _: [10.0, 39.0, 40.0])
    assert not laser_range(scans, parameter_m=10.0).missing(np.array([10.0, 39.0, 40.0])).any()


def test_a_laser_that_sees_further_than_a_sick():
    scans = drive(3, lambda _: [81.9, 100.0, 119.0], max_range=120.0)
    reach = laser_range(scans)
    assert not reach.missing(np.array([81.9, 100.0, 119.0])).any()
    assert reach.range_max_m == 120.0


def test_a_chosen_code_wins():
    rng = np.random.default_rng(8)
    scans = drive(20, lambda _: with_codes(rng, [50.0, 81.83]))
    reach = laser_range(scans, chosen_m=60.0)
    assert reach.missing(np.array([50.0, 60.0, 81.83])).tolist() == [False, True, True]
    assert reach.rule == 'chosen'


def test_two_lasers_with_codes_of_their_own(first_scans, laser_line):
    """50 m is nothing in front and a hit behind, where 30 m is nothing."""
    rng = np.random.default_rng(9)
    lines = []
    for k in range(12):
        for kind, code in (('FLASER', 50.0), ('RLASER', 30.0)):
            ranges = with_codes(rng, [code], 0.3).tolist()
            ranges[:2] = [code, 50.0 if kind == 'RLASER' and k == 0 else 2.0]
            lines.append(laser_line(k, ranges, kind=kind))
    scans = first_scans(*lines)
    assert scans['/scan'].ranges[0] == math.inf
    assert scans['/scan'].range_max == 50.0
    assert scans['/scan_rear'].ranges[0] == math.inf
    assert scans['/scan_rear'].ranges[1] == 50.0


@pytest.mark.parametrize(('code', 'reach'), [(300.0, 300.0), (120.0, 120.0), (1e6, 80.0)])
def test_a_code_that_no_laser_reaches_tells_nothing_of_the_reach(code, reach):
    rng = np.random.default_rng(2)
    found = laser_range(drive(5, lambda _: with_codes(rng, [code])))
    assert found.range_max_m == pytest.approx(reach)
    assert found.missing(np.array([code])).all()

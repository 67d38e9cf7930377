"""Values that drivers send in place of "nothing was hit"."""

import math

import numpy as np
import pytest

from ogm_mcmc.engine.range_codes import RangeCodes
from ogm_mcmc.geometry import Scan

BEAMS = 360


def scan_of(ranges, *, range_max=30.0, frame='laser'):
    return Scan.checked(
        ranges,
        angle_min_rad=-math.pi,
        angle_increment_rad=2.0 * math.pi / BEAMS,
        range_min_m=0.1,
        range_max_m=range_max,
        frame_id=frame,
    )


def walls(half_width, half_length, *, noise_m=0.0, step_m=0.0, rng=None, at=(0.0, 0.0)):
    """Ranges (BEAMS,) in a room around (0, 0), from a robot at a place, as float32."""
    angles = -math.pi + 2.0 * math.pi / BEAMS * np.arange(BEAMS) + 1e-9
    cos, sin = np.cos(angles), np.sin(angles)
    to_side = (np.sign(cos) * half_length - at[0]) / cos
    to_end = (np.sign(sin) * half_width - at[1]) / sin
    ranges = np.minimum(to_side, to_end)
    if rng is not None:
        ranges = ranges + rng.normal(0.0, noise_m, BEAMS)
    return np.round(ranges / step_m) * step_m if step_m else ranges


def drive(n_scans, read):
    """What is taken of scans one after the other, and what was said."""
    said = []
    codes = RangeCodes(tell=said.append)
    return [codes.taken(read(k)) for k in range(n_scans)], said


@pytest.mark.parametrize(('code', 'range_max'), [(3.499, 3.5), (29.99, 30.0), (25.0, 30.0)])
@pytest.mark.parametrize('step_m', [0.0, 0.001, 0.01])
def test_a_code_below_range_max_is_no_return_from_the_first_scan_on(code, range_max, step_m):
    """Of 3.499 of 3.5 all were walls around the robot."""
    rng = np.random.default_rng(1)

    def read(k):
        ranges = walls(2.0, 100.0, noise_m=0.01, step_m=step_m, rng=rng, at=(0.05 * k, 0.3))
        return scan_of(np.where(ranges > 0.9 * code, code, ranges), range_max=range_max)

    taken, said = drive(20, read)
    for k, scan in enumerate(taken):
        missing = scan.ranges_m == np.inf
        assert 10 < missing.sum() < BEAMS
        assert np.max(scan.ranges_m[~missing]) < 0.95 * code, k
        assert scan.range_max_m == pytest.approx(code, rel=1e-6)
    assert len(said) == 1
    assert said[0].startswith(f'laser: readings of {code:g} m (')
    assert 'no_return_code' in said[0]


@pytest.mark.parametrize('speed', [0.0, 0.02])
@pytest.mark.parametrize(
    ('noise_m', 'step_m'), [(0.0, 0.0), (0.0, 0.01), (0.0, 0.05), (0.01, 0.01), (0.01, 0.0)]
)
@pytest.mark.parametrize('room', [(3.0, 3.0), (2.0, 20.0), (1.0, 8.0)])
def test_walls_stay_walls(speed, noise_m, step_m, room):
    """Also of a simulated robot that stands still, without noise, in the middle of a room."""
    rng = np.random.default_rng(2) if noise_m else None

    def read(k):
        at = (speed * k, 0.5 * speed * k)
        return scan_of(walls(*room, noise_m=noise_m, step_m=step_m, rng=rng, at=at))

    taken, said = drive(60, read)
    assert not said
    assert not any(np.isinf(scan.ranges_m).any() for scan in taken)


def test_a_round_wall_is_believed_again_once_the_robot_has_moved():
    """From the middle of an arena all readings of its wall are one number."""
    inside = np.linspace(1.0, 4.0, 30)

    def read(k):
        distance = 0.0 if k < 3 else 0.03 * k
        angles = 2.0 * math.pi / BEAMS * np.arange(BEAMS)
        ranges = np.sqrt(64.0 - (distance * np.sin(angles)) ** 2) - distance * np.cos(angles)
        ranges[:30] = inside
        return scan_of(ranges)

    taken, said = drive(70, read)
    assert len(said) == 2
    assert 'surfaces after all' in said[1]
    assert np.isinf(taken[0].ranges_m).any()
    assert not np.isinf(taken[-1].ranges_m).any()


@pytest.mark.parametrize('beams', [12, 120])
@pytest.mark.parametrize('before', [30, 1030, 2000])
def test_a_code_that_comes_late_is_found_within_a_hundred_scans(before, beams):
    """Also where it is 3 % of the readings from there on, and far less of all that came."""
    room = np.linspace(1.0, 2.5, BEAMS)
    small = scan_of(room, range_max=3.5)
    large = scan_of(np.where(np.arange(BEAMS) < beams, 3.499, room), range_max=3.5)
    taken, said = drive(before + 120, lambda k: small if k < before else large)
    assert len(said) == 1
    first = next(k for k, scan in enumerate(taken) if np.isinf(scan.ranges_m).any())
    assert before <= first < before + 110
    assert all(np.isinf(scan.ranges_m[:beams]).all() for scan in taken[first:])


def test_a_code_that_was_found_stays_while_nothing_speaks_against_it():
    room = np.linspace(1.0, 2.5, BEAMS)
    small = scan_of(room, range_max=30.0)
    large = scan_of(np.where(np.arange(BEAMS) < 12, 3.499, room), range_max=30.0)
    said = []
    codes = RangeCodes(tell=said.append)
    for k in range(1500):
        codes.taken(large if 1030 <= k < 1130 else small)
    assert np.isinf(codes.taken(large).ranges_m[:12]).all()
    assert len(said) == 1
    beyond = scan_of(np.linspace(1.0, 9.0, BEAMS), range_max=30.0)
    for _ in range(110):
        codes.taken(beyond)
    assert 'readings of 3.499 m are surfaces after all, and mapped from now on' in said[1]
    assert codes.taken(large) is large


def test_of_two_codes_the_one_that_goes_is_named():
    room = np.linspace(1.0, 3.0, BEAMS)
    both = np.where(np.arange(BEAMS) < 40, 5.0, np.where(np.arange(BEAMS) < 80, 25.0, room))
    between = np.where(np.arange(BEAMS) < 40, 25.0, np.linspace(4.0, 9.0, BEAMS))
    taken, said = drive(40, lambda k: scan_of(both if k < 2 else between))
    assert 'readings of 25, 5 m (22% of them)' in said[0]
    assert 'so many beams of one value look like no surface' in said[0]
    assert said[1].startswith('laser: readings of 5 m are surfaces after all, and mapped from now')
    assert 'readings of 25 m (' in said[1]
    assert len(said) == 2
    assert np.isinf(taken[-1].ranges_m[:40]).all()


def test_scans_taken_before_a_code_was_found_lose_it_when_asked_again():
    codes = RangeCodes()
    before = scan_of(coded())
    other = scan_of(coded(), frame='other')
    assert codes.without_codes(before) is before
    codes.taken(before)
    after = codes.without_codes(before)
    assert np.isinf(after.ranges_m[:90]).all()
    assert codes.without_codes(after) is after
    assert codes.without_codes(other) is other


def coded(code=25.0):
    ranges = np.linspace(1.0, 9.0, BEAMS)
    ranges[:90] = code
    return ranges


def test_each_sensor_has_its_own_code():
    codes = RangeCodes()
    for k in range(3):
        front = codes.taken(scan_of(coded(25.0), frame='front'))
        rear = codes.taken(scan_of(coded(20.0), frame='rear'))
        assert np.isinf(front.ranges_m[:90]).all(), k
        assert np.isinf(rear.ranges_m[:90]).all(), k
        assert (front.range_max_m, rear.range_max_m) == (25.0, 20.0)


def test_a_chosen_code_counts_alone():
    said = []
    codes = RangeCodes(9.0, said.append)
    scan = codes.taken(scan_of(coded()))
    assert np.isinf(scan.ranges_m[:90]).all()
    codes.chosen_m = 30.0
    assert not np.isinf(codes.taken(scan_of(coded())).ranges_m).any()
    assert not said


@pytest.mark.parametrize('code', [29.9, 5.6, 25.0, 3.499])
def test_a_chosen_code_is_what_messages_can_hold_of_it(code):
    """They hold single precision: 29.9 comes as 29.8999996, 5.6 as 5.5999999."""
    ranges = np.full(BEAMS, code, np.float32)
    ranges[::2] = np.nextafter(np.float32(code), np.float32(0.0))
    taken = RangeCodes(chosen_m=code).taken(scan_of(ranges))
    assert np.isinf(taken.ranges_m[1::2]).all()
    assert np.array_equal(taken.ranges_m[::2], ranges[::2])
    assert taken.measured()[::2].all()


def test_a_chosen_code_that_takes_all_readings_is_said_once():
    said = []
    codes = RangeCodes(0.05, said.append)
    for _ in range(3):
        taken = codes.taken(scan_of(np.full(BEAMS, 4.0)))
        assert np.isinf(taken.ranges_m).all()
        assert taken.range_max_m == taken.range_min_m == 0.1
    assert said == [
        'laser: no_return_code is 0.05 m, and range_min 0.1 m: no reading is left; expected a '
        'greater code, or 0'
    ]


def test_a_sensor_without_a_name_is_not_named():
    said = []
    RangeCodes(tell=said.append).taken(scan_of(coded(), frame=''))
    assert [text.startswith('readings of 25 m') for text in said] == [True]


def test_what_was_learned_of_a_recording_holds_from_the_first_scan_on():
    said = []
    codes = RangeCodes(tell=said.append)
    codes.learn(scan_of(coded()) for _ in range(5))
    one = np.linspace(1.0, 9.0, BEAMS)
    one[0] = 25.0
    assert codes.taken(scan_of(one)).ranges_m[0] == np.inf
    for _ in range(40):
        codes.taken(scan_of(np.linspace(1.0, 29.0, BEAMS)))
    assert codes.taken(scan_of(one)).ranges_m[0] == np.inf
    assert len(said) == 1


def test_few_beams_and_scans_beyond_any_lidar_are_let_be():
    few = np.linspace(1.0, 9.0, BEAMS)
    few[:3] = 25.0
    taken, said = drive(8, lambda _: scan_of(few))
    assert not said
    assert (taken[-1].ranges_m[:3] == 25.0).all()
    many = Scan.checked(
        np.tile(coded(), 20),
        angle_min_rad=0.0,
        angle_increment_rad=1e-4,
        range_min_m=0.1,
        range_max_m=30.0,
    )
    assert RangeCodes().taken(many) is many

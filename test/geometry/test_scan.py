import math
import re
from dataclasses import replace

import numpy as np
import pytest

from ogm_mcmc.errors import ScanError
from ogm_mcmc.geometry import Scan
from ogm_mcmc.geometry.reading_kernels import is_informative, is_measured

approx = pytest.approx


def scan(ranges=(1.0, 2.0, 3.0), **change):
    """A good scan of three beams from -1 to 1 rad, except for what is changed."""
    fields = {
        'angle_min_rad': -1.0,
        'angle_increment_rad': 1.0,
        'range_min_m': 0.1,
        'range_max_m': 10.0,
        **change,
    }
    return Scan.checked(np.array(ranges), **fields)


def test_a_good_scan_is_kept_as_it_is():
    good = scan((1.0, math.inf, math.nan), angle_max_rad=1.0, stamp_ns=2**60 + 1, frame_id='laser')
    assert good.ranges_m.dtype == np.float32
    assert good.ranges_m.tolist() == approx([1.0, math.inf, math.nan], nan_ok=True)
    assert (good.angle_min_rad, good.angle_increment_rad) == (-1.0, 1.0)
    assert (good.range_min_m, good.range_max_m) == (0.1, 10.0)
    assert (good.stamp_ns, good.frame_id) == (2**60 + 1, 'laser')


def test_ranges_are_copied_and_writable():
    """A message's buffer may be read-only, and is another type to a kernel then."""
    buffer = np.ones(3, np.float32)
    buffer.flags.writeable = False
    good = Scan.checked(
        buffer, angle_min_rad=0, angle_increment_rad=1, range_min_m=0, range_max_m=5
    )
    assert good.ranges_m.flags.writeable
    assert not np.shares_memory(good.ranges_m, buffer)


def test_whole_numbers_become_floats():
    good = scan(angle_min_rad=0, angle_increment_rad=1, range_min_m=0, range_max_m=5)
    values = good.angle_min_rad, good.angle_increment_rad, good.range_min_m, good.range_max_m
    assert [type(value) for value in values] == [float] * 4


@pytest.mark.parametrize(
    ('change', 'message'),
    [
        ({'ranges': ()}, 'ranges: expected at least one beam, got 0'),
        ({'ranges': [[1.0, 2.0]]}, 'ranges: expected at least one beam'),
        ({'angle_min_rad': math.nan}, 'angle_min nan, angle_increment 1.0: expected finite'),
        ({'angle_increment_rad': math.inf}, 'angle_increment inf: expected finite numbers'),
        ({'angle_increment_rad': 0.0}, 'angle_increment is 0 with 3 ranges'),
        ({'range_min_m': -0.1}, 'range_min -0.1, range_max 10.0: expected 0 <= range_min'),
        ({'range_min_m': 10.0}, 'range_min 10.0, range_max 10.0: expected'),
        ({'range_min_m': math.nan}, 'range_min nan'),
        ({'range_max_m': 0.05}, 'range_min 0.1, range_max 0.05'),
        ({'range_max_m': math.nan}, 'range_max nan'),
        ({'angle_max_rad': -2.0}, 'angle_increment 1 has the wrong sign for angles from -1 to -2'),
        (
            {'angle_increment_rad': 3.3, 'angle_max_rad': 5.6},
            'ranges: 3 of them in steps of 3.3 rad go over 6.6 rad: expected at most one turn',
        ),
    ],
)
def test_refused(change, message):
    with pytest.raises(ScanError, match=message):
        scan(**change)


@pytest.mark.parametrize('angle_max', [0.0, 1.0, 2.0, 0.9999])
def test_drivers_may_leave_the_last_angle_out_or_add_one(angle_max):
    assert scan(angle_max_rad=angle_max).ranges_m.size == 3


@pytest.mark.parametrize(
    ('angle_max', 'remark'),
    [
        (4.0, '3 ranges, but angles from -1 to 4 in steps of 1 make 6: .* are used'),
        (-1.0, '3 ranges, but .* make 1: angle_min and angle_increment are used'),
        (math.nan, 'angle_max is nan: angle_min and angle_increment are used'),
    ],
)
def test_the_increment_counts_where_the_last_angle_disagrees(angle_max, remark):
    remarks = []
    odd = scan(angle_max_rad=angle_max, remark=remarks.append)
    assert odd.directions() == approx(scan().directions())
    assert len(remarks) == 1
    assert re.search(remark, remarks[0])


def test_times_of_the_beams_are_kept():
    remarks = []
    timed = scan(time_increment_s=0.25, scan_time_s=1.0, remark=remarks.append)
    assert (timed.time_increment_s, timed.scan_time_s) == (0.25, 1.0)
    assert timed.flipped().time_increment_s == 0.25
    assert timed.flipped().ranges_m is timed.ranges_m  # beam i is still the i-th
    assert remarks == []
    assert (scan().time_increment_s, scan().scan_time_s) == (0.0, 0.0)


@pytest.mark.parametrize('time_s', [-0.1, math.nan, math.inf, -math.inf, 5.1])
def test_times_that_no_lidar_has_are_not_known(time_s):
    remarks = []
    assert scan(time_increment_s=time_s, remark=remarks.append).time_increment_s == 0.0
    assert scan(scan_time_s=2 * time_s, remark=remarks.append).scan_time_s == 0.0
    assert [text.split(' is ')[0] for text in remarks] == ['time_increment', 'scan_time']


def test_a_sensor_may_not_say_how_far_it_sees():
    assert scan(range_max_m=math.inf).range_max_m == math.inf


def test_a_single_beam_needs_no_increment():
    one = scan((1.0,), angle_increment_rad=0.0, angle_max_rad=-1.0)
    assert one.directions() == approx(np.array([[math.cos(-1.0)], [math.sin(-1.0)]]))


def test_directions_are_unit_vectors_counter_clockwise():
    three = scan(angle_min_rad=0.0, angle_increment_rad=math.pi / 2)
    assert three.directions() == approx(np.array([[1.0, 0.0, -1.0], [0.0, 1.0, 0.0]]), abs=1e-12)


def test_beams_of_a_flipped_scan_run_clockwise():
    three = scan(angle_min_rad=0.25)
    mirrored = three.flipped().directions()
    assert mirrored == approx(three.directions() * np.array([[1.0], [-1.0]]))
    assert three.flipped().flipped() == three
    assert three.flipped().ranges_m is three.ranges_m


def test_directions_are_those_of_this_scan():
    """They are kept from scan to scan: another angle must give other directions."""
    assert not np.array_equal(scan().directions(), scan(angle_min_rad=-0.9).directions())
    assert scan((1.0, 2.0)).directions().shape == (2, 2)
    assert scan().directions() is scan().directions()


def test_bent_beams_keep_their_own_directions():
    even = scan()
    assert even.bearings().tolist() == approx([-1.0, 0.0, 1.0])
    bent = replace(even, bearings_rad=np.array([-1.1, 0.0, 1.3]))
    assert bent.bearings().tolist() == [-1.1, 0.0, 1.3]
    assert bent.directions() == approx(np.array([np.cos([-1.1, 0, 1.3]), np.sin([-1.1, 0, 1.3])]))
    assert bent.flipped().bearings().tolist() == [1.1, 0.0, -1.3]


def test_thinned_beams_are_some_of_them():
    whole = scan((1.0, 2.0, 3.0, 4.0), time_increment_s=0.01)
    for every in (whole, replace(whole, bearings_rad=np.array([0.0, 0.4, 0.5, 1.0]))):
        some = every.thinned(3)
        assert some.ranges_m.tolist() == [1.0, 4.0]
        assert some.ranges_m.flags.c_contiguous
        assert some.bearings() == approx(every.bearings()[[0, 3]])
        assert some.time_increment_s == approx(0.03)


@pytest.mark.parametrize('clears', [False, True])
@pytest.mark.parametrize('furthest', [2.0, math.inf])
def test_what_a_range_says_is_the_same_in_kernels(furthest, clears):
    """REP 117; a sensor that names no range_max does not make of +inf a range it measured."""
    below, above = np.nextafter(np.float32(0.5), 0), np.nextafter(np.float32(2.0), 3)
    ranges = [math.nan, -math.inf, -1.0, -0.0, 0.0, below, 0.5, 1.0, 2.0, above, math.inf]
    one = scan(ranges, range_min_m=0.5, range_max_m=furthest)
    measured = [False] * 6 + [True] * 3 + [furthest == math.inf, False]
    assert one.measured().tolist() == measured
    assert one.informative(no_return_clears=clears).tolist() == [*measured[:-1], clears]
    for reading, met, says in zip(
        one.ranges_m.astype(np.float64), measured, [*measured[:-1], clears], strict=True
    ):
        assert is_measured(reading, 0.5, furthest) == met
        assert is_informative(reading, 0.5, furthest, clears) == says


def test_a_range_of_zero_says_nothing_whatever_the_limits():
    assert scan([0.0, 1e-9], range_min_m=0.0).measured().tolist() == [False, True]

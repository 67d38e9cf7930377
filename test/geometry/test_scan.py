import math

import numpy as np
import pytest

from ogm_mcmc.errors import ScanError
from ogm_mcmc.geometry import Scan

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
        ({'range_max_m': math.inf}, 'range_max inf: expected .* both finite'),
        ({'range_max_m': math.nan}, 'range_max nan'),
        ({'angle_max_rad': math.nan}, 'angle_max is nan: expected a finite number'),
        ({'angle_max_rad': -2.0}, 'angle_increment 1 has the wrong sign for angles from -1 to -2'),
        (
            {'angle_max_rad': 4.0},
            'ranges: 3 of them, but angles from -1 to 4 in steps of 1 make 6',
        ),
        ({'angle_max_rad': -1.0}, 'ranges: 3 of them, but .* make 1'),
    ],
)
def test_refused(change, message):
    with pytest.raises(ScanError, match=message):
        scan(**change)


@pytest.mark.parametrize('angle_max', [0.0, 1.0, 2.0, 0.9999])
def test_drivers_may_leave_the_last_angle_out_or_add_one(angle_max):
    assert scan(angle_max_rad=angle_max).ranges_m.size == 3


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

"""How beams graze surfaces, against lines known."""

import math
from dataclasses import replace

import numpy as np
import pytest
from support.strategies import fan

from ogm_mcmc.geometry.slants import slants_of

STRETCH_M = 0.05


def ranges_to_wall(bearings, distance_m=1.0):
    """Ranges to a wall parallel to the heading, on the left."""
    return distance_m / np.sin(bearings)


@pytest.mark.parametrize(('degrees', 'count'), [(0.25, 20), (1.0, 8), (9.0, 8), (20.0, 4)])
def test_a_straight_wall_is_grazed_at_the_angle_of_the_beam(degrees, count):
    bearings = math.radians(20.0) + math.radians(degrees) * np.arange(count)
    scan = fan(*ranges_to_wall(bearings), bearing=bearings[0], increment=math.radians(degrees))
    angles = np.abs(np.cos(bearings) / np.sin(bearings))
    assert slants_of(scan, STRETCH_M) == pytest.approx(angles, rel=1e-3, abs=1e-6)


def test_readings_further_apart_say_nothing_nor_do_two_of_them():
    bearings = math.radians(30.0) + math.radians(40.0) * np.arange(4)
    scan = fan(*ranges_to_wall(bearings), bearing=bearings[0], increment=math.radians(40.0))
    assert slants_of(scan, STRETCH_M).tolist() == [0.0] * 4
    assert slants_of(fan(1.0, 1.1, increment=0.02), STRETCH_M).tolist() == [0.0, 0.0]


def test_a_step_is_no_grazed_surface():
    """Two round walls: those beside the step are told by their own side."""
    scan = fan(*[1.0] * 9, *[3.0] * 9, bearing=-0.15, increment=math.radians(1.0))
    assert slants_of(scan, STRETCH_M).max() < 0.3
    # One reading of its own has no surface.
    alone = fan(*[3.0] * 9, 1.0, *[3.0] * 9, bearing=-0.15, increment=math.radians(1.0))
    assert slants_of(alone, STRETCH_M)[9] == 0.0
    assert slants_of(alone, STRETCH_M).max() < 0.3


def test_a_corner_is_that_of_its_two_walls_that_is_met_squarer():
    """Wall at x = 1 below, wall at y = 0.2 above: the beam at the corner meets the first."""
    bearings = math.atan2(0.2, 1.0) + math.radians(2.0) * np.arange(-9, 10)
    above = 0.2 / np.sin(np.where(bearings > 0.0, bearings, 1.0))
    ranges = np.where(bearings > bearings[9], above, 1.0 / np.cos(bearings))
    slants = slants_of(fan(*ranges, bearing=bearings[0], increment=math.radians(2.0)), STRETCH_M)
    expected = np.where(bearings > bearings[9], 1.0 / np.tan(bearings), np.abs(np.tan(bearings)))
    clear = np.r_[0:10, 12:19]
    assert slants[clear] == pytest.approx(expected[clear], rel=0.02, abs=0.01)


def test_beside_gaps_what_is_left_tells():
    bearings = math.radians(30.0) + math.radians(2.0) * np.arange(7)
    ranges = ranges_to_wall(bearings)
    ranges[3] = math.inf
    slants = slants_of(fan(*ranges, bearing=bearings[0], increment=math.radians(2.0)), STRETCH_M)
    assert slants[3] == 0.0
    clear = [0, 1, 2, 4, 5, 6]
    assert slants[clear] == pytest.approx(1.0 / np.tan(bearings[clear]), rel=1e-3)
    ranges[1] = math.nan
    alone = fan(*ranges[:4], bearing=bearings[0], increment=math.radians(2.0))
    assert slants_of(alone, STRETCH_M).tolist() == [0.0] * 4


def test_dense_beams_are_compared_a_stretch_apart():
    """A centimetre of noise between neighbours a millimetre apart is no slant."""
    noise = np.random.default_rng(0).normal(0.0, 0.005, 200)
    scan = fan(*(1.0 + noise), bearing=-0.5, increment=math.radians(0.5))
    assert np.median(slants_of(scan, STRETCH_M)) < 0.15


@pytest.mark.parametrize('code', [0.05, 10.5, 81.91])
def test_readings_outside_the_limits_are_no_surface(code):
    """Echoes too near and codes of no return: neither they nor readings beside them have one."""
    ranges = np.array([code] * 4 + [3.0, 3.0] + [code] * 4 + [2.0, 2.02, 2.04, 2.06, 2.08, code])
    within = np.where((ranges > 0.1) & (ranges <= 10.0), ranges, math.inf)
    scan, lost = (
        replace(fan(*one, increment=math.radians(1.0), range_max_m=10.0), range_min_m=0.1)
        for one in (ranges, within)
    )
    found = slants_of(scan, STRETCH_M)
    assert found.tolist() == slants_of(lost, STRETCH_M).tolist()
    assert not found[:10].any()
    # Two beams of a degree are a stretch there.
    assert found[10:15:2].min() > 0.5

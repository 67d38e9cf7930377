import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.naive import beams_of, usable_length
from support.strategies import REPEATABLE, poses, scans

from ogm_mcmc.config import MapperConfig
from ogm_mcmc.errors import GridError
from ogm_mcmc.geometry import CellBox, GridSpec, Pose2D, Scan, cast_rays

approx = pytest.approx

METRE_CELLS = GridSpec(1.0, 64, 64)


def ahead(*ranges, range_min=0.5, range_max=10.0):
    """All beams along the sensor's x axis."""
    return Scan.checked(
        np.array(ranges),
        angle_min_rad=0.0,
        angle_increment_rad=2.0 * math.pi,
        range_min_m=range_min,
        range_max_m=range_max,
    )


def lengths(rays):
    """Length, cells, and hit of each ray along x."""
    ends = rays.ends[0, : rays.n_rays] - rays.x
    return list(zip(ends.tolist(), rays.hit[: rays.n_rays].tolist(), strict=True))


REP_117 = [
    # reading, (length, hit) or None where it says nothing
    (3.0, (3.0, 1)),
    (0.5, (0.5, 1)),
    (10.0, (10.0, 1)),
    (math.inf, (10.0, 0)),
    (-math.inf, None),
    (math.nan, None),
    (0.0, None),
    (-2.0, None),
    (0.25, None),
    (10.5, None),
]


@pytest.mark.parametrize(('reading', 'expected'), REP_117)
def test_rep_117(reading, expected):
    rays = cast_rays(ahead(reading), Pose2D(0.5, 0.5), METRE_CELLS)
    assert lengths(rays) == ([] if expected is None else [expected])


def test_inf_says_nothing_if_ignored_though_no_range_max_is_known():
    rays = cast_rays(
        ahead(math.inf, 3.0, range_max=math.inf),
        Pose2D(0.5, 0.5),
        METRE_CELLS,
        max_range_m=8.0,
        no_return_clears=False,
    )
    assert lengths(rays) == [(3.0, 1)]


@pytest.mark.parametrize(('reading', 'expected'), REP_117)
def test_the_twin_knows_rep_117(reading, expected):
    assert usable_length(reading, ahead(1.0), MapperConfig()) == expected


def test_zero_says_nothing_even_where_range_min_is_zero():
    rays = cast_rays(ahead(0.0, -0.0, 2.0, range_min=0.0), Pose2D(), METRE_CELLS)
    assert lengths(rays) == [(2.0, 1)]


def test_rays_that_say_something_keep_their_order():
    rays = cast_rays(ahead(math.nan, 2.0, 11.0, math.inf, 0.1, 4.0), Pose2D(), METRE_CELLS)
    assert lengths(rays) == [(2.0, 1), (10.0, 0), (4.0, 1)]


def test_longer_than_max_range_clears_up_to_it():
    rays = cast_rays(ahead(3.0, 4.0, 4.5, math.inf), Pose2D(), METRE_CELLS, max_range_m=4.0)
    assert lengths(rays) == [(3.0, 1), (4.0, 1), (4.0, 0), (4.0, 0)]


@pytest.mark.parametrize('max_range', [0.0, 10.0, 50.0])
def test_max_range_never_lengthens(max_range):
    rays = cast_rays(ahead(9.0, 11.0, math.inf), Pose2D(), METRE_CELLS, max_range_m=max_range)
    assert lengths(rays) == [(9.0, 1), (10.0, 0)]


def test_no_return_may_say_nothing():
    """A reading longer than `max_range` still does."""
    scan = ahead(math.inf, 3.0, 6.0)
    rays = cast_rays(scan, Pose2D(), METRE_CELLS, max_range_m=4.0, no_return_clears=False)
    assert lengths(rays) == [(3.0, 1), (4.0, 0)]


def test_a_scan_that_says_nothing():
    rays = cast_rays(ahead(math.nan, -math.inf), Pose2D(), METRE_CELLS)
    assert rays.n_rays == 0


def test_sensor_cell_offset_and_box():
    spec = GridSpec(0.5, 64, 64, column0=-64, row0=0, anchor_x_m=1.0, anchor_y_m=-1.0)
    rays = cast_rays(ahead(3.0), Pose2D(-1.75, 0.125, math.pi / 2), spec)
    assert (rays.column, rays.row) == (-6, 2)
    assert (rays.x, rays.y) == (0.5, 0.25)
    assert rays.ends[:, 0] == approx(np.array([0.5, 6.25]))
    assert rays.box == CellBox(-6, 2, -5, 9)


@given(
    scan=scans(),
    sensor=poses(),
    max_range=st.sampled_from([0.0, 2.5, 6.0, 9.0]),
    no_return=st.sampled_from(['clear', 'ignore']),
    resolution=st.sampled_from([0.05, 0.25, 1.0]),
)
@REPEATABLE
def test_rays_are_those_of_the_twin(scan, sensor, max_range, no_return, resolution):
    config = MapperConfig(resolution=resolution, max_range=max_range, no_return=no_return)
    beams = beams_of(scan, sensor, config)
    rays = cast_rays(
        scan,
        sensor,
        GridSpec(resolution, 1, 1),
        max_range_m=max_range,
        no_return_clears=no_return == 'clear',
    )
    n = rays.n_rays
    assert rays.hit[:n].tolist() == [beam.hit for beam in beams]
    for k, beam in enumerate(beams):
        assert (rays.column + rays.x, rays.row + rays.y) == approx(beam[:2], abs=1e-9)
        end = rays.column + rays.ends[0, k], rays.row + rays.ends[1, k]
        assert end == approx(beam[2:4], abs=1e-9)


@given(scan=scans(), sensor=poses())
@REPEATABLE
def test_box_is_the_smallest_around_the_sensor_and_all_ends(scan, sensor):
    rays = cast_rays(scan, sensor, METRE_CELLS)
    n = rays.n_rays
    columns = [rays.column + math.floor(x) for x in (rays.x, *rays.ends[0, :n])]
    rows = [rays.row + math.floor(y) for y in (rays.y, *rays.ends[1, :n])]
    assert rays.box == CellBox(min(columns), min(rows), max(columns) + 1, max(rows) + 1)


@pytest.mark.parametrize(
    ('x', 'y', 'yaw'), [(-1e-20, 0.5, math.pi), (0.5, -1e-20, -math.pi / 2), (-5e-18, 0.5, 3.0)]
)
def test_a_sensor_hardly_below_a_border_lies_in_its_cell(x, y, yaw):
    """x - floor(x) is 1.0 in floating point for the tiniest negative numbers."""
    rays = cast_rays(ahead(3.0), Pose2D(x, y, yaw), METRE_CELLS)
    assert 0.0 <= rays.x < 1.0
    assert 0.0 <= rays.y < 1.0
    start = math.floor(rays.x) + rays.column, math.floor(rays.y) + rays.row
    assert rays.box.covers(CellBox(*start, start[0] + 1, start[1] + 1))


@given(scan=scans(), cells=st.tuples(st.integers(-40, 40), st.integers(-40, 40)))
@REPEATABLE
def test_moving_by_whole_cells_moves_only_whole_numbers(scan, cells):
    spec = GridSpec(0.25, 64, 64)
    here = cast_rays(scan, Pose2D(0.0625, 0.125, 0.3), spec)
    moved = Pose2D(0.0625 + 0.25 * cells[0], 0.125 + 0.25 * cells[1], 0.3)
    there = cast_rays(scan, moved, spec)
    n = here.n_rays
    assert (there.column - here.column, there.row - here.row) == cells
    assert (there.x, there.y, there.n_rays) == (here.x, here.y, n)
    assert np.array_equal(there.ends[:, :n], here.ends[:, :n])


def test_too_long_for_the_fixed_point_walk():
    scan = ahead(1.0, range_max=2.0**18)
    with pytest.raises(GridError, match=r'range 262144 m is 2.62e\+05 cells .* set max_range'):
        cast_rays(scan, Pose2D(), METRE_CELLS)
    assert cast_rays(scan, Pose2D(), METRE_CELLS, max_range_m=100.0).n_rays == 1


def test_a_sensor_without_range_max_needs_a_limit():
    scan = ahead(1.0, range_max=math.inf)
    with pytest.raises(GridError, match='range_max is inf: expected a finite one; set max_range'):
        cast_rays(scan, Pose2D(), METRE_CELLS)
    assert cast_rays(scan, Pose2D(), METRE_CELLS, max_range_m=100.0).n_rays == 1


@pytest.mark.parametrize('pose', [Pose2D(2.0**40, 0.0), Pose2D(0.0, -1e13)])
def test_too_far_away(pose):
    with pytest.raises(GridError, match='too far from the map to place'):
        cast_rays(ahead(1.0), pose, METRE_CELLS)

"""Which cells a segment crosses: pictures by hand, then the exact twin."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from support import pictures
from support.naive import corner_margin, crossed_cells, crosses
from support.strategies import (
    REPEATABLE,
    exact_slope_segments,
    float_segments,
    segments,
    touchy_segments,
)

from ogm_mcmc.geometry.traversal_kernels import PLAN_SIZE, mark_plan, plan_ray, trace_ray

# Nearer to a corner than this, the fixed-point walk may round to either side (design note).
ROUNDING = 1e-9

any_segment = st.one_of(segments(), exact_slope_segments(), float_segments())


def traced(segment, column=0, row=0):
    """Cells in the order of the walk."""
    x0, y0, x1, y1 = segment
    room = int(abs(x1 - x0) + abs(y1 - y0)) + 8
    columns, rows = np.empty(room, np.int64), np.empty(room, np.int64)
    count = trace_ray(column, row, x0, y0, x1, y1, columns, rows)
    return list(zip(columns[:count].tolist(), rows[:count].tolist(), strict=True))


def marked(segment, column, row, words_per_row, height):
    """Cells marked in an empty bit set."""
    bits = np.zeros(words_per_row * height, np.uint64)
    plan = np.empty(PLAN_SIZE, np.int64)
    plan_ray(column, row, *segment, plan)
    mark_plan(bits, np.uint64(words_per_row), plan)
    words = np.flatnonzero(bits)  # few of them: not all bits are looked at
    shown = np.unpackbits(bits[words].view(np.uint8), bitorder='little').reshape(-1, 64)
    places, within = np.nonzero(shown)
    rows, firsts = np.divmod(words[places], words_per_row)
    return set(zip((64 * firsts + within).tolist(), rows.tolist(), strict=True))


def marked_around(segment):
    """Cells marked in a bit set with room on all sides, so that no walk can leave it."""
    half = 64 * (1 + int(max(abs(value) for value in segment) + 4.0) // 64)
    cells = marked(segment, half, half, 2 * half // 64, 2 * half)
    return {(column - half, row - half) for column, row in cells}


BY_HAND = {
    'along a row': ((0.5, 2.5, 4.5, 2.5), '?????/?????/...../?????/?????'),
    'up a column': ((1.5, 0.5, 1.5, 4.5), '?.???/?.???/?.???/?.???/?.???'),
    # A border belongs to the cells above it and to the right of it.
    'on a row border': ((0.5, 2.0, 3.5, 2.0), '?????/?????/....?/?????/?????'),
    'on a column border': ((3.0, 0.5, 3.0, 2.5), '?????/?????/???.?/???.?/???.?'),
    'border, corner to corner': ((1.0, 1.0, 4.0, 1.0), '?????/?????/?????/?..../?????'),
    'rising through corners': ((0.5, 0.5, 4.5, 4.5), '????./???.?/??.??/?.???/.????'),
    # Falling, each corner itself lies in the cell above and right of it.
    'falling through corners': ((0.5, 3.5, 3.5, 0.5), '?????/..???/?..??/??..?/???.?'),
    'rising, corner to corner': ((0.0, 0.0, 2.0, 2.0), '?????/?????/??.??/?.???/.????'),
    'falling, corner to corner': ((1.0, 3.0, 3.0, 1.0), '?????/?.???/?..??/??..?/?????'),
    'shallow': ((0.5, 0.5, 4.5, 1.5), '?????/?????/?????/??.../...??'),
    'steep': ((0.5, 0.5, 1.5, 4.5), '?.???/?.???/..???/.????/.????'),
    'steep and falling': ((3.25, 4.75, 2.25, 0.75), '???.?/??..?/??.??/??.??/??.??'),
    'ends on a row border': ((0.5, 0.5, 2.5, 2.0), '?????/?????/??.??/?..??/..???'),
    'ends on a column border': ((0.5, 0.5, 2.0, 1.0), '?????/?????/?????/??.??/..???'),
    'a point': ((2.5, 2.5, 2.5, 2.5), '?????/?????/??.??/?????/?????'),
    'a point on a corner': ((2.0, 2.0, 2.0, 2.0), '?????/?????/??.??/?????/?????'),
}


@pytest.mark.parametrize('name', BY_HAND)
@pytest.mark.parametrize('reverse', [False, True])
def test_by_hand(name, reverse):
    (x0, y0, x1, y1), picture = BY_HAND[name]
    segment = (x1, y1, x0, y0) if reverse else (x0, y0, x1, y1)
    expected = picture.replace('/', '\n')
    assert pictures.draw_cells(traced(segment), 5, 5) == expected
    assert pictures.draw_cells(marked(segment, 0, 0, 1, 5), 5, 5) == expected
    assert pictures.draw_cells(crossed_cells(*segment), 5, 5) == expected


@given(segment=segments(reach=6, bits=2))
@REPEATABLE
def test_twin_equals_the_definition(segment):
    """`crossed_cells` against every cell around, asked one by one."""
    around = [(i, j) for i in range(-8, 9) for j in range(-8, 9)]
    assert set(crossed_cells(*segment)) == {c for c in around if crosses(*segment, c)}


@given(segment=exact_slope_segments())
@settings(REPEATABLE, max_examples=500)
def test_exact_slope_equals_twin_even_through_corners(segment):
    expected = crossed_cells(*segment)
    assert traced(segment) == expected
    assert marked_around(segment) == set(expected)


@given(segment=segments())
@settings(REPEATABLE, max_examples=500)
def test_dyadic_segment_equals_twin(segment):
    """With any other slope the walk rounds, which only a corner can show."""
    assume(segment[0] == segment[2] or corner_margin(*segment) > ROUNDING)
    expected = crossed_cells(*segment)
    assert traced(segment) == expected
    assert marked_around(segment) == set(expected)


@given(segment=float_segments())
@REPEATABLE
def test_beam_equals_twin(segment):
    assume(corner_margin(*segment) > ROUNDING)
    expected = crossed_cells(*segment)
    assert traced(segment) == expected
    assert marked_around(segment) == set(expected)


@given(segment=st.one_of(any_segment, touchy_segments()))
@settings(REPEATABLE, max_examples=500)
def test_mark_ray_and_trace_ray_agree_and_reverse(segment):
    """Bit for bit, corners included."""
    x0, y0, x1, y1 = segment
    cells = traced(segment)
    assert marked_around(segment) == set(cells)
    assert len(cells) == len(set(cells))
    assert traced((x1, y1, x0, y0)) == cells[::-1]


@given(segment=st.one_of(any_segment, touchy_segments()))
@REPEATABLE
def test_path_is_connected(segment):
    """Neighbours share an edge, or a corner where the segment passes through it."""
    x0, y0, x1, y1 = segment
    for (column, row), (next_column, next_row) in pairwise(traced(segment)):
        across, up = abs(next_column - column), abs(next_row - row)
        assert max(across, up) == 1
        if across and up:
            corner_x, corner_y = max(column, next_column), max(row, next_row)
            met_at = x0 + (corner_y - y0) / (y1 - y0) * (x1 - x0)
            assert met_at == pytest.approx(corner_x, abs=ROUNDING)


@given(segment=st.one_of(any_segment, touchy_segments()))
@example(segment=(0.0, 0.0, 25.0, -0.6875))
@example(segment=(0.9999999999999964, 0.0, -99.0, -1.2e-14))
@example(segment=(0.0, 0.9999999999999999, 2.9999999999990905, 2.0))
@settings(REPEATABLE, max_examples=300)
def test_both_ends_are_crossed_and_nothing_beyond_them(segment):
    """What `Rays.box` promises; a cell outside of it may lie outside of the array."""
    assert_between_its_ends(segment)


def test_many_ends_a_hair_beside_the_lines_of_the_lattice():
    """As above, drawn in bulk: what touches lines by less than a rounding error."""
    rng = np.random.default_rng(11)
    errors = np.array([0.0, 2.0**-54, 2.0**-53, 2.0**-44, 2.0**-40, 1.1 * 2.0**-39])
    start = np.abs(
        rng.integers(0, 2, (2000, 2)) * math.nextafter(1.0, 0.0) - rng.choice(errors, (2000, 2))
    )
    ends = rng.integers(-100, 101, (2000, 2)) + rng.choice([-1.0, 1.0], (2000, 2)) * rng.choice(
        errors, (2000, 2)
    )
    for (x0, y0), (x1, y1) in zip(start.tolist(), ends.tolist(), strict=True):
        assert_between_its_ends((x0, y0, x1, y1))


def assert_between_its_ends(segment):
    x0, y0, x1, y1 = (math.floor(value) for value in segment)
    cells, marks = traced(segment), marked_around(segment)
    assert (cells[0], cells[-1]) == ((x0, y0), (x1, y1))
    assert {(x0, y0), (x1, y1)} <= marks
    columns, rows = zip(*cells, *marks, strict=True)
    assert min(x0, x1) <= min(columns) <= max(columns) <= max(x0, x1)
    assert min(y0, y1) <= min(rows) <= max(rows) <= max(y0, y1)


def test_beam_down_to_a_sensor_on_a_corner_stays_in_front_of_it():
    """A robot at the origin with a lidar that looks forward: no cell behind it is touched."""
    rng = np.random.default_rng(5)
    behind = 0
    for angle, length in zip(rng.uniform(-1.5, 0.0, 4000), rng.uniform(1, 400, 4000), strict=True):
        x, y = float(length * np.cos(angle)), float(length * np.sin(angle))
        behind += any(column < 0 for column, _ in traced((0.0, 0.0, x, y)))
    assert behind == 0


@given(
    segment=any_segment,
    column=st.integers(-1000, 1000),
    row=st.integers(-1000, 1000),
)
@REPEATABLE
def test_shift_of_the_sensor_cell_commutes(segment, column, row):
    moved = [(i + column, j + row) for i, j in traced(segment)]
    assert traced(segment, column, row) == moved


@given(segment=exact_slope_segments(), columns=st.integers(-9, 9), rows=st.integers(-9, 9))
@REPEATABLE
def test_shift_of_the_coordinates_commutes(segment, columns, rows):
    x0, y0, x1, y1 = segment
    shifted = (x0 + columns, y0 + rows, x1 + columns, y1 + rows)
    assert traced(shifted) == [(i + columns, j + rows) for i, j in traced(segment)]


NEAR_WORD_ENDS = [0, 1, 62, 63, 64, 65, 66, 126, 127, 128, 129, 191]


@pytest.mark.parametrize('first', NEAR_WORD_ENDS)
@pytest.mark.parametrize('last', NEAR_WORD_ENDS)
def test_runs_across_words(first, last):
    """A horizontal ray marks the columns from its start to its end and no neighbour."""
    segment = (0.5, 0.25, last - first + 0.5, 0.25)
    expected = {(column, 1) for column in range(min(first, last), max(first, last) + 1)}
    assert marked(segment, first, 1, 3, 3) == expected


@given(segment=exact_slope_segments(reach=15), column=st.sampled_from([62, 63, 64, 65, 66, 128]))
@REPEATABLE
def test_walks_across_words(segment, column):
    expected = {(i + column, j + 40) for i, j in crossed_cells(*segment)}
    assert marked(segment, column, 40, 3, 80) == expected


@pytest.mark.parametrize('seed', range(6))
def test_long_ray_equals_twin(seed):
    """Several thousand cells; in steps of 1/64 no row is left nearer than 6e-8 to a border."""
    rng = np.random.default_rng(seed)
    start, end = rng.integers(0, 64, 2), rng.integers(-64 * 4000, 64 * 4000, 2)
    segment = tuple(float(value) / 64.0 for value in (*start, *end))
    assert corner_margin(*segment) > ROUNDING
    assert traced(segment) == crossed_cells(*segment)


def test_longest_ray_has_as_many_cells_as_it_crosses_lines():
    """Just below 2**18 cells, between no two corners: one cell more for every line crossed."""
    segment = (0.5, 0.25, -131071.25, 130000.625)
    cells = traced(segment)
    assert (cells[0], cells[-1]) == ((0, 0), (-131072, 130000))
    assert len(cells) == 1 + 131072 + 130000
    assert all(abs(a - c) + abs(b - d) == 1 for (a, b), (c, d) in pairwise(cells))

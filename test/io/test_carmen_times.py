"""Stamps that repeat or go backwards: the plain functions."""

import itertools
import math
from collections import Counter

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ogm_mcmc.errors import ConfigError
from ogm_mcmc.io.carmen_import import ImportOptions
from ogm_mcmc.io.carmen_times import in_order_of_the_file, strictly_increasing

SECOND = 1_000_000_000
MILLISECOND = 1_000_000

# Few distinct times, so that many repeat; a gap of at least 1 ms has room for 40 records.
RECORDS = st.lists(st.tuples(st.integers(0, 12), st.sampled_from('abc')), min_size=1, max_size=40)
STEPS = st.sampled_from([0.0003, 0.001, 0.1, 5.0])


def split(records):
    return [5.0 + 0.001 * ms for ms, _ in records], [kind for _, kind in records]


def original_stamps(records):
    return [5 * SECOND + ms * MILLISECOND for ms, _ in records]


def test_repeats_are_spread_by_the_step():
    order, stamps, repeats = strictly_increasing([1.0, 1.0, 1.0, 9.0], list('aaaa'), 0.1)
    assert order == [0, 1, 2, 3]
    assert stamps == [SECOND, SECOND + SECOND // 10, SECOND + SECOND // 5, 9 * SECOND]
    assert repeats == 2


def test_repeats_stay_before_the_next_stamp():
    order, stamps, repeats = strictly_increasing([1.0, 1.0, 1.0, 1.03], list('aaab'), 0.1)
    assert order == [0, 1, 2, 3]
    assert stamps == [SECOND + k * 10 * MILLISECOND for k in range(4)]
    assert repeats == 2


def test_two_kinds_may_share_a_stamp():
    order, stamps, repeats = strictly_increasing([2.0, 1.0, 2.0], list('aab'), 0.1)
    assert order == [1, 0, 2]
    assert stamps == [SECOND, 2 * SECOND, 2 * SECOND]
    assert repeats == 0


def test_repeating_kinds_are_spread_together_and_others_stay():
    order, stamps, repeats = strictly_increasing([1.0] * 5, list('abacb'), 0.25)
    by_index = dict(zip(order, stamps, strict=True))
    quarters = [(by_index[index] - SECOND) * 4 // SECOND for index in range(5)]
    assert quarters == [0, 1, 2, 0, 3]  # c, index 3, does not repeat
    assert repeats == 2


def test_one_record():
    assert strictly_increasing([3.5], ['a'], 0.1) == ([0], [3 * SECOND + SECOND // 2], 0)


COUNTER = 2.0**32


@pytest.mark.parametrize(
    ('times', 'expected', 'jumps'),
    [
        ([-1.0, -0.5, 0.25], [0, 0.5, 1.25], 0),  # only moved
        ([-1.0, -1.25, -0.5], [0, 0, 0.5], 0),  # a little out of order
        ([-0.5, -2.0, -3.5, -3.0], [0, 0, 0, 0.5], 2),  # runs backwards
        ([COUNTER - 1.0, COUNTER - 0.5, 0.25], [0, 0.5, 1.25], 1),  # a counter starts again
        ([2.0**31 - 1.0, -(2.0**31) + 1.0], [0, 2.0], 1),  # so does a signed one
        ([-1.0, -0.5, COUNTER - 9.0, COUNTER - 8.0], [0, 0.5, 0.5, 1.5], 1),
        ([-1.0, -0.5, 1e300, 0.5, 1.0], [0, 0.5, 0.5, 1.5, 2.0], 2),  # one stray time
        ([-1.0, 1e6, 1e6 + 1.0], [0, 1e6 + 1.0, 1e6 + 2.0], 0),  # days later
    ],
)
def test_times_in_the_order_of_the_file(times, expected, jumps):
    mended = in_order_of_the_file(times)
    assert mended.times_s == pytest.approx(expected)
    assert mended.shift_s == -times[0]
    assert mended.jumps == jumps


@given(times=st.lists(st.floats(-(2.0**33), 2.0**33), min_size=1, max_size=30))
@settings(derandomize=True, deadline=None)
def test_times_never_fall_and_start_at_0(times):
    mended = in_order_of_the_file(times).times_s
    assert mended[0] == 0.0
    assert mended == sorted(mended)


@given(records=RECORDS, step=STEPS)
@settings(derandomize=True, deadline=None)
def test_sorted_and_strictly_increasing_per_kind(records, step):
    times, kinds = split(records)
    order, stamps, repeats = strictly_increasing(times, kinds, step)
    assert sorted(order) == list(range(len(records)))
    assert stamps == sorted(stamps)
    for kind in set(kinds):
        own = [stamp for index, stamp in zip(order, stamps, strict=True) if kinds[index] == kind]
        assert all(before < after for before, after in itertools.pairwise(own))
    assert repeats == sum(count - 1 for count in Counter(records).values())


@given(records=RECORDS, step=STEPS)
@settings(derandomize=True, deadline=None)
def test_order_of_time_and_of_the_file_is_kept(records, step):
    times, kinds = split(records)
    original = original_stamps(records)
    order, _, _ = strictly_increasing(times, kinds, step)
    assert [original[index] for index in order] == sorted(original)
    for kind in set(kinds):
        own = [index for index in order if kinds[index] == kind]
        assert own == sorted(own, key=lambda index: (original[index], index))
    repeating = [index for index in order if Counter(records)[records[index]] > 1]
    assert repeating == sorted(repeating, key=lambda index: (original[index], index))


@given(records=RECORDS, step=STEPS)
@settings(derandomize=True, deadline=None)
def test_repeats_stay_between_their_stamp_and_the_next(records, step):
    times, kinds = split(records)
    original = original_stamps(records)
    order, stamps, _ = strictly_increasing(times, kinds, step)
    for stamp in set(original):
        same = [
            (index, mended)
            for index, mended in zip(order, stamps, strict=True)
            if original[index] == stamp
        ]
        following = min((other for other in original if other > stamp), default=math.inf)
        assert same[0][1] == stamp
        assert all(stamp <= mended < following for _, mended in same)
        gaps = {after[1] - before[1] for before, after in itertools.pairwise(same)} - {0}
        assert all(0 < gap <= round(step * SECOND) for gap in gaps)


@given(
    records=st.lists(
        st.tuples(st.integers(0, 60), st.sampled_from('abc')), min_size=1, max_size=40, unique=True
    )
)
@settings(derandomize=True, deadline=None)
def test_untouched_where_nothing_repeats(records):
    times, kinds = split(records)
    original = original_stamps(records)
    order, stamps, repeats = strictly_increasing(times, kinds, 0.1)
    assert order == sorted(range(len(records)), key=lambda index: original[index])
    assert stamps == sorted(original)
    assert repeats == 0


@given(
    records=st.lists(st.tuples(st.integers(0, 4), st.sampled_from('ab')), min_size=1, max_size=12)
)
@settings(derandomize=True, deadline=None)
def test_increasing_even_where_there_is_no_room(records):
    """Stamps one nanosecond apart: no room to spread in, but still a valid order."""
    times, kinds = [ns * 1e-9 for ns, _ in records], [kind for _, kind in records]
    order, stamps, _ = strictly_increasing(times, kinds, 0.1)
    for kind in set(kinds):
        own = [stamp for index, stamp in zip(order, stamps, strict=True) if kinds[index] == kind]
        assert all(before < after for before, after in itertools.pairwise(own))
    assert stamps == sorted(stamps)


@pytest.mark.parametrize(
    'options',
    [
        {'range_max_m': -1.0},
        {'particles': -1},
        {'no_return_from_m': -1.0},
        {'field_of_view_deg': -1.0},
        {'field_of_view_deg': 361.0},
        {'repeat_step_s': 0.0},
        {'repeat_step_s': -0.1},
    ],
)
def test_options_out_of_bounds(options):
    with pytest.raises(ConfigError, match='expected'):
        ImportOptions(**options)


NUMBERS = ['range_max_m', 'no_return_from_m', 'field_of_view_deg']


@pytest.mark.parametrize('value', [math.nan, math.inf])
@pytest.mark.parametrize('name', [*NUMBERS, 'repeat_step_s', 'time_offset_s'])
def test_options_that_are_not_finite(name, value):
    """`import-carmen --time-offset nan` must end in one line, not in a ValueError later."""
    with pytest.raises(ConfigError, match='expected'):
        ImportOptions(**{name: value})

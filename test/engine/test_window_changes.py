"""What came into a window of scans and what went, by hand."""

from dataclasses import replace

import pytest
from support.strategies import fan

from ogm_mcmc.engine.window_changes import WindowChange, taken_before
from ogm_mcmc.geometry import PlacedScan, Pose2D

A, B, C, D, E = (PlacedScan.at(fan(1.0, 2.0), Pose2D(x, 0.0, 0.0)) for x in range(5))


@pytest.mark.parametrize(
    ('taken', 'wanted', 'stay', 'gone', 'new', 'small'),
    [
        ([], [A], 0, [], [A], False),
        ([A, B], [A, B], 2, [], [], True),
        ([A, B], [A, B, C], 2, [], [C], True),
        ([A, B, C], [B, C, D], 2, [A], [D], True),
        ([A, B, C, D], [A, D], 2, [B, C], [], True),
        ([A, B, C], [C, D], 1, [A, B], [D], False),
        ([A, B], [C], 0, [A, B], [C], False),
        ([A, B], [B, A], 0, [A, B], [B, A], False),
        ([A, B], [A, C, B], 0, [A, B], [A, C, B], False),
        ([A, A], [A, B], 0, [A, A], [A, B], False),
    ],
)
def test_what_stays_and_what_goes(taken, wanted, stay, gone, new, small):
    change = WindowChange.between(taken, wanted)
    found = change.stay, list(map(id, change.gone)), list(map(id, change.new))
    assert found == (stay, list(map(id, gone)), list(map(id, new)))
    assert (change.small, change.extends) == (small, stay > 0 and not gone)


def at_times(*stamps_ns):
    return [PlacedScan.at(replace(fan(1.0, 2.0), stamp_ns=stamp), Pose2D()) for stamp in stamps_ns]


def test_a_scan_that_was_bent_is_known_by_its_stamp_where_that_is_its_own():
    taken = at_times(1, 2, 2, 4)
    bent = at_times(1, 2, 4, 5)
    assert taken_before(taken, bent) == [taken[0], None, taken[3], None]
    assert taken_before(taken, [*at_times(4, 4), taken[1]]) == [None, None, taken[1]]
    other = PlacedScan.at(replace(bent[0].scan, frame_id='other'), Pose2D())
    assert taken_before(taken, [other]) == [None]

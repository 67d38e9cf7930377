"""What came into a window of scans and what went, by hand."""

import pytest
from support.strategies import fan

from ogm_mcmc.engine.window_changes import WindowChange
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

"""Scans that no map holds together with most of the others."""

import numpy as np
import pytest
from support.refinements import scan_at, settings

from ogm_mcmc.config import KeepConfig, RecordingConfig
from ogm_mcmc.engine.recording import Recording
from ogm_mcmc.engine.strays import around_most, too_far_apart
from ogm_mcmc.errors import GridError
from ogm_mcmc.geometry import CellBox
from ogm_mcmc.mapping.log_odds_grid import LogOddsGrid

SAMPLER = settings({'resolution': 0.05})


HERE = [scan_at(0.1 * k, 0.0, 1.0, 1.5, stamp_ns=k) for k in range(5)]
STRAY = scan_at(510.0, 510.0, 1.0, 1.5, stamp_ns=50)


def recording(keep='coverage', **options):
    return Recording(RecordingConfig(KeepConfig(keep=keep)), SAMPLER, **options)


def test_what_a_map_holds_is_what_a_grid_takes():
    for box in (CellBox(-9, 3, 9_900, 9_900), CellBox(0, 0, 10_300, 9_900), CellBox(5, 5, 9, 9)):
        grid = LogOddsGrid(0.05, 100_000_000)
        # Only what is refused is asked of it: the arrays of the others are large.
        if refusal := too_far_apart(box):
            with pytest.raises(GridError, match=refusal):
                grid.cover(box)
    assert too_far_apart(CellBox(0, 0, 10_300, 9_900))
    assert too_far_apart(CellBox(0, 0, 33_000, 5)).endswith('along a side, as Nav2 does')
    assert not too_far_apart(CellBox(0, 0, 9_900, 9_900))
    assert not too_far_apart(CellBox(0, 0, 0, 0))


def test_boxes_around_the_median_are_kept():
    rng = np.random.default_rng(1)
    near = [CellBox(a, b, a + 90, b + 90) for a, b in rng.integers(0, 900, (9, 2)).tolist()]
    far = CellBox(20_000, 20_000, 20_090, 20_090)
    empty = CellBox(0, 0, 0, 0)
    assert around_most([far, *near[:4], empty, *near[4:], far]) == list(range(1, 11))
    assert around_most([near[0], far]) == [1]
    assert around_most([]) == []


@pytest.mark.parametrize('keep', ['coverage', 'latest'])
@pytest.mark.parametrize('bounded', [True, False])
def test_a_stray_among_others_is_refused_and_harms_nothing(keep, bounded):
    kept = recording(keep, bounded=bounded)
    for k in range(4):
        kept.add(HERE[k])
    size = kept.size
    with pytest.raises(GridError, match=r'at \(510.0, 510.0\) m it leads too far from the others'):
        kept.add(STRAY)
    kept.add(HERE[4])
    assert kept.snapshot() == HERE
    assert kept.size.box.n_cells < 2 * size.box.n_cells
    moved = [STRAY, *kept.snapshot()[1:]]
    with pytest.raises(GridError, match='lie too far apart: map would grow to'):
        kept.replace(moved)
    assert kept.snapshot() == HERE


def test_a_stray_that_came_first_goes_when_others_come():
    kept = recording()
    kept.add(STRAY)
    kept.add(HERE[0])
    kept.add(HERE[1])
    assert kept.snapshot() == HERE[:2]
    assert kept.let_go == {'astray': 1}


def test_strays_on_two_sides_do_not_drive_out_the_others():
    kept = recording()
    for k in range(5):
        kept.add(HERE[k])
    kept.add(scan_at(510.0, 0.0, 1.0, 1.5))  # a map of all is long and narrow
    with pytest.raises(GridError, match='it leads too far'):
        kept.add(scan_at(0.0, 512.0, 1.0, 1.5))
    assert len(kept) == 6

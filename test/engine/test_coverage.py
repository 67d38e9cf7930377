"""Which scans cover a building: shares of places and headings, coarser where there is no room."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.strategies import fan

from ogm_mcmc.engine.coverage import VISIT_NS, Coverage, _share, _spread
from ogm_mcmc.geometry import PlacedScan, Pose2D

SECOND = 1_000_000_000
HALF_A_TURN = {'increment': math.pi / 4.0}  # five beams see 225 degrees
ALL_AROUND = {'increment': 2.0 * math.pi / 5.0}


def at(x, y=0.05, yaw=0.0, stamp_s=0.0, kind=HALF_A_TURN, **changes):
    scan = fan(1.0, 1.0, 1.0, 1.0, 1.0, stamp_ns=round(stamp_s * SECOND), **kind, **changes)
    return PlacedScan.at(scan, Pose2D(x, y, yaw))


def test_a_cell_is_a_place_a_heading_and_a_sensor():
    cell = Coverage().cell_of
    assert cell(at(0.01)) == cell(at(0.09))
    assert cell(at(0.01)) != cell(at(0.11))
    assert cell(at(-0.01)) != cell(at(0.01))
    assert cell(at(0.01, yaw=0.05)) != cell(at(0.01, yaw=-0.05))
    assert cell(at(0.01, yaw=-0.05)) == cell(at(0.01, yaw=2.0 * math.pi - 0.05))
    assert cell(at(0.01)) != cell(at(0.01, frame_id='rear'))
    # What looks all around sees the same whatever its heading.
    assert cell(at(0.01, kind=ALL_AROUND)) == cell(at(0.01, yaw=2.0, kind=ALL_AROUND))


@given(counts=st.lists(st.integers(1, 30), min_size=1, max_size=12), total=st.integers(0, 200))
def test_the_share_is_the_largest_that_fits(counts, total):
    fitting = [k for k in range(max(counts) + 1) if sum(min(c, k) for c in counts) <= total]
    assert _share(np.array(counts), total) == max(fitting)


def test_the_scans_of_a_cell_are_spread_over_time():
    held = list(range(100, 110))
    assert _spread(held, 20) == held
    assert _spread(held, 4) == [100, 103, 106, 109]
    assert _spread(held, 2) == [100, 109]
    assert _spread(held, 1) == [109]


def test_crowded_places_go_first():
    """Fifty scans from one place, one from each of ten others."""
    scans = [at(0.05, stamp_s=k) for k in range(50)]
    scans += [at(1.05 + k, stamp_s=50 + k) for k in range(10)]
    coverage = Coverage()
    chosen = coverage.thinned(scans, 30)
    assert (coverage.most, coverage.doublings) == (20, 0)
    assert len(chosen) == 30
    assert chosen[20:] == list(range(50, 60))
    assert chosen == sorted(chosen)


def test_what_does_not_fit_finely_is_held_coarsely_but_all_of_it():
    scans = [at(0.05 + 0.1 * k, stamp_s=k) for k in range(1000)]
    coverage = Coverage()
    chosen = coverage.thinned(scans, 100)
    assert 50 <= len(chosen) <= 100
    assert coverage.cell_m > 1.0
    assert np.diff([0, *chosen, 999]).max() * 0.1 < 2.0 * coverage.cell_m
    assert coverage.most >= 3


def test_cells_are_full_once_it_was_thinned_and_visits_come_in():
    coverage = Coverage()
    scans = [at(0.05, stamp_s=k) for k in range(10)]
    coverage.count_anew(scans)
    assert not coverage.is_full(scans[0])
    chosen = coverage.thinned(scans, 4)
    coverage.count_anew([scans[k] for k in chosen])
    assert coverage.is_full(at(0.02))
    assert not coverage.is_full(at(0.52))
    assert not coverage.is_visit(at(0.05, stamp_s=20.0))
    assert coverage.is_visit(at(0.05, stamp_s=9.0 + VISIT_NS / SECOND))
    coverage.remove(scans[9])
    assert not coverage.is_full(at(0.05))
    coverage.forget()
    assert (coverage.most, coverage.cell_m) == (None, 0.1)


@pytest.mark.parametrize('count', [0, 1])
def test_one_scan_always_stays(count):
    assert Coverage().thinned([at(100.0 * k) for k in range(5000)], count) == [4999]

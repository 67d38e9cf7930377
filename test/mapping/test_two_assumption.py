"""The two-assumption update on paper: small corridors and rooms, literal log-odds."""

import math

import numpy as np
import pytest
from support import pictures
from support.naive import measured_cells
from support.strategies import fan

from ogm_mcmc.config import MapperConfig, StepModelConfig
from ogm_mcmc.errors import GridError
from ogm_mcmc.geometry import CellBox, PlacedScan, Pose2D, PoseBelief
from ogm_mcmc.mapping import TwoAssumptionMapper

approx = pytest.approx

CORRIDOR = CellBox(0, 0, 6, 1)
L_FREE, L_OCC = -0.75, 2.0  # exact in float32, and of different size
STEP = StepModelConfig(l_free=L_FREE, l_occ=L_OCC)
FUSIONS = ['per_scan', 'per_beam']
UNKNOWN = math.nan


def mapper(**settings):
    """A map of 1 m cells, unless said otherwise."""
    return TwoAssumptionMapper(MapperConfig(**{'resolution': 1.0, 'step': STEP, **settings}))


def at(x=0.5, y=0.5, yaw=0.0):
    return PoseBelief(Pose2D(x, y, yaw))


def corridor(method):
    """Log-odds of the six cells."""
    method.grid.cover(CORRIDOR)
    return method.log_odds(CORRIDOR)[0].tolist()


def measured(method):
    return measured_cells(method.log_odds(method.spec.box), method.spec.box)


@pytest.mark.parametrize('fusion', FUSIONS)
def test_corridor_on_paper(fusion):
    """The sensor stands in the first cell, the wall is in the last, then in the fourth."""
    method = mapper(fusion=fusion)
    changed = method.update(PlacedScan(fan(5.0), at()))
    assert changed == CORRIDOR
    assert pictures.draw(method.log_odds(changed)) == '.....#'
    assert corridor(method) == [-0.75, -0.75, -0.75, -0.75, -0.75, 2.0]
    method.update(PlacedScan(fan(3.0), at()))
    assert corridor(method) == [-1.5, -1.5, -1.5, 1.25, -0.75, 2.0]


@pytest.mark.parametrize('fusion', FUSIONS)
def test_no_return_clears_its_last_cell_too(fusion):
    method = mapper(fusion=fusion, max_range=5.0)
    method.update(PlacedScan(fan(math.inf), at()))
    method.update(PlacedScan(fan(7.0), at()))
    assert corridor(method) == [-1.5] * 6


@pytest.mark.parametrize('fusion', FUSIONS)
def test_prior_counts_once(fusion):
    prior = 0.2
    log_odds = math.log(0.25)
    method = mapper(fusion=fusion, prior=prior)
    for _ in range(3):
        method.update(PlacedScan(fan(4.0), at()))
    free, wall = log_odds + 3 * L_FREE, log_odds + 3 * L_OCC
    assert corridor(method) == approx([free] * 4 + [wall, UNKNOWN], nan_ok=True)
    assert method.probabilities(CORRIDOR)[0, 4] == approx(1.0 / (1.0 + math.exp(-wall)))


@pytest.mark.parametrize('fusion', FUSIONS)
def test_one_hit_and_one_equal_miss_is_the_prior_and_yet_measured(fusion):
    method = mapper(fusion=fusion, step=StepModelConfig(l_free=-1.0, l_occ=1.0))
    method.update(PlacedScan(fan(4.0), at()))
    method.update(PlacedScan(fan(5.0), at()))
    assert corridor(method) == [-2.0] * 4 + [0.0, 1.0]
    assert method.probabilities(CORRIDOR)[0, 4] == 0.5


@pytest.mark.parametrize('fusion', FUSIONS)
def test_log_odds_are_limited_and_come_back(fusion):
    method = mapper(fusion=fusion, log_odds_limit=3.5)
    for _ in range(10):
        method.update(PlacedScan(fan(2.0), at()))
    assert corridor(method)[:3] == [-3.5, -3.5, 3.5]
    method.update(PlacedScan(fan(1.0), at()))
    assert corridor(method)[:3] == [-3.5, -1.5, 3.5]
    method.update(PlacedScan(fan(3.0), at()))
    assert corridor(method)[:4] == [-3.5, -2.25, 2.75, 2.0]


@pytest.mark.parametrize('fusion', FUSIONS)
@pytest.mark.parametrize('prior', [0.97, 0.03])
def test_the_limit_holds_for_a_prior_near_it(fusion, prior):
    """`log_odds_limit`: log-odds are kept within plus and minus this; 0.97 is 3.48."""
    method = mapper(fusion=fusion, prior=prior, log_odds_limit=3.5)
    method.update(PlacedScan(fan(3.0), at()))
    assert np.nanmax(np.abs(method.log_odds(CORRIDOR))) <= 3.5


def test_a_hit_beats_a_miss_in_one_scan():
    """One beam ends in the fourth cell, others go on through it: before and after it."""
    method = mapper(fusion='per_scan')
    method.update(PlacedScan(fan(5.0, 3.0, 4.0), at()))
    assert corridor(method) == [L_FREE] * 3 + [L_OCC] * 3


def test_hits_in_one_cell_count_once_in_a_scan():
    method = mapper(fusion='per_scan')
    method.update(PlacedScan(fan(3.0, 3.25, 2.75), at()))
    assert corridor(method) == approx([L_FREE] * 3 + [L_OCC, UNKNOWN, UNKNOWN], nan_ok=True)
    method.update(PlacedScan(fan(3.0), at()))
    assert corridor(method)[3] == 2 * L_OCC


def test_every_beam_counts_per_beam():
    method = mapper(fusion='per_beam')
    method.update(PlacedScan(fan(5.0, 3.0, 3.25), at()))
    assert corridor(method) == [-2.25, -2.25, -2.25, 2 * L_OCC + L_FREE, -0.75, 2.0]


@pytest.mark.parametrize('fusion', FUSIONS)
def test_a_room_drawn_by_hand(fusion):
    """Four beams of a sensor in the middle; the diagonal cells are never seen."""
    method = mapper(fusion=fusion)
    method.update(PlacedScan(fan(2.0, 1.0, 2.0, math.inf, increment=math.pi / 2), at(2.5, 2.5)))
    box = CellBox(0, 0, 5, 5)
    expected = """
        ?????
        ??#??
        #...#
        ??.??
        ??.??
    """
    assert np.array_equal(
        pictures.read(pictures.draw(method.log_odds(box))), pictures.read(expected)
    )
    count = {'per_scan': 1, 'per_beam': 4}[fusion]
    assert method.log_odds(box)[2, 2] == count * L_FREE
    assert np.isnan(method.probabilities(box)).sum() == 25 - 8


@pytest.mark.parametrize('fusion', FUSIONS)
def test_a_map_that_would_be_too_large_is_refused_and_unchanged(fusion):
    method = mapper(fusion=fusion, max_cells=4096)
    method.update(PlacedScan(fan(5.0), at()))
    spec, before = method.spec, method.log_odds(method.spec.box).copy()
    with pytest.raises(GridError, match=r'would grow to 128 x 64 cells: .* max_cells = 4096'):
        method.update(PlacedScan(fan(5.0), at(100.5, 0.5)))
    assert method.spec == spec
    assert np.array_equal(method.log_odds(spec.box), before, equal_nan=True)
    method.update(PlacedScan(fan(5.0), at()))
    assert corridor(method) == [2 * L_FREE] * 5 + [2 * L_OCC]


@pytest.mark.parametrize('fusion', FUSIONS)
def test_a_scan_that_says_nothing_changes_nothing(fusion):
    method = mapper(fusion=fusion)
    spec = method.spec
    assert method.update(PlacedScan(fan(math.nan, -1.0), at(1000.0, 1000.0))).empty
    assert method.spec == spec
    assert measured(method) == {}


@pytest.mark.parametrize('fusion', FUSIONS)
def test_reset_forgets_values_and_extent(fusion):
    method, fresh = mapper(fusion=fusion), mapper(fusion=fusion)
    method.update(PlacedScan(fan(5.0), at(500.5, 0.5)))
    method.reset()
    assert measured(method) == {}
    assert method.spec == fresh.spec
    method.update(PlacedScan(fan(4.0), at()))
    fresh.update(PlacedScan(fan(4.0), at()))
    assert method.spec == fresh.spec
    assert measured(method) == measured(fresh)


def test_probabilities_at_the_ends_of_the_scale():
    """No overflow warning, and no probability outside of 0 to 1."""
    method = mapper(log_odds_limit=1000.0, step=StepModelConfig(l_free=-20.0, l_occ=20.0))
    for _ in range(50):
        method.update(PlacedScan(fan(1.0), at()))
    assert method.probabilities(CellBox(0, 0, 3, 1))[0].tolist() == approx(
        [0.0, 1.0, UNKNOWN], nan_ok=True
    )

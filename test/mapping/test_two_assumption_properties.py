"""The two-assumption update against its naive twin, and what must hold for any scans."""

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from support.naive import NaiveMapper, measured_cells
from support.strategies import REPEATABLE, fan, poses, scans

from ogm_mcmc.config import MapperConfig, StepModelConfig
from ogm_mcmc.errors import GridError
from ogm_mcmc.geometry import CellBox, PlacedScan, Pose2D, PoseBelief
from ogm_mcmc.geometry.traversal_kernels import beam_ends, trace_ray
from ogm_mcmc.mapping import TwoAssumptionMapper
from ogm_mcmc.mapping.two_assumption_kernels import add_misses, fuse_per_beam, fuse_per_scan

approx = pytest.approx

STEP = StepModelConfig(l_free=-0.75, l_occ=2.0)  # exact in float32, and of different size
FUSIONS = ['per_scan', 'per_beam']


def mapper(**settings):
    """A map of 0.1 m cells, unless said otherwise."""
    return TwoAssumptionMapper(MapperConfig(**{'resolution': 0.1, 'step': STEP, **settings}))


def at(x=0.5, y=0.5, yaw=0.0):
    return PoseBelief(Pose2D(x, y, yaw))


def measured(method):
    return measured_cells(method.log_odds(method.spec.box), method.spec.box)


def twin_of(config, placed):
    naive = NaiveMapper(config)
    for scan, sensor in placed:
        naive.update(scan, sensor)
    return naive


def assert_equals_twin(config, placed, naive):
    method = TwoAssumptionMapper(config)
    for scan, sensor in placed:
        method.update(PlacedScan.at(scan, sensor))
    expected, found = naive.log_odds(), measured(method)
    assert set(found) == set(expected)
    assert [found[cell] for cell in expected] == approx(list(expected.values()), abs=1e-4)
    assert not method.grid.free_bits.any()
    assert not method.grid.hit_bits.any()


# Beside the borders of cells, where kernel and twin must agree in every cell.
sensors = poses(3.0).map(lambda p: Pose2D(p.x_m + 0.0123, p.y_m + 0.0171, p.yaw_rad))
placed_scans = st.lists(st.tuples(scans(), sensors), min_size=1, max_size=4)
configs = st.fixed_dictionaries(
    {
        'prior': st.sampled_from([0.5, 0.3]),
        'log_odds_limit': st.sampled_from([100.0, 2.5]),
        'max_range': st.sampled_from([0.0, 3.0]),
        'no_return': st.sampled_from(['clear', 'ignore']),
    }
)


@pytest.mark.parametrize('fusion', FUSIONS)
@given(placed=placed_scans, change=configs)
@settings(REPEATABLE, max_examples=100)
def test_small_scans_equal_twin(fusion, placed, change):
    config = MapperConfig(fusion=fusion, resolution=0.25, step=STEP, **change)
    naive = twin_of(config, placed)
    assume(naive.margin > 1e-9)
    assert_equals_twin(config, placed, naive)


def in_turn_and_together(config, placed):
    """Maps of the same scans, one after the other and all at once."""
    one, all_at_once = TwoAssumptionMapper(config), TwoAssumptionMapper(config)
    scans = [PlacedScan.at(scan, sensor) for scan, sensor in placed]
    for scan in scans:
        one.update(scan)
    assert all_at_once.batch_update() is not None
    changed, added = all_at_once.update_all(scans)
    assert added == len(scans)
    return one, all_at_once, changed


@given(placed=placed_scans, change=configs)
@settings(REPEATABLE, max_examples=25)
def test_scans_taken_together_equal_scans_taken_in_turn(placed, change):
    """Bit for bit: limits and rounding are those of scan after scan."""
    config = MapperConfig(resolution=0.25, **change)
    one, together, box = in_turn_and_together(config, placed)
    assert measured(together) == measured(one)
    assert all(box.covers(CellBox(c, r, c + 1, r + 1)) for c, r in measured(one))
    assert not together.grid.free_bits.any()
    assert not together.grid.hit_bits.any()


@pytest.mark.parametrize('limit', [1000.0, 3.5])
def test_counters_of_misses_that_run_over(limit):
    """More than 255 misses between hits, that reach the limit or do not, and at the end."""
    away, near = fan(2.3, 2.1, increment=0.3), fan(1.2, 1.1, increment=0.3)
    stand = Pose2D(0.513, 0.517, 0.2)
    placed = [(near, stand), *[(away, stand)] * 300, (near, stand), *[(away, stand)] * 520]
    one, together, _ = in_turn_and_together(MapperConfig(log_odds_limit=limit, step=STEP), placed)
    assert measured(together) == measured(one)
    assert (min(measured(one).values()) == -limit) == (limit < 1000.0)


def test_a_scan_too_many_leaves_the_map_as_it_was():
    method = mapper(max_cells=40_000)
    scans = [PlacedScan.at(fan(2.0), Pose2D(x, 0.0)) for x in (0.0, 1.0, 900.0)]
    with pytest.raises(GridError, match='expected at most max_cells'):
        method.update_all(scans)
    assert measured(method) == {}
    method.update_all(scans[:2], lambda: True)  # cancelled before the first
    assert measured(method) == {}
    method.update_all(scans[:2])
    assert len(measured(method)) == 31  # 2 m and 3 m from 0 on, one cell a decimetre


@pytest.mark.parametrize('fusion', FUSIONS)
def test_whole_scans_equal_twin(fusion):
    """Dense scans of a sensor that moves on: beams share cells and words of the bit set."""
    rng = np.random.default_rng(3)
    placed = []
    for k in range(3):
        scan = fan(*rng.uniform(0.5, 14.0, 90), bearing=-2.0, increment=math.radians(3))
        placed.append((scan, Pose2D(0.1 + 1.73 * k, -0.3, 0.7 * k)))
    config = MapperConfig(fusion=fusion, resolution=0.25, step=STEP)
    naive = twin_of(config, placed)
    assert naive.margin > 1e-9
    assert_equals_twin(config, placed, naive)


def room(seed, count, spread=4.0):
    """Scans from places inside a few metres."""
    rng = np.random.default_rng(seed)
    return [
        (
            fan(*rng.uniform(0.3, 9.0, 60), bearing=-3.0, increment=0.1),
            at(*rng.uniform(-spread, spread, 2), rng.uniform(-3, 3)),
        )
        for _ in range(count)
    ]


@pytest.mark.parametrize('fusion', FUSIONS)
@pytest.mark.parametrize('seed', [1, 2])
def test_the_order_of_scans_does_not_matter(fusion, seed):
    """Exactly so: with these steps every sum is exact in float32."""
    placed = room(seed, 8)
    there, back = mapper(fusion=fusion), mapper(fusion=fusion)
    for one, other in zip(placed, reversed(placed), strict=True):
        there.update(PlacedScan(*one))
        back.update(PlacedScan(*other))
    assert measured(there) == measured(back)


@pytest.mark.parametrize('fusion', FUSIONS)
def test_cells_outside_the_returned_box_keep_their_values(fusion):
    method = mapper(fusion=fusion)
    for scan, belief in room(3, 10):
        before = measured(method)
        box = method.update(PlacedScan(scan, belief))
        after = measured(method)
        for cell in set(before) | set(after):
            if before.get(cell) != after.get(cell):
                assert box.covers(CellBox(*cell, cell[0] + 1, cell[1] + 1))


@pytest.mark.parametrize('fusion', FUSIONS)
def test_a_map_that_grew_equals_one_that_was_large_from_the_start(fusion):
    """Bit for bit, and with the window's word borders elsewhere."""
    grown, large = mapper(fusion=fusion), mapper(fusion=fusion)
    large.grid.cover(CellBox(-1100, -1100, 1300, 1200))
    windows = set()
    for scan, belief in room(4, 12, spread=60.0):
        assert grown.update(PlacedScan(scan, belief)) == large.update(PlacedScan(scan, belief))
        windows.add(grown.spec)
    assert len(windows) > 3
    box = grown.spec.box
    assert np.array_equal(grown.log_odds(box), large.log_odds(box), equal_nan=True)
    assert measured(grown) == measured(large)


@pytest.mark.jit
def test_one_specialization_of_each_kernel():
    """Every other setting, or whole numbers for floats, must not compile anything again."""
    for fusion in FUSIONS:
        for change in (
            {},
            {'resolution': 1, 'prior': 0.25, 'max_range': 7.5, 'no_return': 'ignore'},
            {'max_range': 5},
            {'log_odds_limit': 50, 'step': StepModelConfig(l_free=-1, l_occ=1)},
        ):
            method = mapper(fusion=fusion, **change)
            method.update(PlacedScan(fan(1.0, math.inf, math.nan, increment=0.3).flipped(), at()))
            method.update(PlacedScan.at(fan(2.0), Pose2D(3, -2, 1)))
            method.reset()
            method.update(PlacedScan(fan(2.0), at(-70.5, 9.25, 2.0)))
    for kernel in (beam_ends, fuse_per_scan, fuse_per_beam):
        assert len(kernel.signatures) == 1, (kernel.__name__, kernel.signatures)
    # Called from other kernels: nothing to be compiled where those came from the cache.
    for kernel in (trace_ray, add_misses):
        assert len(kernel.signatures) <= 1, (kernel.__name__, kernel.signatures)

"""The adaptive map against the regular grid and its naive twin, whatever the scans."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from support.naive import measured_cells
from support.naive_adaptive import NaiveAdaptive
from support.quadtrees import NO_MERGING, STEP, leaves_of
from support.strategies import REPEATABLE, fan, poses, scans

from ogm_mcmc.config import AdaptiveConfig, MapperConfig
from ogm_mcmc.geometry import PlacedScan, Pose2D, PoseBelief, PoseSamples
from ogm_mcmc.mapping import AdaptiveMapper, TwoAssumptionMapper
from ogm_mcmc.mapping.quadtree_kernels import FREED, ROWS

approx = pytest.approx

FUSIONS = ['per_scan', 'per_beam']

UNKNOWN = math.nan

placed_scans = st.lists(
    st.tuples(
        scans(), poses(5.0).map(lambda p: Pose2D(p.x_m + 0.0123, p.y_m + 0.0171, p.yaw_rad))
    ),
    min_size=1,
    max_size=5,
)


REGULAR = [
    {'coarsest_level': 0},
    {'coarsest_level': 3, 'significance': 1.0, **NO_MERGING},
    {'coarsest_level': 5, 'significance': 1.0, 'unknowns': False, **NO_MERGING},
]


@pytest.mark.parametrize('fusion', FUSIONS)
@pytest.mark.parametrize('tree', REGULAR, ids=['one level', 'forced depth 3', 'forced depth 5'])
@given(placed=placed_scans, prior=st.sampled_from([0.5, 0.2]))
@settings(REPEATABLE, max_examples=40)
def test_forced_full_depth_is_the_regular_grid(tree, fusion, placed, prior):
    config = MapperConfig(
        resolution=0.1, fusion=fusion, prior=prior, adaptive=AdaptiveConfig(**tree)
    )
    adaptive, regular = AdaptiveMapper(config), TwoAssumptionMapper(config)
    for scan, sensor in placed:
        adaptive.update(PlacedScan.at(scan, sensor))
        regular.update(PlacedScan.at(scan, sensor))
    found = measured_cells(adaptive.log_odds(adaptive.spec.box), adaptive.spec.box)
    expected = measured_cells(regular.log_odds(regular.spec.box), regular.spec.box)
    if fusion == 'per_scan':
        assert found == expected  # bit for bit
    else:
        assert found == approx(expected, abs=1e-4)


TOUCHY = {
    'at the origin': Pose2D(),
    'hardly below, looking back': Pose2D(-1e-20, 0.51, math.pi),
    'hardly below, looking down': Pose2D(0.51, -1e-20, -math.pi / 2),
    'hardly turned': Pose2D(0.25, 0.0, -1e-309),
    'on the corner of a tile': Pose2D(32.0, -32.0, math.pi / 4),
    'far away': Pose2D(2.0**18 + 0.5, -(2.0**18), 2.0),
}


@pytest.mark.parametrize('fusion', FUSIONS)
@pytest.mark.parametrize('tree', REGULAR, ids=['one level', 'forced depth 3', 'forced depth 5'])
@pytest.mark.parametrize('sensor', TOUCHY.values(), ids=TOUCHY)
def test_forced_full_depth_where_rounding_decides(sensor, tree, fusion):
    config = MapperConfig(resolution=1.0, fusion=fusion, adaptive=AdaptiveConfig(**tree))
    adaptive, regular = AdaptiveMapper(config), TwoAssumptionMapper(config)
    scan = fan(*np.linspace(10.0, 20.0, 60), math.inf, bearing=-0.05, increment=0.05 / 30)
    # Without the compiler numpy says aloud that a slope is infinite, as is meant.
    with np.errstate(over='ignore'):
        for method in (adaptive, regular):
            method.update(PlacedScan.at(scan, sensor))
    found = measured_cells(adaptive.log_odds(adaptive.spec.box), adaptive.spec.box)
    expected = measured_cells(regular.log_odds(regular.spec.box), regular.spec.box)
    assert found == approx(expected, abs=1e-4)


@given(
    placed=placed_scans,
    fusion=st.sampled_from(FUSIONS),
    unknowns=st.booleans(),
    way_to_hit=st.booleans(),
    merging=st.booleans(),
    count_limit=st.sampled_from([3.0, 1000.0]),
)
@settings(REPEATABLE, max_examples=60)
def test_equals_the_naive_twin(placed, fusion, unknowns, way_to_hit, merging, count_limit):
    """Two poses a scan, of unequal weight; the same leaves, log-odds and counts."""
    tree = AdaptiveConfig(
        coarsest_level=3,
        unknowns=unknowns,
        way_to_hit=way_to_hit,
        count_limit=count_limit,
        **({'merge_spread': 0.05, 'merge_margin': 0.25} if merging else NO_MERGING),
    )
    config = MapperConfig(resolution=0.25, fusion=fusion, step=STEP, adaptive=tree)
    method, naive = AdaptiveMapper(config), NaiveAdaptive(config)
    for scan, sensor in placed:
        other = Pose2D(sensor.x_m + 0.217, sensor.y_m - 0.131, sensor.yaw_rad + 0.1)
        cloud = PoseSamples(
            np.array([[p.x_m, p.y_m, p.yaw_rad] for p in (sensor, other)]), np.array([0.75, 0.25])
        )
        method.update(PlacedScan(scan, PoseBelief(sensor, particles=cloud)))
        naive.update(scan, [(sensor, 0.75), (other, 0.25)])
    assume(naive.margin > 1e-6)
    expected = {
        leaf: (
            UNKNOWN if content.log_odds is None else content.log_odds,
            content.hits,
            content.misses,
        )
        for leaf, content in naive.leaves.items()
    }
    found = leaves_of(method)
    assert found.keys() == expected.keys()
    for leaf, content in found.items():
        assert content == approx(expected[leaf], abs=1e-4, nan_ok=True)


@given(placed=placed_scans)
@settings(REPEATABLE, max_examples=40)
def test_leaves_tile_the_area_once(placed):
    """Every cell of a tile with a root lies in exactly one leaf, and reads as that leaf."""
    method = AdaptiveMapper(MapperConfig(resolution=0.1))
    for scan, sensor in placed:
        method.update(PlacedScan.at(scan, sensor))
    box = method.tree.box
    count = np.zeros((box.row1 - box.row0, box.column1 - box.column0), int)
    value = np.full(count.shape, np.nan, np.float32)
    for (level, column, row), (log_odds, _, _) in leaves_of(method).items():
        side = 2**level
        top, left = row * side - box.row0, column * side - box.column0
        count[top : top + side, left : left + side] += 1
        value[top : top + side, left : left + side] = log_odds
    side = 2**method.tree.coarsest
    rooted = np.kron(method.tree.table >= 0, np.ones((side, side), int))
    assert np.array_equal(count, rooted)
    assert np.array_equal(method.log_odds(method.spec.box), value, equal_nan=True)
    statistics = method.statistics()
    assert statistics.leaves == len(leaves_of(method))
    assert statistics.measured_cells == int((~np.isnan(value)).sum())
    assert sum(n * 4**k for k, n in enumerate(statistics.leaves_by_level)) == count.sum()
    used = int(method.tree.counters[ROWS])
    assert statistics.nodes == int((method.tree.tree.parent[:used] != FREED).sum())


@given(placed=placed_scans, level=st.integers(1, 4))
@settings(REPEATABLE, max_examples=30)
def test_a_coarser_output_is_the_mean_of_the_measured_cells(placed, level):
    config = MapperConfig(resolution=0.1)
    fine = AdaptiveMapper(config)
    coarse = AdaptiveMapper(replace(config, adaptive=AdaptiveConfig(output_level=level)))
    for scan, sensor in placed:
        fine.update(PlacedScan.at(scan, sensor))
        box = coarse.update(PlacedScan.at(scan, sensor))
        assert coarse.spec.box.covers(box)
    assert coarse.spec.resolution_m == approx(0.1 * 2**level)
    values = fine.log_odds(fine.spec.box).astype(float)
    side = 2**level
    blocks = values.reshape(coarse.spec.height, side, coarse.spec.width, side)
    known = (~np.isnan(blocks)).sum(axis=(1, 3))
    with np.errstate(invalid='ignore'):
        expected = np.nansum(blocks, axis=(1, 3)) / known
    assert coarse.log_odds(coarse.spec.box) == approx(expected, abs=1e-4, nan_ok=True)

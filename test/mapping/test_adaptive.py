"""The adaptive map on worked examples: splitting, merging, samples of poses, and its limits."""

import math
from dataclasses import replace

import numpy as np
import pytest
from support.naive import measured_cells
from support.quadtrees import L_FREE, L_OCC, NO_MERGING, STEP, leaves_of
from support.strategies import fan

from ogm_mcmc.config import AdaptiveConfig, MapperConfig, PoseUncertainConfig
from ogm_mcmc.errors import ConfigError, GridError
from ogm_mcmc.geometry import CellBox, PlacedScan, Pose2D, PoseBelief, PoseSamples
from ogm_mcmc.mapping import AdaptiveMapper
from ogm_mcmc.mapping.adaptive import chi_square_limit
from ogm_mcmc.mapping.quadtree_counting_kernels import count_seen, count_unknowns, mark_again
from ogm_mcmc.mapping.quadtree_kernels import (
    ROWS,
    apply_evidence,
    merge_leaves,
    plant,
    split_leaves,
)
from ogm_mcmc.mapping.quadtree_view_kernels import fill_log_odds

approx = pytest.approx

FUSIONS = ['per_scan', 'per_beam']

UNKNOWN = math.nan


def mapper(*, fusion='per_scan', prior=0.5, limit=100.0, max_cells=10**8, **tree):
    """A map of 1 m cells with leaves of up to 8 cells that never merge, unless said otherwise."""
    tree = {'coarsest_level': 3, **NO_MERGING, **tree}
    return AdaptiveMapper(
        MapperConfig(
            resolution=1.0,
            step=STEP,
            fusion=fusion,
            prior=prior,
            log_odds_limit=limit,
            max_cells=max_cells,
            adaptive=AdaptiveConfig(**tree),
        )
    )


def at(x=0.5, y=0.5, yaw=0.0):
    return PoseBelief(Pose2D(x, y, yaw))


def same(one, other):
    """Whether two results of `leaves_of` agree in every number, nan included."""
    return one.keys() == other.keys() and all(
        np.array_equal(one[leaf], other[leaf], equal_nan=True) for leaf in one
    )


def log_odds_of(method):
    return {leaf: content[0] for leaf, content in leaves_of(method).items()}


# -- splitting, on paper ------------------------------------------------------------------------


def test_critical_values_are_those_of_the_tables():
    assert chi_square_limit(0.05, 1) == approx(3.841458820694124)
    assert chi_square_limit(0.05, 2) == approx(5.991464547107979)
    assert chi_square_limit(0.01, 1) == approx(6.634896601021213)
    assert chi_square_limit(1.0, 1) == chi_square_limit(1.0, 2) == 0.0
    assert chi_square_limit(0.0, 2) == math.inf


def test_an_open_area_stays_one_leaf():
    """Four beams cross the tile (0..7) x (0..7) and end far behind it."""
    method = mapper()
    changed = method.update(PlacedScan(fan(12.0, 12.0, bearing=0.1, increment=0.1), at()))
    assert log_odds_of(method)[3, 0, 0] == L_FREE
    assert changed == CellBox(0, 0, 16, 8)
    assert (
        method.probabilities(CellBox(0, 0, 8, 8)).tolist()
        == [[approx(1.0 / (1.0 + math.exp(0.75)))] * 8] * 8
    )


def test_perfect_agreement_is_no_contradiction():
    """A plain chi-square test refuses 0 hits of 1000 beams where 2 % are expected."""
    method = mapper(merge_free=0.05)
    for _ in range(100):
        method.update(PlacedScan(fan(*[12.0] * 10), at()))
    assert leaves_of(method)[3, 0, 0] == (-75.0, 0.0, 1000.0)


def test_a_wall_is_found_level_by_level():
    """Ten beams end in cell (5, 0): seven eighths of the tile's side are seen to be free.

    10 hits, 10 * 5/8 misses against 2 % noise: split. So is the child with 10 * 1/4 misses; the
    one of two cells has 10 * 1/2, and its own children agree with themselves.
    """
    method = mapper()
    method.update(PlacedScan(fan(*[5.0] * 10), at()))
    assert log_odds_of(method) == approx(
        {
            (2, 0, 0): L_FREE,
            (2, 0, 1): UNKNOWN,
            (2, 1, 1): UNKNOWN,
            (1, 3, 0): UNKNOWN,
            (1, 2, 1): UNKNOWN,
            (1, 3, 1): UNKNOWN,
            (0, 4, 0): L_FREE,
            (0, 5, 0): L_OCC,
            (0, 4, 1): UNKNOWN,
            (0, 5, 1): UNKNOWN,
        },
        nan_ok=True,
    )


def test_as_printed_a_wall_at_the_far_side_fills_the_leaf():
    """[pose] VI-A counts such beams as hits and nothing else: no contradiction."""
    method = mapper(way_to_hit=False)
    method.update(PlacedScan(fan(*[5.0] * 10), at()))
    assert leaves_of(method) == {(3, 0, 0): (L_OCC, 10.0, 0.0)}


@pytest.mark.parametrize('unknowns', [True, False])
def test_unknowns_split_what_is_seen_in_part(unknowns):
    """[pose] Fig. 3: of ten beams into the tile right of the sensor's five are stopped before.

    Hits and misses alone see 5 misses and call the tile free.
    """
    method = mapper(unknowns=unknowns, way_to_hit=False)
    upper, lower = fan(*[20.0] * 5, bearing=0.25, increment=1e-3), fan(*[4.0] * 5)
    scan = replace(upper, ranges_m=np.concatenate((lower.ranges_m, upper.ranges_m)))
    # Beams 0 to 4 look along the axis, 5 to 9 a quarter radian up.
    scan = replace(scan, angle_min_rad=0.0, angle_increment_rad=0.25 / 5)
    scan.ranges_m[:5] = 4.0
    method.update(PlacedScan(scan, at()))
    right = {leaf: value for leaf, value in log_odds_of(method).items() if leaf[1] << leaf[0] >= 8}
    assert ((3, 1, 0) in right) is not unknowns


def test_children_inherit_and_start_to_count_anew():
    method = mapper()
    for _ in range(3):
        method.update(PlacedScan(fan(12.0), at()))
    assert leaves_of(method)[3, 0, 0] == (3 * L_FREE, 0.0, 3.0)
    method.update(PlacedScan(fan(6.0), at()))
    found = leaves_of(method)
    assert found[2, 0, 1] == (3 * L_FREE, 0.0, 0.0)  # not seen this time
    assert found[2, 0, 0] == (4 * L_FREE, 0.0, 1.0)
    assert found[1, 3, 0] == (3 * L_FREE + L_OCC, 1.0, 0.0)


def test_unknowns_are_forgotten_and_hits_and_misses_kept():
    method = mapper(significance=0.0)
    for count in (1, 2, 3):
        method.update(PlacedScan(fan(4.0, 12.0), at()))
        assert leaves_of(method)[3, 0, 0][1:] == (count, count * 1.5)
    assert not any(method.tree.tree.slot >= 0)


def test_what_is_new_in_a_leaf_is_noticed_after_any_time():
    """Counts shrink to 100 beams, so 9 hits are 8 %; against 5000 they would be noise."""
    for limit, kept in ((100.0, False), (1e6, True)):
        method = mapper(count_limit=limit)
        for _ in range(500):
            method.update(PlacedScan(fan(*[12.0] * 10), at()))
        assert leaves_of(method)[3, 0, 0][1:] == (0.0, approx(min(limit, 5000.0)))
        method.update(PlacedScan(fan(*[6.0] * 9), at()))
        assert ((3, 0, 0) in leaves_of(method)) is kept


def test_finest_level_is_kept():
    method = mapper(finest_level=2, significance=1.0)
    method.update(PlacedScan(fan(5.0), at()))
    assert {leaf[0] for leaf in leaves_of(method)} == {2}
    assert method.log_odds(CellBox(0, 0, 8, 1))[0].tolist() == [L_FREE] * 4 + [L_OCC] * 4


# -- merging, on paper --------------------------------------------------------------------------


def four_leaves(values, hits=(1.0, 2.0, 3.0, 4.0), misses=(0.0, 0.0, 0.0, 0.0), **tree):
    """One tile of 2 x 2 cells, split, with given log-odds, then touched by one tiny beam."""
    method = mapper(coarsest_level=1, **tree)
    method.update(PlacedScan(fan(*[1.0] * 5), at()))
    arrays = method.tree.tree
    first = int(arrays.first_child[method.tree.table[0, 0]])
    arrays.log_odds[first : first + 4] = values
    arrays.log_odds[first] -= L_OCC  # comes with the next beam
    arrays.hits[first : first + 4] = hits
    arrays.misses[first : first + 4] = misses
    return method


@pytest.mark.parametrize(
    ('values', 'rules', 'merged'),
    [
        # all below: p 0.018 to 0.047
        ([-4.0, -3.0, -3.5, -3.2], {'merge_free': 0.05}, True),
        ([-4.0, -2.9, -3.5, -3.2], {'merge_free': 0.05}, False),  # p 0.052
        # all above
        ([4.0, 3.0, 9.0, 90.0], {'merge_occupied': 0.95}, True),
        ([4.0, 2.9, 9.0, 90.0], {'merge_occupied': 0.95}, False),
        # alike and certain: p 0.119, 0.119, 0.109, 0.109, deviation 0.005
        ([-2.0, -2.0, -2.1, -2.1], {'merge_spread': 0.01, 'merge_margin': 0.12}, True),
        ([-2.0, -2.0, -2.1, -2.1], {'merge_spread': 0.01, 'merge_margin': 0.1}, False),
        ([-2.0, -2.0, -2.1, -2.1], {'merge_spread': 0.004, 'merge_margin': 0.12}, False),
        ([2.0, 2.0, 2.1, 2.1], {'merge_spread': 0.01, 'merge_margin': 0.12}, True),
        # never measured in part
        ([-4.0, -4.0, -4.0, UNKNOWN], {'merge_free': 0.4, 'merge_spread': 0.4}, False),
    ],
)
def test_merge_rules(values, rules, merged):
    method = four_leaves(values, **rules)
    changed = method.update(PlacedScan(fan(0.1), at()))
    found = leaves_of(method)
    if merged:
        assert found == {(1, 0, 0): (approx(sum(values) / 4, rel=1e-6), 11.0, 0.0)}
        assert changed == CellBox(0, 0, 2, 2)
    else:
        assert {leaf[0] for leaf in found} == {0}
        assert changed == CellBox(0, 0, 1, 1)


@pytest.mark.parametrize(
    ('hits', 'misses', 'merged'),
    [
        # 3 of 100 against 2 %: chi-square 0.51; 5 of 100: 4.6
        ((1.0, 1.0, 1.0, 0.0), (24.0, 24.0, 24.0, 24.0), True),
        ((1.0, 1.0, 2.0, 1.0), (23.0, 24.0, 24.0, 23.0), False),
    ],
)
def test_siblings_that_the_next_scan_would_split_do_not_merge(hits, misses, merged):
    method = four_leaves([-4.0] * 4, (hits[0] - 1.0, *hits[1:]), misses, merge_free=0.05)
    method.update(PlacedScan(fan(0.1), at()))
    assert ({leaf[0] for leaf in leaves_of(method)} == {1}) is merged


def test_merging_undoes_splitting():
    """A thing that came and went, three times: one leaf again, and no new rows for it."""
    method = mapper(merge_free=0.05, limit=6.0, count_limit=100.0)
    rows = []
    for _ in range(9):
        for _ in range(400):
            method.update(PlacedScan(fan(12.0, 12.0, increment=0.15), at()))
        assert leaves_of(method)[3, 0, 0][0] == approx(-6.0)
        rows.append(int(method.tree.counters[ROWS]))
        for _ in range(3):
            method.update(PlacedScan(fan(*[6.0] * 5), at()))
        assert (1, 3, 0) in leaves_of(method)
    assert rows[4:] == rows[4:5] * 5, 'rows of merged leaves are not used again'


# -- beliefs ------------------------------------------------------------------------------------


def test_counts_and_log_odds_are_weighted_by_the_samples():
    """Three quarters say that the wall is in cell 5, one quarter in cell 6."""
    method = mapper(coarsest_level=0)
    cloud = PoseSamples(np.array([[0.5, 0.5, 0.0], [1.5, 0.5, 0.0]]), np.array([0.75, 0.25]))
    method.update(PlacedScan(fan(5.0), PoseBelief(Pose2D(0.75, 0.5), particles=cloud)))
    assert method.log_odds(CellBox(0, 0, 8, 1))[0].tolist() == approx(
        [0.75 * L_FREE] + [L_FREE] * 4 + [0.75 * L_OCC + 0.25 * L_FREE, 0.25 * L_OCC, UNKNOWN],
        nan_ok=True,
    )
    assert leaves_of(method)[0, 5, 0] == approx((0.75 * L_OCC + 0.25 * L_FREE, 0.75, 0.25))


def test_draws_from_a_covariance_are_repeatable_and_spread():
    belief = PoseBelief(Pose2D(0.5, 0.5), np.diag([0.0, 0.5, 0.0]))  # singular
    first, second, other = (
        AdaptiveMapper(MapperConfig(pose_uncertain=PoseUncertainConfig(samples=30, seed=seed)))
        for seed in (1, 1, 2)
    )
    for method in (first, second, other):
        method.update(PlacedScan(fan(3.0), belief))
    assert same(leaves_of(first), leaves_of(second))
    assert leaves_of(first).keys() != leaves_of(other).keys()
    first.reset()
    first.update(PlacedScan(fan(3.0), belief))
    assert same(leaves_of(first), leaves_of(second))
    measured = measured_cells(first.log_odds(first.spec.box), first.spec.box)
    assert len({row for _, row in measured}) > 10


def test_no_covariance_to_speak_of_is_the_mean():
    method, known = mapper(), mapper()
    method.update(
        PlacedScan(fan(5.0, 6.0, increment=0.2), PoseBelief(Pose2D(0.5, 0.5), np.zeros((3, 3))))
    )
    known.update(PlacedScan(fan(5.0, 6.0, increment=0.2), at()))
    assert same(leaves_of(method), leaves_of(known))


# -- limits -------------------------------------------------------------------------------------


def test_a_map_that_would_be_too_large_is_refused_and_unchanged():
    method = mapper(max_cells=4096)
    method.update(PlacedScan(fan(5.0), at()))
    spec, before = method.spec, leaves_of(method)
    with pytest.raises(GridError, match=r'would grow to 112 x 104 cells: .* max_cells = 4096'):
        method.update(PlacedScan(fan(5.0), at(100.5, 100.5)))
    assert method.spec == spec
    assert same(leaves_of(method), before)


def test_a_scan_that_says_nothing_changes_nothing():
    method = mapper()
    spec = method.spec
    assert method.update(PlacedScan(fan(math.nan, -1.0), at(1000.0, 1000.0))).empty
    assert method.spec == spec
    assert leaves_of(method) == {}


@pytest.mark.parametrize('name', ['finest_level', 'output_level'])
def test_levels_out_of_order_are_refused(name):
    with pytest.raises(ConfigError, match=rf'adaptive.{name} is 5: must not be above'):
        mapper(**{name: 5, 'coarsest_level': 4})


@pytest.mark.jit
def test_one_specialization_of_each_kernel():
    belief = PoseBelief(Pose2D(0.5, 0.5), np.diag([0.04, 0.04, 0.01]))
    for fusion in FUSIONS:
        for change in ({}, {'prior': 0.2, 'limit': 50}, {'unknowns': False, 'count_limit': 5}):
            method = mapper(**{'fusion': fusion, 'merge_free': 0.05, **change})
            for one in (at(), belief, at(-70, 9, 2)):
                method.update(PlacedScan(fan(5.0, 3.0, math.inf, increment=0.3), one))
            method.log_odds(method.spec.box)
            method.tree.plant(method.tree.leaves())
    kernels = (apply_evidence, count_seen, count_unknowns, fill_log_odds, mark_again)
    for kernel in (*kernels, merge_leaves, plant, split_leaves):
        assert len(kernel.signatures) == 1, (kernel.__name__, kernel.signatures)


def test_a_particle_too_light_to_matter_marks_nothing():
    """As with `pose_uncertain`: 0.0005 of the weight is below `negligible`."""
    poses = np.array([[0.5, 0.5, 0.0], [0.5, 6.5, 0.0]])
    belief = PoseBelief(Pose2D(0.5, 0.5), None, PoseSamples.checked(poses, [0.9995, 0.0005]))
    method, known = mapper(), mapper()
    method.update(PlacedScan(fan(5.0), belief))
    known.update(PlacedScan.at(fan(5.0), Pose2D(0.5, 0.5)))
    assert same(leaves_of(method), leaves_of(known))

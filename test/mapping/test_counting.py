"""The counting model: the slides' example, corridors on paper, a naive twin."""

import math
from collections import Counter

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from support.naive import beams_of, corner_margin, crossed_cells
from support.strategies import REPEATABLE, fan, poses, scans

from ogm_mcmc.config import CountingConfig, MapperConfig, StepModelConfig
from ogm_mcmc.geometry import CellBox, PlacedScan, Pose2D, PoseBelief
from ogm_mcmc.mapping import CountingMapper, TwoAssumptionMapper
from ogm_mcmc.mapping.counting_kernels import count_per_beam, count_per_scan

approx = pytest.approx

FUSIONS = ['per_scan', 'per_beam']
CORRIDOR = CellBox(0, 0, 6, 1)
UNKNOWN = math.nan


def mapper(**settings):
    """A map of 1 m cells, unless said otherwise."""
    return CountingMapper(MapperConfig(**{'method': 'counting', 'resolution': 1.0, **settings}))


def at(x=0.5, y=0.5, yaw=0.0):
    return PoseBelief(Pose2D(x, y, yaw))


def counts(method):
    method.grid.cover(CORRIDOR)
    hits, misses = method.counts(CORRIDOR)
    return hits[0].tolist(), misses[0].tolist()


@pytest.mark.parametrize('fusion', FUSIONS)
def test_sixty_of_a_hundred_beams(fusion):
    """[slides]: 60 % end in the cell and 40 % go on: 0.6 here, and 1 in the occupancy grid."""
    counting = mapper(fusion=fusion)
    l_step = math.log(0.55 / 0.45)  # p(occ | z) is 0.55 for an end and 0.45 for a passage
    occupancy = TwoAssumptionMapper(
        MapperConfig(resolution=1.0, step=StepModelConfig(l_free=-l_step, l_occ=l_step))
    )
    shown = []
    for n in range(1, 1001):
        scan = fan(3.0) if n % 5 < 3 else fan(5.0)
        counting.update(PlacedScan(scan, at()))
        occupancy.update(PlacedScan(scan, at()))
        if n in (10, 100, 1000):
            cell = CellBox(3, 0, 4, 1)
            shown.append(float(occupancy.probabilities(cell)[0, 0]))
            assert counting.probabilities(cell)[0, 0] == approx(0.6)
            # (11 / 9)^(0.6 n - 0.4 n) to 1.
            assert shown[-1] == approx(1.0 / (1.0 + (9.0 / 11.0) ** (0.2 * n)), abs=1e-5)
    assert shown == sorted(shown)
    assert shown[-1] > 1.0 - 1e-6


def test_a_pane_of_glass_keeps_its_probability():
    """It returns one beam in ten; log-odds take it for free space, reflection does not."""
    glass, grid = mapper(), TwoAssumptionMapper(MapperConfig(resolution=1.0))
    for n in range(50):
        scan = fan(2.0) if n % 10 == 0 else fan(5.0)
        glass.update(PlacedScan(scan, at()))
        grid.update(PlacedScan(scan, at()))
    pane = CellBox(2, 0, 3, 1)
    assert glass.probabilities(pane)[0, 0] == approx(0.1)
    assert grid.probabilities(pane)[0, 0] < 1e-6
    # And the wall behind it is solid in both.
    wall = CellBox(5, 0, 6, 1)
    assert glass.probabilities(wall)[0, 0] == 1.0
    assert grid.probabilities(wall)[0, 0] > 0.999


def test_per_scan_on_paper():
    """A hit beats a miss, and nothing counts twice."""
    method = mapper(fusion='per_scan')
    method.update(PlacedScan(fan(5.0, 3.0, 3.25, 4.0), at()))
    assert counts(method) == ([0, 0, 0, 1, 1, 1], [1, 1, 1, 0, 0, 0])
    method.update(PlacedScan(fan(4.0), at()))
    assert counts(method) == ([0, 0, 0, 1, 2, 1], [2, 2, 2, 1, 0, 0])


def test_per_beam_on_paper():
    """Hits and misses of a cell are the beams that reached it."""
    method = mapper(fusion='per_beam', max_range=5.0)
    method.update(PlacedScan(fan(5.0, 3.0, 3.25, 4.0, math.inf), at()))
    assert counts(method) == ([0, 0, 0, 2, 1, 1], [5, 5, 5, 3, 2, 1])
    expected = [0.0, 0.0, 0.0, 0.4, 1 / 3, 0.5]
    assert method.probabilities(CORRIDOR)[0].tolist() == approx(expected)


def test_maximum_likelihood_map_and_unknown_cells():
    method = mapper(fusion='per_beam', counting=CountingConfig(show='ml'))
    method.update(PlacedScan(fan(4.0, 3.0, 3.0), at()))
    expected = [0.0, 0.0, 0.0, 1.0, 1.0, UNKNOWN]
    method.grid.cover(CORRIDOR)
    assert method.probabilities(CORRIDOR)[0].tolist() == approx(expected, nan_ok=True)
    method.update(PlacedScan(fan(4.0, 4.0, 4.0), at()))
    assert method.probabilities(CORRIDOR)[0, 3] == 0.0
    assert method.reflection(CORRIDOR)[0, 3] == approx(1 / 3)


def test_the_ratio_maximises_the_likelihood():
    """Of all m in a fine grid, hits / (hits + misses) makes the readings likeliest."""
    method = mapper(fusion='per_beam')
    method.update(PlacedScan(fan(*[3.0] * 7, *[5.0] * 13), at()))
    (hits, misses), m = (c[0, 3] for c in method.counts(CORRIDOR)), np.linspace(0.001, 0.999, 999)
    best = m[np.argmax(hits * np.log(m) + misses * np.log(1.0 - m))]
    assert method.probabilities(CORRIDOR)[0, 3] == approx(best, abs=1e-3)


def test_counts_do_not_overflow():
    method = mapper(fusion='per_beam')
    method.update(PlacedScan(fan(3.0), at()))
    method.grid.hits[0, 3], method.grid.misses[0, 3] = 2**30, 2**31 - 1
    method.update(PlacedScan(fan(5.0), at()))
    assert method.probabilities(CORRIDOR)[0, 3] == approx(1 / 3)
    hits, misses = method.counts(CORRIDOR)
    assert (hits[0, 3], misses[0, 3]) == (2**29, 2**30)


sensors = poses(3.0).map(lambda p: Pose2D(p.x_m + 0.0123, p.y_m + 0.0171, p.yaw_rad))


@pytest.mark.parametrize('fusion', FUSIONS)
@given(placed=st.lists(st.tuples(scans(), sensors), min_size=1, max_size=3))
@settings(REPEATABLE, max_examples=60)
def test_equals_counting_by_hand(fusion, placed):
    config = MapperConfig(method='counting', fusion=fusion, resolution=0.1, max_range=4.0)
    method, hits, misses = CountingMapper(config), Counter(), Counter()
    for scan, sensor in placed:
        met, crossed = Counter(), Counter()
        for beam in beams_of(scan, sensor, config):
            ends = [abs(value - round(value)) for value in beam[:4]]
            assume(min(corner_margin(*beam[:4]), *ends) > 1e-7)
            end = (math.floor(beam.x1), math.floor(beam.y1))
            met.update([end] if beam.hit else [])
            crossed.update(set(crossed_cells(*beam[:4])) - ({end} if beam.hit else set()))
        if fusion == 'per_scan':
            crossed = Counter(set(crossed) - set(met))
            met = Counter(set(met))
        hits.update(met)
        misses.update(crossed)
        method.update(PlacedScan.at(scan, sensor))
    box = method.spec.box
    for counted, found in zip((hits, misses), method.counts(box), strict=True):
        cells = {
            (box.column0 + int(c), box.row0 + int(r)): int(found[r, c])
            for r, c in np.argwhere(found)
        }
        assert cells == dict(counted)
    assert not method.grid.free_bits.any()
    assert not method.grid.hit_bits.any()


@pytest.mark.parametrize('fusion', FUSIONS)
def test_a_map_that_grew_equals_one_that_was_large_from_the_start(fusion):
    grown, large = mapper(fusion=fusion), mapper(fusion=fusion)
    large.grid.cover(CellBox(-1100, -1100, 1300, 1200))
    rng = np.random.default_rng(4)
    for _ in range(10):
        scan = fan(*rng.uniform(1.0, 15.0, 40), bearing=-3.0, increment=0.15)
        belief = at(*rng.uniform(-300.0, 300.0, 2))
        assert grown.update(PlacedScan(scan, belief)) == large.update(PlacedScan(scan, belief))
    box = grown.spec.box
    for one, other in zip(grown.counts(box), large.counts(box), strict=True):
        assert np.array_equal(one, other)
    assert large.grid.hits.sum() == grown.grid.hits.sum()


@pytest.mark.jit
def test_one_specialization_of_each_kernel():
    for fusion in FUSIONS:
        mapper(fusion=fusion).update(PlacedScan(fan(1.0, math.inf, increment=0.3), at()))
        mapper(fusion=fusion, resolution=0.5, max_range=5).update(
            PlacedScan(fan(2.0).flipped(), at())
        )
    for kernel in (count_per_scan, count_per_beam):
        assert len(kernel.signatures) == 1, (kernel.__name__, kernel.signatures)

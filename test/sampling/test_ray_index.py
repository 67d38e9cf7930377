"""The ray index against exact geometry, whether built at once or in pieces."""

import itertools
import math
import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.naive_posterior import NaivePosterior
from support.strategies import REPEATABLE, fan
from support.tiny_problems import cell_numbers, tiny_problems

from ogm_mcmc.config import ForwardModelConfig, WindowConfig
from ogm_mcmc.errors import GridError, WindowError
from ogm_mcmc.geometry import CellBox, PlacedScan, Pose2D, Scan
from ogm_mcmc.sampling import RayWindow, WindowSize
from ogm_mcmc.sampling.ray_filing import FULL_FROM
from ogm_mcmc.sampling.ray_index_kernels import (
    FRONT,
    MOST_IN_TILE,
    NEAR,
    WIDTH,
    find_front,
    list_of,
)
from ogm_mcmc.sampling.ray_line_kernels import LEVEL

approx = pytest.approx

BEAM = ForwardModelConfig(sigma=0.2)


def by_ray(index):
    """Cells and log-likelihoods of every ray."""
    rays = []
    for n in range(index.n_rays):
        cells, values, _ = index.ray(n)
        rays.append((cells.tolist(), values.tolist()))
    return rays


def by_cell(index):
    """(ray, log-likelihood) of every cell: near ones of its list, and those found in front."""
    likelihood, width = index.near.view(np.float32)[:, 1], int(index.grid[WIDTH])
    levels = index.rays.view(np.float32)[:, LEVEL]
    found = np.empty(index.n_rays, np.int32)
    numbers = np.full(index.n_cells, -1)
    numbers[index.listed()] = np.arange(index.listed().size)
    cells = []
    for cell, number in enumerate(numbers.tolist()):
        assert list_of(cell, index.marks) == number
        count = find_front(cell % width, cell // width, index.tiles, index.runs,
                           index.run_lengths, index.rays, index.grid, found)  # fmt: skip
        codes, near = found[:count].tolist(), []
        if number >= 0:
            begin, end = index.lists[number : number + 2, NEAR]
            near = [(index.near[i, 0], likelihood[i]) for i in range(begin, end)]
            assert [code for code, _ in near] == sorted(code for code, _ in near)
            begin, end = index.lists[number : number + 2, FRONT]
            assert index.front[begin:end].tolist() == (codes if index.full[number] else [])
            if index.gain[number] > FULL_FROM:
                assert index.full[number]
        assert codes == sorted(codes)
        rays = near + [(code, levels[code >> 2]) for code in codes]
        cells.append(sorted((int(code) >> 2, float(value)) for code, value in rays))
    return cells


def assert_consistent(index):
    expected = [[] for _ in range(index.n_cells)]
    for n, (cells, values) in enumerate(by_ray(index)):
        for cell, value in zip(cells, values, strict=True):
            expected[cell].append((n, value))
    assert by_cell(index) == expected
    assert index.touched().tolist() == [k for k, pairs in enumerate(expected) if pairs]
    assert index.n_pairs == sum(map(len, expected))
    assert index.grid[MOST_IN_TILE] == max(
        (index.run_lengths[a:b].sum() for a, b in itertools.pairwise(index.tiles)), default=0
    )


def assert_equals_twin(window, naive):
    index = window.index
    assert index.n_rays == len(naive.rays)
    found = by_ray(index)
    for n, ray in enumerate(naive.rays):
        assert found[n][0] == cell_numbers(window.spec, ray.cells)
        assert found[n][1] == approx(naive._values[n], abs=2e-5, rel=1e-6)
    nothing = [index.ray(n)[2] for n in range(index.n_rays)]
    assert nothing == approx(naive._nothing, abs=2e-5, rel=1e-6)


def walk(count, seed, beams=12, spread=8.0, range_max_m=4.0):
    """Scans from places in all directions, readings that are none among them."""
    rng = np.random.default_rng(seed)
    placed = []
    for _ in range(count):
        ranges = rng.uniform(0.2, range_max_m, beams)
        ranges[rng.random(beams) < 0.2] = math.inf
        ranges[rng.random(beams) < 0.1] = math.nan
        scan = fan(*ranges, bearing=-3.0, increment=6.0 / beams, range_max_m=range_max_m)
        placed.append(
            PlacedScan.at(scan, Pose2D(*rng.uniform(-spread, spread, 2), rng.uniform(-3, 3)))
        )
    return placed


def window_of(placed, model=BEAM, **settings):
    window = RayWindow(WindowConfig(**{'resolution': 0.25, **settings}), model)
    window.add(placed)
    return window


def same_arrays(one, other):
    for name, a, b in zip(one._fields, one, other, strict=True):
        assert a.dtype == b.dtype, name
        assert np.array_equal(a, b), name


@given(problem=tiny_problems())
@REPEATABLE
def test_small_windows_equal_exact_geometry(problem):
    window = problem.indexed()
    assert_equals_twin(window, problem.naive())
    assert_consistent(window.index)


@pytest.mark.parametrize('kind', ['beam', 'gaussian'])
@pytest.mark.parametrize(
    'change',
    [
        {},
        {'cut_sigma': 0.0},
        {'max_range': 2.5},
        {'beam_stride': 3},
        {'no_return': 'ignore'},
        {'resolution': 0.1, 'cut_sigma': 2.0},
    ],
)
def test_whole_scans_equal_exact_geometry(kind, change):
    config = WindowConfig(**{'resolution': 0.25, **change})
    model = ForwardModelConfig(kind=kind, sigma=0.2, short=0.03, depth=0.25)
    placed = walk(3, seed=2)
    naive = NaivePosterior(model, config, 0.2, placed)
    assert naive.margin > 1e-9
    window = RayWindow(config, model)
    assert window.add(placed) == len(naive.rays)
    assert_equals_twin(window, naive)
    assert_consistent(window.index)


def test_a_corridor_on_paper():
    """One beam along a row from x = 0.5 with a reading of 2.1 m, cells of 1 m, cut at 3.1 m."""
    model = ForwardModelConfig(kind='gaussian', sigma=0.5)
    window = window_of(
        [PlacedScan.at(fan(2.1, range_max_m=9.0), Pose2D(0.5, 0.5))],
        model,
        resolution=1.0,
        cut_sigma=2.0,
    )
    # Cells 0 to 3; their middles on the beam at 0.25, 1, 2 and 3 m.
    assert (window.spec.width, window.spec.height) == (4, 1)
    off = np.array([0.25 - 2.1, 1.0 - 2.1, 2.0 - 2.1, 3.0 - 2.1, 1.0]) / 0.5
    expected = -0.5 * off**2 - math.log(0.5 * math.sqrt(2.0 * math.pi))
    _, values, nothing = window.index.ray(0)
    assert values == approx(expected[:4], abs=1e-6)
    assert nothing == approx(expected[4], abs=1e-6)
    # Cell 2 is the best there is; no map makes cell 0 more likely, as what is behind is better.
    lowest_behind = np.minimum.accumulate(expected[::-1])[::-1][1:]
    most = np.maximum(expected[:4] - lowest_behind, 0.0)
    assert window.index.gains() == approx(np.ceil(most * 2**14) / 2**14, abs=1e-5)


@pytest.mark.parametrize('seed', [1, 2])
@pytest.mark.parametrize('pieces', [1, 3])
def test_extending_equals_building_at_once(seed, pieces):
    """Bit for bit, though the window grows in every direction."""
    # First in the middle, then all around it.
    placed = walk(1, seed, spread=1.0) + walk(9, seed + 10, spread=12.0)
    whole = window_of(placed)
    grown = RayWindow(WindowConfig(resolution=0.25), BEAM)
    windows = []
    for part in [placed[:1], *(placed[i : i + pieces] for i in range(1, len(placed), pieces))]:
        grown.add(part)
        windows.append(grown.spec)
        assert_consistent(grown.index)
    assert windows[-1].column0 < windows[0].column0
    assert windows[-1].row0 < windows[0].row0
    assert windows[-1].box.column1 > windows[0].box.column1
    assert windows[-1].box.row1 > windows[0].box.row1
    assert grown.spec == whole.spec
    # What a cell can gain is a sum over its rays in another order.
    same_arrays(grown.index._replace(gain=whole.index.gain), whole.index)
    assert grown.index.gain == approx(whole.index.gain, rel=1e-5)


def test_two_threads_enter_the_same_as_one(monkeypatch):
    placed = walk(9, seed=6, spread=3.0)
    whole = window_of(placed).index
    monkeypatch.setattr('ogm_mcmc.sampling.ray_fronts.SHARED_FROM', 8)
    shared, grown = window_of(placed).index, window_of(placed[:3])
    grown.add(placed[3:])
    for index in (shared, grown.index):
        assert_consistent(index)
        # Runs of rays end where a part does, and sums are rounded up once more.
        same_arrays(
            index._replace(
                gain=whole.gain, tiles=whole.tiles, runs=whole.runs, run_lengths=whole.run_lengths
            ),
            whole,
        )
        assert (index.gain >= whole.gain * (1.0 - 1e-6)).all()
        assert index.gain == approx(whole.gain, rel=1e-5)


def test_what_is_held_beside_lists_while_they_are_filled(monkeypatch):
    """Where entries of two threads go, what they add, and sums: no more than 32 bytes a list."""
    monkeypatch.setattr('ogm_mcmc.sampling.ray_fronts.SHARED_FROM', 8)
    placed = walk(20, seed=3, beams=60, spread=3.0)
    window_of(placed, resolution=0.05)  # what kernels take to be loaded does not count
    tracemalloc.start()
    index = window_of(placed, resolution=0.05).index
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak - index.n_bytes < 32 * index.gain.size


def test_adding_nothing_changes_nothing():
    window = window_of(walk(2, seed=3))
    before, spec = window.index, window.spec
    assert window.add([]) == 0
    assert window.add([PlacedScan.at(fan(math.nan, 50.0, -1.0), Pose2D(90.0, 0.0))]) == 0
    assert window.spec == spec
    assert window.index is before


@pytest.mark.parametrize('first', [0, 2])
def test_memory_limit_refuses_before_changing_anything(first):
    placed = walk(40, seed=4, beams=60, range_max_m=30.0)
    window = RayWindow(WindowConfig(resolution=0.1, max_memory_mb=1.0), BEAM)
    window.add(walk(first, seed=1))
    before = [array.copy() for array in window.index]
    spec = window.spec
    with pytest.raises(WindowError, match=r'rays need \d+ MB: expected at most max_memory_mb = 1'):
        window.add(placed)
    assert window.spec == spec
    for a, b in zip(before, window.index, strict=True):
        assert np.array_equal(a, b)
    assert window.add(walk(2, seed=2)) > 0  # goes on
    assert_consistent(window.index)


@pytest.mark.parametrize('resolution', [0.1, 0.02])
def test_memory_is_bounded_and_reported(resolution):
    """What is held is at most what was asked of the limit, less than 8 bytes a pair."""
    placed = walk(8, seed=5, beams=40, range_max_m=12.0)
    window = window_of(placed, ForwardModelConfig(sigma=0.05), resolution=resolution)
    index = window.index
    assert index.n_bytes == sum(array.nbytes for array in index)
    size = WindowSize(0, 0, CellBox(0, 0, 0, 0))
    for one in placed:
        size = size.with_more(window.size_of(one))
    assert index.n_bytes <= size.n_bytes <= 2.0 * index.n_bytes
    assert size.near >= len(index.near)
    assert size.pairs >= index.n_pairs


def test_rays_that_are_too_long_are_refused():
    window = window_of(walk(1, seed=6))
    before = window.index
    with pytest.raises(GridError, match=r'a ray of 3\d{4} cells: expected at most 32500'):
        window.add([PlacedScan.at(fan(9000.0, range_max_m=10000.0), Pose2D())])
    assert window.index is before


@pytest.mark.parametrize('bearing', [0.3, 1.1, 2.0, -0.77, -2.9])
def test_a_reading_at_the_very_reach_is_a_reading(bearing):
    """Not "no return", whatever sines and cosines round to."""
    for reach in (20.0, 3.3, 7.7, 0.9):
        reading = float(np.float32(reach))
        scan = fan(reading, bearing=bearing, range_max_m=reading)
        window = window_of(
            [PlacedScan.at(scan, Pose2D(0.123, 0.456, 0.7))], resolution=0.1, cut_sigma=0.0
        )
        # Nothing on the ray: a range of R is clutter, 0.05 / R. No return would be 0.95.
        assert window.index.ray(0)[2] == approx(math.log(0.05 / reading), abs=1e-5)


@pytest.mark.parametrize('reading', [1e-20, 1e-30, 1e-12, 1e-7])
def test_readings_of_next_to_nothing(reading):
    """A driver that reports rubbish must not send a ray anywhere: it goes where it points."""
    scan = Scan.checked(
        np.array([reading]),
        angle_min_rad=0.5,
        angle_increment_rad=0.1,
        range_min_m=0.0,
        range_max_m=5.0,
    )
    config = WindowConfig(resolution=0.1, cut_sigma=4.0)
    placed = [PlacedScan.at(scan, Pose2D(0.537, 0.221, 0.4))]
    window = RayWindow(config, BEAM)
    window.add(placed)
    assert_equals_twin(window, NaivePosterior(BEAM, config, 0.2, placed))


@pytest.mark.parametrize('yaw', [5e-324, -5e-324, 1e-301, -1e-301, -1e-299])
def test_beams_next_to_an_axis(yaw):
    """Whichever border they would meet in the end, they cross the cells of a beam along it."""
    config = WindowConfig(resolution=1.0, cut_sigma=0.0)
    model = ForwardModelConfig(kind='gaussian', sigma=1.0)
    placed = [PlacedScan.at(fan(3.0, range_max_m=5.0), Pose2D(0.25, 0.5, yaw))]
    window = window_of(placed, model, resolution=1.0, cut_sigma=0.0)
    assert_equals_twin(window, NaivePosterior(model, config, 0.2, placed))


@pytest.mark.parametrize('yaw', [0.0, math.pi / 2, math.pi, -math.pi / 2, math.pi / 4])
@pytest.mark.parametrize(('x', 'y'), [(0.0, 0.0), (0.5, 0.5), (0.0, 0.5), (3.0, -2.0)])
def test_beams_along_axes_and_through_corners(x, y, yaw):
    """Whatever side they fall on: connected, finite, and distances that grow."""
    model = ForwardModelConfig(kind='gaussian', sigma=1.0)
    window = window_of(
        [PlacedScan.at(fan(3.0, math.inf, range_max_m=5.0), Pose2D(x, y, yaw))],
        model,
        resolution=1.0,
    )
    assert_consistent(window.index)
    for cells, values in by_ray(window.index):
        assert len(set(cells)) == len(cells)
        assert all(0 <= cell < window.index.n_cells for cell in cells)
        assert np.isfinite(values).all()
    assert np.isfinite(window.index.gain).all()
    # With a reading of 3 m, likelihoods rise up to there.
    values = np.array(by_ray(window.index)[0][1])
    assert (np.diff(values[:3]) >= -1e-6).all()


@given(
    problem=tiny_problems(),
    chosen=st.lists(st.integers(0, 2**16), min_size=3, max_size=12),
)
@settings(REPEATABLE, max_examples=60)
def test_no_map_gives_a_cell_more_than_its_gain(problem, chosen):
    naive, window = problem.naive(), problem.indexed()
    gain = window.index.gains()
    for number in chosen:
        occupied = naive.map_of(number % 2 ** len(naive.touched))
        numbers = cell_numbers(window.spec, naive.touched)
        for cell, k in zip(naive.touched, numbers, strict=True):
            adds = naive.log_odds(cell, occupied) - naive.log_odds_before
            assert adds <= gain[k] * (1.0 + 1e-6) + 2e-5


@pytest.mark.parametrize('reading', [1.3, 1.4, 1.5, 1.6, 1.7])
def test_gain_is_a_bound_of_many_rays_too(reading):
    """The sum of many small terms must not be rounded to less than it is."""
    count = 5000
    window = RayWindow(
        WindowConfig(resolution=1.0, cut_sigma=0.0),
        ForwardModelConfig(sigma=1.5, clutter=0.2, missing=0.2),
    )
    window.add([PlacedScan.at(fan(*[reading] * count, range_max_m=4.0), Pose2D(0.5, 0.5))])
    index = window.index
    # All rays are the same: what a cell gains is so many times what one gives.
    _, values, nothing = index.ray(0)
    values, gain = values.astype(np.float64), index.gains()
    for k in range(values.size):
        lowest = min([*values[k + 1 :], nothing])
        most = count * max(values[k] - lowest, 0.0)
        assert most <= gain[k] <= most * (1.0 + 1e-3)


@pytest.mark.parametrize('reach', [1.9, 7.5, 7.6, 15.7, 29.9])
def test_a_beam_without_a_return_is_likely_where_nothing_is_at_any_reach(reach):
    """7.6 / 0.05 * 0.05 is less than 7.6 in floating point: no ray is cut by that."""
    window = RayWindow(WindowConfig(resolution=0.05, max_range=reach), BEAM)
    window.add([PlacedScan.at(fan(math.inf, range_max_m=40.0), Pose2D(0.03, 0.02))])
    _, values, unseen = window.index.ray(0)
    assert unseen == approx(math.log(1.0 - BEAM.clutter), abs=1e-6)
    assert (values < unseen).all()

"""Beams that run along together as one ray, against the same beams one by one."""

import math

import numpy as np
import pytest
from support.strategies import fan

from ogm_mcmc.config import ForwardModelConfig, WindowConfig
from ogm_mcmc.geometry import CellBox, PlacedScan, Pose2D
from ogm_mcmc.sampling import CellModel, RayWindow
from ogm_mcmc.sampling.beam_rays import rays_of_scan
from ogm_mcmc.sampling.ray_merging import Joining, Lines, joined
from ogm_mcmc.sensors.forward_model import ForwardModel

approx = pytest.approx

REACH_M = 5.0
MODELS = {
    'beam': ForwardModelConfig(sigma=0.1),
    'short': ForwardModelConfig(sigma=0.1, short=0.05),
    'gaussian': ForwardModelConfig(kind='gaussian', sigma=0.3),
    'grazing': ForwardModelConfig(sigma=0.1, grazing=0.2),
}


def standing(count, seed, noise_m=0.05, poses=2):
    """Scans of a room from a few places, some readings lost, somebody walking by."""
    rng = np.random.default_rng(seed)
    places = [Pose2D(*rng.uniform(-0.5, 0.5, 2), rng.uniform(-3, 3)) for _ in range(poses)]
    placed = []
    for number in range(count):
        ranges = 2.0 + 0.5 * np.cos(np.arange(16)) + rng.normal(0.0, noise_m, 16)
        ranges[rng.random(16) < 0.1] = math.inf
        ranges[rng.random(16) < 0.05] = math.nan
        ranges[rng.random(16) < 0.1] *= 0.3
        scan = fan(*ranges, bearing=-3.0, increment=0.37, range_max_m=REACH_M)
        placed.append(PlacedScan.at(scan, places[number % poses]))
    return placed


def window_of(parts, model, merge):
    limits = CellBox(-28, -28, 28, 28)
    window = RayWindow(WindowConfig(resolution=0.2), model, merge=merge, limits=limits)
    for part in parts:
        window.add(part)
    return window


def log_likelihoods(window, maps):
    model = CellModel(window.index, math.log(0.2 / 0.8), window.spec.width)
    return np.array([model.log_likelihood(model.start(cells)) for cells in maps])


class AskedMeanwhile(dict):
    """Places that are read while somebody else asks, as chains do, each in its thread."""

    ask = None

    def values(self):
        if self.ask is not None:
            ask, self.ask = self.ask, None
            self.told = ask()
        return super().values()


def test_lines_that_two_ask_for_at_once_are_whole_for_both():
    scans = standing(6, seed=3, noise_m=0.2)
    forward = ForwardModel.from_config(MODELS['beam'])

    def cast(placed):
        return rays_of_scan(placed, WindowConfig(resolution=0.2), forward.sigma_m)

    joining = Joining({}, 0, scans, cast, forward, 0.2)
    rays = cast(scans[0])
    shared, *_ = [joining.take(scan, cast(scan)) for scan in scans]
    joining.places = AskedMeanwhile(joining.places)
    joining.places.ask = lambda: joining.lines_alone(shared, rays)
    expected = joining.lines_alone(shared, rays)
    assert expected.length.min() > 1.0
    for mine, its in zip(joining.places.told, expected, strict=True):
        assert np.array_equal(mine, its, equal_nan=True)


@pytest.mark.parametrize('kind', MODELS)
@pytest.mark.parametrize('pieces', [1, 7, 30])
def test_any_map_is_as_likely_as_with_the_beams_one_by_one(kind, pieces):
    scans = standing(30, seed=3)
    parts = [scans[i : i + pieces] for i in range(0, 30, pieces)]
    merged = window_of(parts, MODELS[kind], True)
    single = window_of([scans], MODELS[kind], False)
    rng = np.random.default_rng(4)
    maps = [(rng.random(single.index.n_cells) < share).astype(np.uint8)
            for share in (0.0, 0.01, 0.05, 0.2) for _ in range(5)]  # fmt: skip
    expected = log_likelihoods(single, maps)
    assert log_likelihoods(merged, maps) == approx(expected, rel=1e-5, abs=1e-2)
    assert merged.n_beams == single.n_beams == single.index.n_rays
    assert single.n_merged == 0
    assert merged.n_merged == merged.n_beams - merged.index.n_rays > 0.4 * merged.n_beams
    assert merged.spec == single.spec
    assert np.array_equal(merged.index.crossed, single.index.crossed)


@pytest.mark.parametrize('kind', MODELS)
@pytest.mark.parametrize('pieces', [4, 24])
def test_chains_draw_the_maps_that_they_draw_from_the_beams_one_by_one(kind, pieces):
    scans = standing(24, seed=5, poses=3)
    parts = [scans[i : i + pieces] for i in range(0, 24, pieces)]
    maps = []
    for window in (window_of(parts, MODELS[kind], True), window_of([scans], MODELS[kind], False)):
        model = CellModel(window.index, math.log(0.2 / 0.8), window.spec.width)
        state, rng = model.start(np.zeros(model.n_cells, np.uint8)), np.random.default_rng(6)
        maps.append([])
        for _ in range(30):
            model.advance(rng, state)
            maps[-1].append(state.cells.copy())
    assert np.array_equal(*maps)
    assert maps[0][-1].any()


@pytest.mark.parametrize('kind', MODELS)
def test_no_cell_gains_more_than_is_said(kind):
    """`gain` bounds the sum of what each ray can add; `telling` is that of the beams."""
    scans = standing(30, seed=7, poses=1)
    merged = window_of([scans[:3], scans[3:]], MODELS[kind], True)
    single = window_of([scans], MODELS[kind], False)
    most = np.zeros(merged.index.n_cells)
    for n in range(merged.index.n_rays):
        cells, values, unseen = merged.index.ray(n)
        behind = np.minimum.accumulate(np.append(values, unseen)[::-1])[::-1][1:]
        most[cells] += np.maximum(values.astype(float) - behind, 0.0)
    gains = merged.index.gains()
    listed = np.flatnonzero(gains)
    assert (gains[listed] >= most[listed]).all()
    assert gains == approx(most, rel=1e-4, abs=2.0**-14 * merged.index.n_rays)
    # Together beams can add less than each of them alone.
    assert (gains <= single.index.gains() + 2.0**-14 * single.index.n_rays).all()
    told = {}
    for window in (single, merged):
        for n in range(window.index.n_rays):
            cells, _, _ = window.index.ray(n)
            for cell in cells[: window.index.telling[n]]:
                told.setdefault(int(cell), set()).add(window is merged)
    assert all(said == {True, False} for said in told.values())


def test_a_robot_that_stands_costs_no_more():
    """Rays and memory stay flat once its readings have shown how far they spread."""
    scans = standing(400, seed=8, noise_m=0.02, poses=1)
    window, bytes_after, rays_after = window_of([], MODELS['beam'], True), [], []
    for i in range(0, 400, 10):
        window.add(scans[i : i + 10])
        bytes_after.append(window.index.n_bytes)
        rays_after.append(window.index.n_rays)
    assert window.n_beams > 380 * 14
    assert rays_after[-1] < 5 * 16
    assert rays_after[-1] - rays_after[10] < 16
    assert bytes_after[-1] < 1.2 * bytes_after[10]


def test_a_robot_that_drives_has_every_beam_as_a_ray():
    scans = standing(12, seed=9, poses=12)
    merged, single = (window_of([scans], MODELS['beam'], merge) for merge in (True, False))
    assert merged.n_merged == 0
    for name, mine, theirs in zip(merged.index._fields, merged.index, single.index, strict=True):
        assert np.array_equal(mine, theirs), name


def lines_of(direction, nearest, length, ray):
    """Lines of a sensor at the edge of a cell."""
    cells = np.floor(length).astype(np.int64) + 1
    return Lines(np.array(direction), np.array(nearest), np.array(length), cells, np.array(ray))


def test_lines_take_in_what_overlaps_and_no_more():
    """By hand, cells of 1 m: a line from 2 to 5 m that is laid, one from 8 to 9 m that is not."""
    east = 1.0 + 0.0j
    lines = lines_of([east, east], [2.0, 8.0], [5.5, 9.5], [0, 7])
    # Inside of the first; over its end; over the end of the second; apart; another direction;
    # to the end of the last cell of the first.
    beams = lines_of([east, east, east, east, 1j, east], [3.0, 4.0, 8.5, 11.0, 3.0, 3.0],
                     [4.0, 6.1, 10.1, 12.0, 4.0, 5.9], 20 + np.arange(6))  # fmt: skip
    number, after = joined(lines, beams, 5, 1.0, 0.5)
    assert number.tolist() == [0, 20, 7, 21, 22, 0]
    found = {line[-1]: line[1:-1] for line in zip(*after, strict=True)}
    assert found == {0: (2, 5.9, 6), 7: (8, 10.1, 11), 20: (1.5, 6.1, 7), 21: (11, 12, 13),
                     22: (3, 4, 5)}  # fmt: skip
    assert after.direction.tolist() == sorted(after.direction.tolist(), key=lambda z: z.real)

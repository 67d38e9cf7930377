"""Where patches lie: all of a window, or the band around what rays tell of."""

import math

import numpy as np
import pytest
from support.strategies import fan

from ogm_mcmc.config import ForwardModelConfig, WindowConfig
from ogm_mcmc.geometry import CellBox, PlacedScan, Pose2D
from ogm_mcmc.sampling import RayWindow
from ogm_mcmc.sampling.informed import arrival, near
from ogm_mcmc.sampling.patch_places import DULL_TURNS, focused, patch_places, told_cells, turn

WIDTH, HEIGHT = 40, 30
INNER = [row * WIDTH + column for row in range(3) for column in range(3)]


@pytest.fixture(scope='module')
def index():
    window = RayWindow(
        WindowConfig(resolution=1.0),
        ForwardModelConfig(sigma=0.4),
        limits=CellBox(0, 0, WIDTH, HEIGHT),
    )
    scan = fan(*[22.0] * 40, bearing=-0.2, increment=0.01, range_max_m=30.0)
    window.add([PlacedScan.at(scan, Pose2D(3.5, 12.5, 0.0))])
    return window.index


def told_by(index):
    return told_cells(index, index.telling, np.arange(index.n_rays))


def test_what_rays_tell_of_is_what_each_of_them_tells_of(index):
    telling, whole = index.telling, told_by(index)
    for first in (0, 1, 17, 40):
        later = told_cells(index, telling, np.arange(first, 40))
        nothing = np.zeros(index.n_cells, np.float32)
        earlier = arrival(index._replace(rays=index.rays[:first]), telling[:first], nothing) > 0.0
        assert np.array_equal(later | earlier, whole)
    assert whole.any()
    assert not told_cells(index, telling, np.arange(0)).any()


@pytest.mark.parametrize('side', [1, 3, 5])
@pytest.mark.parametrize('margin', [None, 1, 4])
def test_every_tiling_has_each_patch_once(index, side, margin):
    places = patch_places(index, told_by(index), WIDTH, side, margin)
    parts = [*places.active, *places.dull]
    assert len(places.active) == len(places.dull) == side * side
    together = np.concatenate(parts)
    assert np.array_equal(np.sort(together), places.corners)
    inner = [row * WIDTH + column for row in range(side) for column in range(side)]
    for active, dull in zip(places.active, places.dull, strict=True):
        covered = np.concatenate((active, dull))[:, None] + inner
        assert np.unique(covered).size == covered.size  # side by side
    everything = np.unique(together[:, None] + inner)
    assert np.array_equal(everything, places.touched)
    rim = np.ones((HEIGHT, WIDTH), bool)
    rim[1:-1, 1:-1] = False
    assert not rim.reshape(-1)[places.touched].any()
    if margin is None:
        assert places.touched.size == (HEIGHT - 2) * (WIDTH - 2)
        assert sum(dull.size for dull in places.dull) == 0


def test_only_the_band_around_what_rays_tell_of_is_sampled(index):
    telling = index.telling
    told = arrival(index, telling, np.zeros(index.n_cells, np.float32)) > 0.0
    places = patch_places(index, told, WIDTH, 3, 4)
    band = near(told.reshape(HEIGHT, WIDTH), 4)
    sampled = np.zeros(index.n_cells, bool)
    sampled[places.touched] = True
    assert not sampled[~band.reshape(-1)].any()
    assert sampled[told].all()
    assert 200 < sampled.sum() < 0.7 * index.n_cells


def test_patches_far_in_front_of_all_readings_are_dull(index):
    places = patch_places(index, told_by(index), WIDTH, 3, 4)
    dull = np.concatenate(places.dull)
    assert dull.size > 20
    crossed, gains = index.is_touched(), index.gains()
    for corner in dull.tolist():
        cells = [corner + row * WIDTH + column for row in range(3) for column in range(3)]
        assert (gains[cells] == 0.0).all()
        assert crossed[cells].all()
    assert math.log2(DULL_TURNS) == 3


def test_patches_in_doubt_are_in_every_sweep_and_all_others_in_one_of_eight(index):
    places = patch_places(index, told_by(index), WIDTH, 3, 4)
    in_doubt = np.zeros((HEIGHT, WIDTH), bool)
    in_doubt[12, 25] = True
    found = focused(places, in_doubt, 3)
    for before, after in zip(places.active, found.active, strict=True):
        assert (after == before[np.isin(12 * WIDTH + 25 - before, INNER)]).all()
        assert after.size == 1
    assert (found.touched == places.touched).all()
    together = np.sort(np.concatenate([*found.active, *found.dull]))
    assert np.array_equal(together, places.corners)
    rng = np.random.default_rng(3)
    drawn = np.zeros(WIDTH * HEIGHT)
    for _ in range(9000):
        np.add.at(drawn, turn(rng, found), 1)
    doubted = np.concatenate(found.active)
    # Each of nine tilings comes 1000 times, patches without doubt in it one of eight times.
    assert np.abs(drawn[doubted] - 1000).max() < 150
    dull = np.concatenate(found.dull)
    assert drawn[dull].mean() == pytest.approx(125, abs=2)
    assert drawn[dull].max() < 190
    assert drawn[dull].min() > 70

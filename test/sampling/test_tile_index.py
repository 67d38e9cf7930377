"""What a tile of a map holds: what the whole index has of its cells."""

from dataclasses import replace

import numpy as np
import pytest
from support.local_tiles import MODEL, PRIOR, WINDOW, inside, room, some_map, tiled
from support.strategies import fan

from ogm_mcmc.errors import WindowError
from ogm_mcmc.geometry import PlacedScan
from ogm_mcmc.sampling import CellModel, RayWindow, tile_index
from ogm_mcmc.sampling.ray_filing import extended
from ogm_mcmc.sampling.tile_index import tile_rays
from ogm_mcmc.sampling.tiles import tiling_of


@pytest.mark.parametrize('side', [0, 3])
def test_a_tile_holds_what_the_whole_has_inside(scans, window, side):
    tiling = tiling_of(window.spec, 3, 2, side)
    _, tiles = tiled(scans, WINDOW, MODEL, tiling, None)
    whole, seen = window.index, set()
    for tile, sampler in zip(tiling.tiles, tiles.samplers, strict=True):
        rays = sampler.rays
        seen.update(rays.numbers.tolist())
        for mine, number in enumerate(rays.numbers):
            cells, values, unseen = whole.ray(int(number))
            within, there = inside(window.spec, cells, tile.box)
            found = rays.local.ray(mine)
            assert np.array_equal(found[0], there[within])
            assert np.array_equal(found[1], values[within])
            assert found[2] == unseen == rays.unseen[mine]
        crossing = [
            n
            for n in range(whole.n_rays)
            if inside(window.spec, whole.ray(n)[0], tile.box)[0].any()
        ]
        assert rays.numbers.tolist() == crossing
        rows, columns = window.spec.slices(tile.box)
        gains = whole.gains().reshape(window.spec.height, -1)[rows, columns].reshape(-1)
        assert (rays.local.gains() >= gains * (1.0 - 1e-6)).all()
        assert rays.local.gains() == pytest.approx(gains, rel=1e-4, abs=1e-6)
    assert len(seen) == whole.n_rays


def standing():
    few = room(n_scans=3, n_beams=12, seed=9)
    return [
        PlacedScan.at(fan(*(few[i % 3].scan.ranges_m + 0.2 * (i // 6)), bearing=-3.0,
                          increment=0.52, range_max_m=6.0),
                      replace(few[i % 3].pose, x_m=few[i % 3].pose.x_m + 0.004 * (i > 6)))
        for i in range(12)
    ]  # fmt: skip


def test_what_is_left_out_is_counted_once_however_beams_are_taken(monkeypatch):
    """Whoever adds them may as well have all at hand before the first is added."""
    stands, window = standing(), RayWindow(WINDOW, MODEL, margin=5, merge=True)
    window.add(stands)
    assert abs(window.index.left_out[0]) > 1.0
    monkeypatch.setattr(
        tile_index, 'extended',
        lambda *given: extended(*given[:-1], lambda: iter(list(given[-1]()))),
    )  # fmt: skip
    model, _ = tiled(stands, WINDOW, MODEL, tiling_of(window.spec, 3, 2, 0), None)
    assert model.summaries.left_out == pytest.approx(window.index.left_out[0])


def test_beams_that_say_the_same_are_one_ray_of_all_tiles():
    """Also of poses that jitter; a tile may have a part of a ray, and of what is said of it."""
    stands = standing()
    window = RayWindow(WINDOW, MODEL, margin=5, merge=True)
    window.add(stands)
    tiling = tiling_of(window.spec, 3, 2, 0)
    model, tiles = tiled(stands, WINDOW, MODEL, tiling, None)
    whole = CellModel(window.index, PRIOR, window.spec.width)
    assert model.summaries.n_rays == window.index.n_rays < 0.5 * window.n_beams
    assert model.summaries.left_out == pytest.approx(window.index.left_out[0])
    for tile, sampler in zip(tiling.tiles, tiles.samplers, strict=True):
        for mine, number in enumerate(sampler.rays.numbers):
            cells, values, unseen = window.index.ray(int(number))
            within, there = inside(window.spec, cells, tile.box)
            found = sampler.rays.local.ray(mine)
            assert np.array_equal(found[0], there[within])
            assert np.array_equal(found[1], values[within])
            assert found[2] == unseen
    for seed, share in enumerate((0.0, 0.05, 0.3)):
        cells = some_map(whole.n_cells, seed, share)
        expected = whole.log_likelihood(whole.start(cells))
        assert model.log_likelihood(model.start(cells)) == pytest.approx(expected, abs=1e-3)
    probability = np.full(whole.n_cells, 0.2, np.float32)
    assert np.array_equal(model.arrival(probability, 0.1), whole.arrival(probability, 0.1))


def test_the_limit_of_memory_is_of_what_a_tile_holds(window):
    many, tiling = room(n_scans=2, n_beams=12_000), tiling_of(window.spec, 2, 1, 0)
    n_bytes = tile_rays(many, WINDOW, MODEL, tiling, 1).n_bytes
    enough = replace(WINDOW, max_memory_mb=(n_bytes + 1) / 1e6)
    assert tile_rays(many, enough, MODEL, tiling, 1).n_bytes == n_bytes
    with pytest.raises(WindowError, match='tile 2 of 2 needs more than max_memory_mb'):
        tile_rays(many, replace(WINDOW, max_memory_mb=(n_bytes - 1) / 1e6), MODEL, tiling, 1)


def test_arrivals_are_those_of_the_whole(scans, window):
    tiling = tiling_of(window.spec, 2, 2, 0)
    model, _ = tiled(scans, WINDOW, MODEL, tiling, None)
    whole = CellModel(window.index, PRIOR, window.spec.width)
    rng = np.random.default_rng(3)
    probability = np.where(rng.random(whole.n_cells) < 0.1, 0.7, 0.05).astype(np.float32)
    for least in (0.0, 0.5):
        expected = whole.arrival(probability, least)
        assert np.array_equal(model.arrival(probability, least), expected)
    assert 0.0 < expected.max() <= 1.0

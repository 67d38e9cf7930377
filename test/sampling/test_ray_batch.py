"""Scans on their way into an index: what is held of them is what was cast, and not for longer."""

import math
from itertools import pairwise

import numpy as np
import pytest
from support.strategies import fan

from ogm_mcmc.config import ForwardModelConfig, WindowConfig
from ogm_mcmc.geometry import CellBox, PlacedScan, Pose2D
from ogm_mcmc.sampling import RayWindow, ray_fronts
from ogm_mcmc.sampling.beam_rays import limited, rays_of_scan
from ogm_mcmc.sampling.ray_batch import Batch

CONFIG = WindowConfig(resolution=0.2)


def scans():
    readings = (1.1, math.inf, 0.7), (math.nan, 2.3, 1.0 / 3.0), (math.nan, math.nan, math.nan)
    fans = [fan(*ranges, bearing=-0.4, increment=0.37, range_max_m=3.0) for ranges in readings]
    return [PlacedScan.at(scan, Pose2D(0.31 * i, -0.17, i)) for i, scan in enumerate(fans)]


@pytest.mark.parametrize('box', [None, CellBox(-3, -3, 4, 4)])
def test_rays_that_are_held_are_those_that_were_cast(box):
    calls = []

    def cast(placed):
        calls.append(placed)
        rays = rays_of_scan(placed, CONFIG, 0.1)
        return rays if box is None else limited(rays, box, CONFIG.resolution)

    batch = Batch(scans(), cast, None)
    again = list(batch.rays())
    assert len(calls) == 3
    for held, placed in zip(again, scans(), strict=True):
        for mine, its in zip(held, cast(placed), strict=True):
            assert mine.dtype == its.dtype
            assert np.array_equal(mine, its)
            assert mine.flags.c_contiguous
            assert mine.flags.writeable


def test_nothing_is_held_once_all_was_said():
    calls = []

    def cast(placed):
        calls.append(placed)
        return rays_of_scan(placed, CONFIG, 0.1)

    batch = Batch(scans(), cast, None)
    assert list(batch.more_said()) == []
    list(batch.rays())
    assert len(calls) == 6


def test_the_most_rays_in_a_tile_do_not_depend_on_how_many_are_summed_at_once(monkeypatch):
    rng = np.random.default_rng(1)
    counts = rng.integers(0, 4, 23)
    tiles = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)
    lengths = rng.integers(1, 255, int(tiles[-1])).astype(np.uint8)
    expected = max(int(lengths[a:b].sum()) for a, b in pairwise(tiles))
    for at_once in (1, 2, 7, 1000):
        monkeypatch.setattr(ray_fronts, 'TILES_AT_ONCE', at_once)
        assert ray_fronts.most_in_tile(tiles, lengths) == expected
    assert ray_fronts.most_in_tile(np.zeros(3, np.int32), lengths[:0]) == 0


def test_an_index_in_pieces_needs_no_more_than_one_at_once():
    """What is let go of while an index is made is let go of for good: nothing is missing."""
    whole, pieces = (RayWindow(CONFIG, ForwardModelConfig(sigma=0.1)) for _ in range(2))
    whole.add(scans())
    for scan in scans():
        pieces.add([scan])
    assert pieces.index.n_rays == whole.index.n_rays == 5
    for ray in range(5):
        for mine, its in zip(pieces.index.ray(ray)[1:], whole.index.ray(ray)[1:], strict=True):
            assert np.array_equal(mine, its)

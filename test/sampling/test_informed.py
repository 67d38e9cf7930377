"""Which cells a beam tells of, where it arrives, and which cells are shown."""

import math

import numpy as np
import pytest
from support import naive_patch_sampler as naive
from support.strategies import fan

from ogm_mcmc.config import ForwardModelConfig, WindowConfig
from ogm_mcmc.geometry import CellBox, PlacedScan, Pose2D
from ogm_mcmc.sampling import RayWindow, informed
from ogm_mcmc.sampling.informed import arrival, known_cells, near
from ogm_mcmc.sampling.ray_line_kernels import SHAPE, place_of


def window_of(*ranges, bearing=0.0, increment=0.4, **model):
    window = RayWindow(
        WindowConfig(resolution=1.0),
        ForwardModelConfig(**{'sigma': 0.5, **model}),
        limits=CellBox(0, 0, 14, 9),
    )
    scan = fan(*ranges, bearing=bearing, increment=increment, range_max_m=12.0)
    window.add([PlacedScan.at(scan, Pose2D(0.5, 4.5, 0.0))])
    return window


def test_a_beam_tells_nothing_far_behind_its_reading():
    """A reading of 5 m, sigma 0.5 m: cells are 0.5, 1.5, ... behind it; the ray has nine."""
    index = window_of(5.0).index
    assert index.n_pairs == 9
    density = [0.9 * math.exp(-2.0 * d * d) / (0.5 * math.sqrt(2.0 * math.pi)) for d in range(9)]
    gain = [math.log1p(p / (0.05 / 12.0)) for p in density]
    expected = 5 + max(d for d in range(9) if gain[d] > 0.5) + 1
    assert index.telling.tolist() == [expected]


def test_a_beam_that_returns_nothing_tells_of_all_its_cells():
    index = window_of(math.inf).index
    assert index.telling.tolist() == [index.n_pairs]


def test_arrival_is_the_product_of_what_is_free_before():
    index = window_of(5.0, math.inf, 3.2, bearing=-0.4).index
    telling = index.telling
    p = np.random.default_rng(1).random(index.n_cells).astype(np.float32) * np.float32(0.4)
    p[4 * 14 + 2] = 1.0
    expected = np.zeros(index.n_cells)
    for ray, told in zip(naive.rays_of(index), telling.tolist(), strict=True):
        chance = 1.0
        for cell in list(ray.cells)[:told]:
            expected[cell] = max(expected[cell], chance)
            chance *= 1.0 - float(p[cell]) if p[cell] > 0.1 else 1.0
    found = arrival(index, telling, p)
    assert found == pytest.approx(expected, abs=1e-6)
    assert 0 < np.count_nonzero(found) < index.touched().size
    few = arrival(index, telling, p, 0.5)
    assert few == pytest.approx(np.where(expected >= 0.5, expected, 0.0), abs=1e-6)


def test_arrival_is_the_same_by_both_halves_of_the_rays(monkeypatch):
    """Whatever way rays go, corners between cells included, and wherever they begin."""
    index = window_of(*[5.0, 3.2, 4.4] * 6, bearing=-math.pi, increment=math.pi / 8.0).index
    p = np.random.default_rng(2).random(index.n_cells).astype(np.float32) * np.float32(0.3)
    found = []
    for many in (10**6, 1):
        monkeypatch.setattr(informed, 'MANY_RAYS', many)
        found.append(arrival(index, index.telling, p).tolist())
    assert found[0] == found[1]
    expected = np.zeros(index.n_cells)
    rays = zip(naive.rays_of(index), index.telling.tolist(), index.rays, strict=True)
    for ray, told, held in rays:
        chance = 1.0
        places = [int(place_of(held[SHAPE] >> 48, cell % 14, cell // 14)) for cell in ray.cells]
        for cell, place in zip(ray.cells, places, strict=True):
            if place >= places[0] + told:
                break
            expected[cell] = max(expected[cell], chance)
            chance *= 1.0 - float(p[cell]) if p[cell] > 0.1 else 1.0
    assert found[0] == pytest.approx(expected.tolist(), abs=1e-6)


def test_near_counts_diagonals():
    cells = np.zeros((7, 9), bool)
    cells[3, 4] = True
    wide = near(cells, 2)
    assert wide.sum() == 25
    assert wide[1:6, 2:7].all()
    assert near(cells, 0).sum() == 1


def picture(*rows):
    """Probabilities of `.` free, `#` occupied, ` ` unsampled; capitals where a ray arrives."""
    values = {'.': 0.1, 'f': 0.1, '#': 0.9, 'X': 0.9, ' ': math.nan}
    p = np.array([[values[c] for c in row] for row in rows], np.float32)
    return p, np.array([[c in 'fX' for c in row] for row in rows])


def shown(reach, *rows):
    known = known_cells(*picture(*rows), reach)
    return [''.join('o' if k else '-' for k in row) for row in known]


def test_the_far_side_of_a_wall_is_unknown():
    """Neither what it is filled with nor free cells behind it, however sure the prior is."""
    assert shown(3, 'fffX##....', 'fffX##....', 'fff###....') == [
        'oooo------',
        'oooo------',
        'oooo------',
    ]


def test_a_wall_between_beams_is_known():
    assert shown(
        2,
        '####### ',
        'X##X##X ',
        'f..f..f ',
        'f..f..f ',
    ) == ['--------', 'ooooooo-', 'ooooooo-', 'ooooooo-']


def test_free_cells_that_lead_out_of_reach_are_unknown():
    """A beam along the upper row; nothing says where the free space below it ends."""
    known = shown(2, 'ffff', '....', '....', '....', '....', '####')
    assert known == ['oooo', '----', '----', '----', '----', '----']
    # Closed in three rows further on: all in reach.
    assert shown(3, 'ffff', '....', '....', '####', '####') == ['oooo'] * 4 + ['----']

"""First hits that are kept from a map of before, against those that are looked for."""

import numpy as np
import pytest
from support.strategies import fan

from ogm_mcmc.config import ForwardModelConfig, WindowConfig
from ogm_mcmc.geometry import PlacedScan, Pose2D
from ogm_mcmc.sampling import RayWindow, first_hits
from ogm_mcmc.sampling.first_hit_kernels import cell_at
from ogm_mcmc.sampling.first_hits import HitsBefore
from ogm_mcmc.sampling.first_hits import first_hits as hits_of
from ogm_mcmc.sampling.ray_line_kernels import BORDER, SHAPE, SLOPE, START, first_place


def scans_of(count, seed, spread):
    """Scans from all over; the last two are from where the first one is and see the same."""
    rng = np.random.default_rng(seed)
    placed = []
    for number in range(count):
        pose = Pose2D(*rng.uniform(-spread, spread, 2), rng.uniform(-3, 3))
        ranges = rng.uniform(0.5, 4.0, 20)
        if number >= count - 2:
            pose, ranges = placed[0].pose, placed[0].scan.ranges_m + rng.normal(0.0, 0.05, 20)
        scan = fan(*ranges, bearing=-3.0, increment=0.31, range_max_m=5.0)
        placed.append(PlacedScan.at(scan, pose))
    return placed


def window_of(scans):
    window = RayWindow(WindowConfig(resolution=0.2), ForwardModelConfig(sigma=0.1), merge=True)
    window.add(scans)
    return window


def on(cells, old, new, elsewhere):
    """A map of one window on another."""
    found = np.full((new.height, new.width), elsewhere, np.uint8)
    box = old.box.intersection(new.box)
    found[new.slices(box)] = cells.reshape(old.height, old.width)[old.slices(box)]
    return found.reshape(-1)


@pytest.mark.parametrize('elsewhere', [0, 1])
@pytest.mark.parametrize('opened', [0, 300])
@pytest.mark.parametrize('closed', [0, 40])
def test_hits_kept_while_rays_come_and_go_are_those_of_the_map(elsewhere, opened, closed):
    """In a window that grows on two sides, or shrinks; likelihoods of some rays change."""
    scans = scans_of(20, seed=1, spread=3.0)
    window, rng = window_of(scans[:14]), np.random.default_rng(2)
    old = window.spec
    cells = (rng.random(window.index.n_cells) < 0.05).astype(np.uint8)
    before = hits_of(cells, window.index)
    dropped = window.drop(scans[3:6])
    window.add([*dropped.again, *scans_of(3, 3, 6.0), *scans[14:]])
    assert window.spec != old
    assert window.said_more.size > 5
    now = on(cells, old, window.spec, elsewhere)
    now[rng.choice(np.flatnonzero(now), opened if elsewhere else min(opened, 30))] = 0
    now[rng.choice(np.flatnonzero(now == 0), closed)] = 1
    kept = HitsBefore(cells, old, before[dropped.staying], window.spec, window.said_more)
    found = hits_of(now, window.index, kept)
    expected = hits_of(now, window.index)
    assert np.array_equal(found[:, :3], expected[:, :3])
    assert np.array_equal(before[dropped.staying], kept.records)


def test_many_closed_cells_are_no_reason_to_look_at_each(monkeypatch):
    monkeypatch.setattr(first_hits, 'MOST_CLOSED', 3)
    window = window_of(scans_of(5, seed=4, spread=1.0))
    cells = np.zeros(window.index.n_cells, np.uint8)
    before = hits_of(cells, window.index)
    cells[window.index.touched()[::3]] = 1
    none = np.empty(0, np.int64)
    kept = HitsBefore(np.zeros_like(cells), window.spec, before, window.spec, none)
    assert np.array_equal(
        hits_of(cells, window.index, kept)[:, :3], hits_of(cells, window.index)[:, :3]
    )


def test_the_cell_at_every_place_of_every_ray():
    window = window_of(scans_of(6, seed=5, spread=2.0))
    width = window.spec.width
    for n in range(window.index.n_rays):
        ray = window.index.rays[n]
        cells, _, _ = window.index.ray(n)
        first = first_place(ray[START], ray[SHAPE])
        line = ray[BORDER], ray[SLOPE], ray[START], ray[SHAPE], width
        assert [cell_at(np.int32(first + i), *line) for i in range(cells.size)] == cells.tolist()

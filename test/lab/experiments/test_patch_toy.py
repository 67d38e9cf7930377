"""Nine combinations on 64 000 cells: who is refused, and what is cheap."""

import numpy as np
import pytest
from PIL import Image

from ogm_mcmc.engine import posterior
from ogm_mcmc.lab.experiments import patch_toy
from ogm_mcmc.plotting.grids import LEFT, LEGEND, TOP


def test_world_and_places():
    world = patch_toy.toy_world(1)
    assert world.occupied.size == 64_000
    scans = patch_toy.toy_scans(world, np.random.default_rng(1))
    assert len(scans) == 3
    for placed in scans:
        scan, pose = placed.scan, placed.pose
        column, row = world.spec.cell_of(pose.x_m, pose.y_m)
        assert not world.occupied[row - 8 : row + 9, column - 8 : column + 9].any()
        assert scan.ranges_m.size == 180


def test_robots_are_marked_on_every_map(tmp_path):
    world = patch_toy.toy_world(1)
    scans = patch_toy.toy_scans(world, np.random.default_rng(1))
    live = patch_toy.live_map(world, scans)
    maps = {'truth': world.truth(), 'L = 1, live': live}
    captions = patch_toy.draw_maps(tmp_path, maps, scans)
    assert list(captions) == ['truth.png', 'l1_live.png']
    for name in captions:
        with Image.open(tmp_path / name) as picture:
            pixels = np.asarray(picture.convert('RGB'))
        for pose in (placed.pose for placed in scans):
            # Two pixels a cell of 0.1 m, 200 rows of cells under the title and the legend.
            row, column = TOP + LEGEND + 400 - 20 * pose.y_m, LEFT + 20 * pose.x_m
            assert tuple(pixels[int(row), int(column)]) == (31, 119, 180)


@pytest.mark.full
def test_quick_run(tmp_path, caplog, monkeypatch):
    monkeypatch.setattr(patch_toy, 'SWEEPS', {1: 60, 9: 6, 25: 4})
    monkeypatch.setattr(patch_toy, 'FIGURE_SWEEPS', 1500)
    posterior._learned.cache_clear()
    posterior._patch_prior.cache_clear()
    result = patch_toy.run(tmp_path, quick=True, seed=1)
    assert [one.getMessage().count('prior learned at') for one in caplog.records] == [1]
    seconds = result['seconds_per_sample']
    refused = {name for name, value in seconds.items() if value is None}
    assert refused == {'L = 25, uniform', 'L = 25, border'}
    ours = {line['what']: line['ours'] for line in result['rows']}
    assert ours['L = 25, uniform: s per map sample'] == 'intractable'
    # The order of Table I: a border saves most of the work of larger patches.
    # Single cells with their own sampler are cheapest, once nothing has to be loaded.
    assert seconds['L = 1, uniform'] < seconds['L = 1, border']
    assert seconds['L = 9, border'] < seconds['L = 9, patch'] < seconds['L = 9, uniform']
    assert ours['L = 9, border: max F1'] > ours['traditional: max F1']
    for name in result['pictures']:
        assert (tmp_path / name).read_bytes().startswith(b'\x89PNG')

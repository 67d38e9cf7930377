"""Nine combinations on 64 000 cells: who is refused, and what is cheap."""

import numpy as np
import pytest

from ogm_mcmc.experiments import patch_toy


def test_world_and_places():
    world = patch_toy.toy_world(1)
    assert world.occupied.size == 64_000
    scans = patch_toy.toy_scans(world, np.random.default_rng(1))
    assert len(scans) == 3
    for scan, pose in scans:
        column, row = world.spec.cell_of(pose.x_m, pose.y_m)
        assert not world.occupied[row - 8 : row + 9, column - 8 : column + 9].any()
        assert scan.ranges_m.size == 180


@pytest.mark.slow
def test_quick_run(tmp_path):
    result = patch_toy.run(tmp_path, quick=True, seed=1)
    seconds = result['seconds_per_sample']
    refused = {name for name, value in seconds.items() if value is None}
    assert refused == {'L = 25, uniform', 'L = 25, border'}
    ours = {line['what']: line['ours'] for line in result['rows']}
    assert ours['L = 25, uniform: s per map sample'] == 'intractable'
    # The order of Table I: a border saves most of the work of larger patches.
    assert seconds['L = 9, border'] < seconds['L = 9, patch'] < seconds['L = 9, uniform']
    assert ours['L = 9, border: max F1'] > ours['traditional: max F1']
    for name in result['pictures']:
        assert (tmp_path / name).read_bytes().startswith(b'\x89PNG')

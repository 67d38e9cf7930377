"""`patch-stata` on a synthetic recording of exactly the shape of the real one.

The robot walks through the simulated office, 160 scans and half as many poses, imported as a user
would import the real bag.
"""

import json

import numpy as np
import pytest
from support.stata_files import SCAN_US, START_US, laser_poses, write_poses, write_pr2

from ogm_mcmc.cli.main import run
from ogm_mcmc.errors import BagError
from ogm_mcmc.io.stata_import import import_stata
from ogm_mcmc.lab.experiments.buildings import STATA, read_stata
from ogm_mcmc.lab.experiments.patch_hardware_page import METHODS
from ogm_mcmc.simulation import WORLDS, walk


@pytest.fixture(scope='module')
def bases():
    """Base poses of 36 s of a walk, one every 25 ms, thinned to 160 as if it ran."""
    building = WORLDS['office']()
    poses = walk(building.waypoints, period_s=0.225, speed_m_s=0.8, turn_rad_s=1.2)
    return [pose for pose, _ in zip(poses, range(160), strict=False)]


@pytest.fixture(scope='module')
def stata_data(bases, tmp_path_factory):
    """A folder of data with the imported bag in its place."""
    folder = tmp_path_factory.mktemp('data')
    write_pr2(folder / 'pr2.bag', WORLDS['office']().walls, bases, noise_m=0.01)
    write_poses(folder / 'poses', laser_poses(bases))
    (folder / 'stata').mkdir()
    import_stata(folder / 'pr2.bag', folder / 'poses', folder / STATA.path)
    return folder


def test_one_scan_for_every_pose(stata_data, bases):
    scans = read_stata(stata_data / STATA.path)
    assert len(scans) == 80
    stamps = [1000 * (START_US + 2 * k * SCAN_US) for k in range(80)]
    assert [scan.stamp_ns for scan, _ in scans] == stamps
    for placed, laser in zip(scans, laser_poses(bases), strict=True):
        assert placed.scan.ranges_m.size == 1040
        pose = placed.pose
        assert (pose.x_m, pose.y_m) == pytest.approx((laser.x_m, laser.y_m), abs=1e-4)


def test_only_as_many_poses_as_published(stata_data, monkeypatch):
    monkeypatch.setattr('ogm_mcmc.lab.experiments.buildings.POSES', 7)
    assert len(read_stata(stata_data / STATA.path)) == 7


def test_poses_between_scans_take_the_nearest(bases, tmp_path):
    """Poses 6 ms late: scans lie before them, at poses that are interpolated."""
    write_pr2(tmp_path / 'pr2.bag', WORLDS['office']().walls, bases)
    write_poses(tmp_path / 'poses', laser_poses(bases), shift_us=6000)
    import_stata(tmp_path / 'pr2.bag', tmp_path / 'poses', tmp_path / 'out')
    scans = read_stata(tmp_path / 'out')
    stamps = [1000 * (START_US + 2 * k * SCAN_US) for k in range(1, 80)]
    # The first scan is older than all poses; the scan after it takes the first pose.
    assert [scan.stamp_ns for scan, _ in scans][1:] == stamps
    assert scans[0][0].stamp_ns == 1000 * (START_US + SCAN_US)


def test_a_bag_without_its_topics_is_named(tmp_path, stata_data, office_bag):
    with pytest.raises(BagError, match='no scans in it on /scan'):
        read_stata(stata_data / 'pr2.bag')
    with pytest.raises(BagError, match='expected'):
        read_stata(tmp_path)


def test_the_experiment(stata_data, tmp_path, monkeypatch, capsys):
    """All of `--quick`, as a user calls it."""
    monkeypatch.setenv('OGM_MCMC_DATA', str(stata_data))
    monkeypatch.setenv('OGM_MCMC_WORKERS', '1')
    assert run(['experiment', 'patch-stata', '--quick', '-o', str(tmp_path)]) == 0
    assert 'experiment 6, border9: s per map sample' in capsys.readouterr().out
    result = json.loads((tmp_path / 'result.json').read_text())
    by_number = result['results']['10cm']
    sizes = {name: (of['cell']['poses'], of['cell']['beams']) for name, of in by_number.items()}
    assert sizes == {
        'experiment_4': (80, 8320), 'experiment_5': (8, 832), 'experiment_6': (1, 104),
    }  # fmt: skip
    shares = [of['traditional']['mapped_share'] for of in by_number.values()]
    assert shares[0] > shares[1] > shares[2] > 0.0
    for of in by_number.values():
        assert set(of) == set(METHODS)
        for one in of.values():
            assert (one['benchmark_poses'], one['benchmark_beams']) == (80, 83200)
            assert 0.0 < one['max_f1'] <= 1.0
            assert np.isfinite(one['heldout_loglik_per_beam'])
    first = by_number['experiment_4']['traditional']
    assert first['max_f1'] > 0.9
    # What held-out beams say falls with what a map has seen.
    said = [of['border9']['heldout_loglik_per_beam'] for of in by_number.values()]
    assert said[0] > said[1] > said[2]
    assert set(result['pictures']) <= {
        str(path.relative_to(tmp_path)) for path in tmp_path.rglob('*.png')
    }
    portions = {line['what']: line['ours'] for line in result['rows'] if 'portion' in line['what']}
    assert portions['10 cm, experiment 5: portion of cells mapped'] == shares[1]
    # Done again, nothing is sampled anew, and a picture that was removed is there again.
    removed = tmp_path / 'maps' / 'beam_10cm_exp6_cell.png'
    removed.unlink()
    parts = {path: path.stat().st_mtime_ns for path in (tmp_path / 'parts').iterdir()}
    assert run(['experiment', 'patch-stata', '--quick', '-o', str(tmp_path)]) == 0
    assert removed.is_file()
    assert {path: path.stat().st_mtime_ns for path in (tmp_path / 'parts').iterdir()} == parts

"""`map` with methods that have more to save than probabilities."""

import json

import numpy as np
import pytest
from support.strategies import fan

from ogm_mcmc.config import MapperConfig
from ogm_mcmc.engine.live_map import map_of
from ogm_mcmc.engine.tree_files import load_tree
from ogm_mcmc.geometry import PlacedScan, Pose2D, PoseBelief
from ogm_mcmc.io.map_files import load_npz
from ogm_mcmc.io.recording_bag import write_recording
from ogm_mcmc.io.tum_files import write_beliefs


def test_adaptive_saves_the_tree_and_says_what_it_takes(run_cli, office_bag, tmp_path):
    done = run_cli(
        *('map', office_bag, '-o', 'out', '--json', '--method', 'adaptive'),
        *('--resolution', '0.1', '--adaptive.coarsest-level', '3', '--adaptive.noise', '0.05'),
    )
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    method = load_tree(tmp_path / 'out' / 'map_tree.npz')
    assert result['files']['tree'] == 'out/map_tree.npz'
    assert method.config.adaptive.coarsest_level == 3
    assert method.config.adaptive.noise == 0.05
    saved = method.statistics()
    assert result['tree']['leaves'] == saved.leaves
    assert result['tree']['leaves_by_level'] == list(saved.leaves_by_level)
    with np.load(tmp_path / 'out' / 'map.npz') as data:
        spec = method.spec
        measured = method.probabilities(spec.box)
        assert np.isfinite(data['probability']).sum() == np.isfinite(measured).sum()
    plain = run_cli('map', office_bag, '-o', 'out', '--resolution', '0.1')
    assert plain.returncode == 0, plain.stderr
    assert not (tmp_path / 'out' / 'map_tree.npz').exists()


def test_levels_out_of_order_are_one_line(run_cli, office_bag):
    done = run_cli(
        'map', office_bag, '-o', 'out', '--method', 'adaptive', '--adaptive.finest-level', '9'
    )
    assert done.returncode == 2
    assert 'adaptive.finest_level is 9: must not be above' in done.stderr
    assert 'Traceback' not in done.stderr


def test_random_field_saves_the_variance(run_cli, office_bag, tmp_path):
    done = run_cli(
        'map', office_bag, '-o', 'out', '--method', 'random_field', '--resolution', '0.2'
    )
    assert done.returncode == 0, done.stderr
    with np.load(tmp_path / 'out' / 'map.npz') as data:
        shown = np.isfinite(data['probability'])
        assert data['variance'].shape == shown.shape
        assert (data['variance'][shown] < 0.9).all()
        assert (data['variance'] > 0.0).all()


def test_random_field_at_any_points(run_cli, office_bag, tmp_path):
    (tmp_path / 'points.csv').write_text('x,y\n5.05, 4.0\n5.1 4.03 # between centres\n-99,-99\n')
    options = ('--method', 'random_field', '--resolution', '0.2', '--points', 'points.csv')
    done = run_cli('map', office_bag, '-o', 'out', *options, '--json')
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert (result['points'], result['points_of_prior']) == (3, 1)
    told = np.genfromtxt(tmp_path / result['files']['points'], delimiter=',', names=True)
    assert told['x'].tolist() == [5.05, 5.1, -99.0]
    assert told['log_odds'][2] == 0.0
    assert told['variance'][2] == 1.0
    assert told['probability'] == pytest.approx(1.0 / (1.0 + np.exp(-told['log_odds'])))
    assert (told['variance'][:2] < 0.5).all()
    refused = run_cli('map', office_bag, '-o', 'out', '--points', 'points.csv')
    assert refused.returncode == 2
    assert 'two_assumption knows of cells alone: expected random_field' in refused.stderr


def test_pose_uncertain_averages_over_what_a_trajectory_leaves_open(run_cli, tmp_path):
    """The map of the command is that of the same beliefs in plain Python, cell for cell."""
    stamps = [k * 1_000_000_000 for k in (1, 2)]
    scans = [fan(0.5, 0.8, range_max_m=2.0, stamp_ns=stamp) for stamp in stamps]
    write_recording(tmp_path / 'bag', [PlacedScan.at(scan, Pose2D(9.0, 9.0)) for scan in scans])
    spreads = [(0.05, 0.1, 0.1), (0.0, 0.0, 0.0)]
    beliefs = [PoseBelief(Pose2D(0.52, 0.03, k), np.diag(np.square(spreads[k]))) for k in range(2)]
    # Where all of them are together is wider open, and blurs nothing.
    wide = [PoseBelief(belief.mean, belief.covariance + np.eye(3)) for belief in beliefs]
    write_beliefs(tmp_path / 'out_trajectory.txt', stamps, wide, np.array(spreads))
    settings = {'resolution': 0.1, 'no_return': 'ignore'}
    call = ('map', 'bag', '-o', 'out', '--trajectory', 'out_trajectory.txt')
    call += ('--resolution', '0.1', '--no-return', 'ignore', '--method', 'pose_uncertain')
    done = run_cli(*call)
    assert done.returncode == 0, done.stderr
    assert 'standard deviations of its poses from out_trajectory_deviations.csv' in done.stderr
    placed = [PlacedScan(*one) for one in zip(scans, beliefs, strict=True)]
    saved = load_npz(tmp_path / 'out' / 'map.npz')
    expected = map_of(placed, MapperConfig(method='pose_uncertain', **settings)).cropped()
    np.testing.assert_array_equal(saved.probability, expected.probability)
    assert (saved.spec.origin_x_m, saved.spec.origin_y_m) == pytest.approx(
        (expected.spec.origin_x_m, expected.spec.origin_y_m)
    )
    (tmp_path / 'out_trajectory_deviations.csv').write_text('stamp_s,x_m,y_m,yaw_rad\n')
    refused = run_cli(*call)
    assert refused.returncode == 2
    assert 'of 0 poses: expected those of 2 in out_trajectory.txt' in refused.stderr

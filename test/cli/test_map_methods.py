"""`map` with methods that have more to save than probabilities."""

import json

import numpy as np
import pytest

from ogm_mcmc.engine.tree_files import load_tree


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
    told = np.genfromtxt(
        tmp_path / json.loads(done.stdout)['files']['points'], delimiter=',', names=True
    )
    assert told['x'].tolist() == [5.05, 5.1, -99.0]
    assert told['log_odds'][2] == 0.0
    assert told['variance'][2] == 1.0
    assert told['probability'] == pytest.approx(1.0 / (1.0 + np.exp(-told['log_odds'])))
    assert (told['variance'][:2] < 0.5).all()
    refused = run_cli('map', office_bag, '-o', 'out', '--points', 'points.csv')
    assert refused.returncode == 2
    assert 'two_assumption knows of cells alone: expected random_field' in refused.stderr

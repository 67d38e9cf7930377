"""`sample`: what it leaves, how it goes on and ends, and the mistakes it names."""

import argparse
import json

import numpy as np
import pytest
import yaml
from PIL import Image
from support.office import COARSE, FEW, OFFICE_SCANS

from ogm_mcmc.cli.main import run
from ogm_mcmc.cli.sample import SHORT, _chosen, add_to
from ogm_mcmc.cli.sample_answer import answer_text
from ogm_mcmc.cli.sampling_bar import status
from ogm_mcmc.config import StopConfig, flatten, settings_of
from ogm_mcmc.config.nodes import LEARNED, REFINE_CONFIGS
from ogm_mcmc.engine.progress import Progress
from ogm_mcmc.evaluation.trajectories import absolute_errors
from ogm_mcmc.geometry import PlacedScan, Pose2D, PoseBelief
from ogm_mcmc.io.map_files import load_map, load_npz
from ogm_mcmc.io.recording_bag import write_recording
from ogm_mcmc.io.sample_files import load_samples
from ogm_mcmc.io.trajectory_files import read_trajectory
from ogm_mcmc.io.tum_files import read_deviations
from ogm_mcmc.simulation import WORLDS, Lidar, record
from ogm_mcmc.trajectory.alike import effective_count


def test_all_files_tell_the_same(sample, tmp_path):
    result = sample('-o', 'out', *FEW, '--samples', '200', '--thin', '2', '--margin', '0.05')
    out = tmp_path / 'out'
    names = ('map.json', 'map.npz', 'map.pgm', 'map.png', 'map.yaml', 'map_entropy.png')
    assert sorted(path.name for path in out.iterdir()) == sorted((*names, 'map_samples.npz'))
    assert json.loads((out / 'map.json').read_text()) == result
    assert (result['reason'], result['sweeps'], result['counted']) == ('sweeps', 80, 64)
    assert result['scans_used'] == OFFICE_SCANS
    # A few beams of a scan are lost.
    assert 0.99 < result['rays'] / (OFFICE_SCANS * 15) <= 1.0
    with np.load(out / 'map.npz') as data:
        mean, mcse, r_hat = data['posterior_mean'], data['mcse'], data['r_hat']
        known, everywhere = data['probability'], data['probability_everywhere']
        assert yaml.safe_load(str(data['settings'])) == result['settings']
    assert result['settings']['chain.seed'] == 1
    assert result['agreeing_share'] is None  # there is no rule to agree by
    touched = np.isfinite(mean)
    assert touched.sum() == result['cells'] > 1000
    assert mean.shape == mcse.shape == r_hat.shape == (result['height'], result['width'])
    assert np.array_equal(np.isnan(mcse), ~touched)
    assert np.nanmax(mcse) < 0.5
    assert np.nanmin(r_hat) > 0.9
    # The map itself is told where data moved it, as the node shows it.
    told = np.isfinite(known)
    assert np.array_equal(known[told], everywhere[told])
    assert np.array_equal(np.isfinite(everywhere), touched)
    # Its probability has up to a fifth of what cells reflected, which draws alone do not have. No
    # more: here beams that graze tell that walls are whole cells, so nothing is raised.
    apart = np.abs(known - mean)[told]
    assert 0.05 < apart.max() <= 0.2 + 1.0 / 400
    assert np.mean(known[told] == mean[told]) < 0.9
    assert 1000 < told.sum() < touched.sum()
    assert (known > 0.5).sum() > 200
    shown = load_map(out / 'map.yaml').probability
    # Prior 0.15, margin 0.05: known from a certainty of 0.9 on, where so many draws of the prior
    # would seldom be so far from it: two chains, 64 sweeps and two for every second sample. Where
    # data hardly came to, chains change a cell so rarely that some means are far from it, too.
    # What was drawn decides; free or occupied is by the probability, free to 0.25, occupied from
    # 0.65. Walls that the live map has, too, are shown from more than 0.55 of the draws on.
    by_chance = 3.0 * np.sqrt(0.15 * 0.85 / (2 * (64 + 200)))
    certain = told & (np.maximum(mean, 1.0 - mean) > 0.9) & (np.abs(mean - 0.15) > by_chance)
    assert np.array_equal(shown == 0.0, certain & (known <= 0.25))
    walls, solid = shown == 1.0, told & (known >= 0.65)
    assert ((certain & solid) <= walls).all()
    assert (walls <= (solid & (mean > 0.55))).all()
    assert np.array_equal(np.isfinite(shown), (shown == 0.0) | walls)
    assert (shown == 1.0).sum() > 200
    with Image.open(out / 'map_entropy.png') as image:
        assert image.size == (result['width'], result['height'])
    drawn = load_samples(out / 'map_samples.npz')
    assert drawn.maps.shape == (200, *mean.shape)
    assert np.array_equal(drawn.touched, touched)
    with np.load(out / 'map.npz') as data:
        assert np.array_equal(drawn.known, np.isfinite(data['probability']))
    assert drawn.prior == 0.15
    assert not drawn.maps[:, ~touched].any()
    # Draws of the same chains: their mean is the mean, within what 200 draws allow.
    error = np.abs(drawn.maps.mean(axis=0) - np.nan_to_num(mean))
    assert error[touched].mean() < 0.02
    assert drawn.spec.origin_x_m == pytest.approx(result['origin'][0])


def test_the_yaml_of_the_node_and_a_start_map(sample, tmp_path):
    (tmp_path / 'mine.yaml').write_text(
        'refine_server:\n  ros__parameters:\n    map_frame: map\n    max_scans: 200\n'
        '    chain:\n      prior: 0.3\n      seed: 9\n'
        '    window:\n      resolution: 0.4\n      keep: latest\n'
        'online_mapper:\n  ros__parameters:\n    prior: 0.5\n'
    )
    result = sample('-o', 'out', '--params-file', 'mine.yaml', *FEW, '--seed', '3')
    settings = result['settings']
    assert (settings['chain.prior'], settings['chain.seed']) == (0.3, 3)
    assert settings['window.resolution'] == 0.2
    assert result['scans_used'] == 200
    # Two chains from one map and without a sweep to forget it: they begin where it says.
    few = (*FEW, '--max-scans', '200', '--window.keep', 'latest')
    started = sample('-o', 'again', *few, '--start-map', 'out/map.npz')
    assert started['settings']['start_map'] == 'out/map.npz'
    assert load_npz(tmp_path / 'again' / 'map.npz').probability.shape == (
        result['height'], result['width'],
    )  # fmt: skip


def test_what_the_bar_says():
    progress = Progress(300, 250, 10.0, 20.0, 0.985, 1.034, 90.0, 0.01, -5.0, 8)
    # 200 sweeps were done in this run: 100 are left, 5 s; there would be time for 50 s.
    stop = StopConfig(max_sweeps=300, max_time=60.0)
    assert status(progress, stop, 200) == (
        '20.0 sweeps/s, R-hat 1.034 (99 %), 98.5 % agree, at most 5 s left'
    )
    assert status(progress, StopConfig(max_sweeps=300, max_time=12.0), 200).endswith('2 s left')
    assert 'agree' not in status(progress, StopConfig(r_hat=0.0), 200)


def test_defaults_are_those_of_the_node():
    """Two answers from the same scans would be hard to explain.

    But for poses: the node shows a map before it has estimated them, the command would wait.
    """
    parser = argparse.ArgumentParser()
    add_to(parser.add_subparsers())
    chosen = _chosen(parser.parse_args(['sample', 'bag', '-o', 'out']))
    node = {leaf.name: leaf.default for config in REFINE_CONFIGS for leaf in settings_of(config)}
    assert (node.pop('poses'), chosen.poses.poses) == ('auto', 'fixed')
    for config in chosen:
        for name, value in flatten(config).items():
            assert name not in node or node[name] == value, name
    assert chosen.sampler.patch == LEARNED
    assert chosen.shown.unknown_margin == node['unknown_margin']


def test_short_names_are_all_different():
    assert len(set(SHORT.values())) == len(SHORT)
    # The prior over patches; that of a cell has another name.
    assert SHORT['patch.prior'] == '--prior'
    assert SHORT['chain.prior'] == '--cell-prior'


def test_as_a_user_runs_it(run_process, office_bag, tmp_path):
    """From a shell, with a person's output; a wrong bag says so before anything else."""
    few = [option for option in FEW[:-2] if option != '--json']
    done = run_process('sample', office_bag, '-o', 'out', *few, '--r-hat', '1.2', '--name', 'm')
    assert done.returncode == 0, done.stderr
    assert 'Traceback' not in done.stderr
    assert (tmp_path / 'out' / 'm.yaml').exists()
    assert '% agree; stopped: ' in done.stdout
    done = run_process('sample', 'nowhere', '-o', 'there')
    assert done.returncode == 2
    assert 'nowhere: no such file or folder' in done.stderr


def walk_with_noisy_poses(path, every=40):
    """Write every so many-th scan of the office, its pose 5 cm and 1 degree off; return truth.

    The covariance that is written is 0: nothing is known of it.
    """
    rng = np.random.default_rng(3)
    deviations = np.array([0.05, 0.05, 0.02])
    walk = list(record(WORLDS['office'](), Lidar(beams=180), rng))[::every]
    noisy, truth = [], []
    for scan, belief in walk:
        x, y, yaw = deviations * rng.normal(size=3)
        pose = belief.mean
        truth.append((pose.x_m, pose.y_m, pose.yaw_rad))
        off = Pose2D(pose.x_m + x, pose.y_m + y, pose.yaw_rad + yaw)
        noisy.append(PlacedScan(scan, PoseBelief(off)))
    write_recording(path, noisy)
    return np.array(truth)


def test_poses_are_estimated_with_the_map(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    truth = walk_with_noisy_poses(tmp_path / 'noisy')
    few = ('--max-sweeps', '30', '--burn-in', '16', '--r-hat', '0', '--trajectory.draws', '10')
    call = ['sample', 'noisy', '-o', 'out', *COARSE[2:], *few]
    assert run([*call, '--poses', 'joint', '--state', 'state.npz']) == 0
    said = capsys.readouterr()
    first = json.loads(said.out)
    assert 'poses without odometry: none is there beside the poses in use' in said.err
    assert first['settings']['poses'] == 'joint'
    assert first['trajectory']['finished']
    assert 3.0 < 100.0 * first['trajectory']['moved_m'] < 12.0
    assert 0.0 < first['trajectory']['points_show'] < 3.0
    assert 1.0 <= first['trajectory']['stretches_show'] < 3.0
    # Where all of them are together scans leave open. Steps of centimetres are small beside the
    # guess of 0.3 m, so errors are alike: 29 beliefs count as hardly more than one. Ten draws have
    # this deviation to 16 %.
    alike = np.array(first['trajectory']['belief_correlation'])
    assert (alike > 0.9).all()
    together = 0.3 * np.sqrt((1.0 / effective_count(len(truth), alike[:2])).sum())
    assert first['trajectory']['deviation_m'] == pytest.approx(together, rel=0.5)
    found = read_trajectory(tmp_path / 'out' / 'map_trajectory.txt')
    poses = np.array([(pose.x_m, pose.y_m, pose.yaw_rad) for pose in found.poses])
    assert absolute_errors(poses, truth).distance_m.mean() < 0.02
    deviations = read_deviations(tmp_path / 'out' / 'map_trajectory.txt', found.stamps_ns)
    assert deviations.shape == (len(truth), 3)
    # Apart from where all of them are together: a few millimetres.
    apart = read_deviations(tmp_path / 'out' / 'map_trajectory.txt', found.stamps_ns, apart=True)
    assert (apart[:, :2] < 0.1 * deviations[:, :2]).all()
    alone = np.median(np.sqrt((apart[:, :2] ** 2).sum(axis=1)))
    assert first['trajectory']['deviation_apart_m'] == pytest.approx(alone, abs=1e-6)
    of_all = round(100.0 * first['trajectory']['deviation_m'])
    assert f'now sure to {100.0 * alone:.1f} cm, all together to {of_all} cm' in answer_text(first)
    # The same poses again, so the chains go on.
    assert run([*call, '--poses', 'joint', '--state', 'state.npz']) == 0
    assert json.loads(capsys.readouterr().out)['resumed_at'] == 30
    # Chains of other poses are another matter, and no trajectory is left from before.
    assert run([*call, '--state', 'state.npz']) == 2
    assert run(call) == 0
    assert not list((tmp_path / 'out').glob('map_trajectory*'))
    # Poses that err make ranges seem to scatter: the sensor is that of the poses of the map.
    fixed = json.loads(capsys.readouterr().out)['sensor']
    assert first['sensor']['sigma']['high_95'] < fixed['sigma']['low_95']
    assert first['sensor']['clutter']['mean'] < fixed['clutter']['mean']

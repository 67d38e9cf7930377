"""`sample` and what cannot be: one line, and nothing left behind."""

import numpy as np
import pytest
from support.office import COARSE
from support.refusals import error_line

from ogm_mcmc.cli.main import run
from ogm_mcmc.geometry import GridMap, GridSpec, Pose2D
from ogm_mcmc.io import ros_types
from ogm_mcmc.io.bags import BagWriter
from ogm_mcmc.io.map_files import save_npz


@pytest.mark.parametrize(
    ('options', 'reason'),
    [
        (['--cell-prior', '0'], 'error: chain.prior is 0.0'),
        (['--cell-prior', '1'], 'prior is 1.0'),
        (['--sigma', '1e-9'], 'sigma is 1e-09: expected 0, or 0.0001 or more'),
        (['--samples', '-1'], '--samples is -1: expected 0 or more'),
        (['--samples', '100000000'], '--samples 100000000: maps of '),
        (['--max-range', '0.01'], 'scans says anything within max_range = 0.01 m: nothing'),
        (['--thin', '0'], 'thin is 0'),
        (['--tiles', '2x2'], '--tiles: expected with --scheduler'),
        (
            ['--tiles', '2', '--scheduler', 'tcp://127.0.0.1:9'],
            '--tiles 2: expected columns x rows, such as 2x2',
        ),
        (['--thin', '5'], '--thin: expected with --samples'),
        (['--prior-file', 'notes.txt'], '--prior-file: expected with --prior patch or border'),
        (['--patch-size', '4'], 'error: patch.size is 4'),
        (['--margin', '0.6'], 'unknown_margin is 0.6'),
        (['--r-hat', '0.9'], 'r_hat is 0.9'),
        (['--max-memory-mb', '1', '--beam-stride', '1'], 'max_memory_mb = 1'),
        (['--max-sweeps', '50'], 'expected more than burn_in (50)'),
        (['--state', 'notes.txt'], 'expected a saved sampling state'),
        (['--state', 'notes.txt/state'], 'expected a writable folder'),
        (['--state', '.'], 'is a folder'),
        (['--start-map', 'notes.txt'], 'expected a map YAML'),
        (['--start-map', 'coarse.npz'], 'start map with cells of 0.3 m'),
        (['--start-map', 'between.npz'], 'anchored at (0.1, 0)'),
        (['--params-file', 'typo.yaml'], "'resolution'"),
        (['-o', 'notes.txt/out'], 'expected a writable folder'),
        (['--name', 'a/b'], 'expected a file name'),
    ],
    ids=lambda value: ' '.join(value) if isinstance(value, list) else '',
)
def test_a_mistake_is_one_line_and_leaves_nothing(
    office_bag, tmp_path, monkeypatch, capsys, options, reason
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'notes.txt').write_text('nothing of use\n')
    # A name of online_mapper: here it would silently mean nothing.
    (tmp_path / 'typo.yaml').write_text('/**:\n  ros__parameters:\n    resolution: 0.2\n')
    blank = np.zeros((2, 2), np.float32)
    save_npz(GridMap(GridSpec(0.3, 2, 2), blank), tmp_path / 'coarse.npz', {})
    save_npz(GridMap(GridSpec(0.2, 2, 2, anchor_x_m=0.1), blank), tmp_path / 'between.npz', {})
    before = sorted(path for path in tmp_path.rglob('*') if path.is_file())
    arguments = ['sample', str(office_bag), '-o', 'out', *COARSE]
    assert run([*arguments, *options]) == 2
    assert reason in error_line(capsys.readouterr().err)
    assert sorted(path for path in tmp_path.rglob('*') if path.is_file()) == before


def test_a_mistake_in_the_bag_is_said_before_kernels_are_compiled(tmp_path, monkeypatch, capsys):
    """It came after a silent minute where nothing was in the cache."""
    monkeypatch.setattr('ogm_mcmc.cli.sample.warm_up_sampling', lambda _: pytest.fail('compiled'))
    assert run(['sample', str(tmp_path / 'none'), '-o', str(tmp_path / 'out')]) == 2
    assert 'no such file' in capsys.readouterr().err


def test_limits_that_contradict_each_other_are_said_before_the_bag_is_read(
    tmp_path, monkeypatch, capsys
):
    monkeypatch.setattr('ogm_mcmc.cli.sample.read_bag', lambda *_, **__: pytest.fail('read'))
    assert run(['sample', str(tmp_path), '-o', str(tmp_path / 'out'), '--max-sweeps', '30']) == 2
    assert 'max_sweeps is 30: expected more than burn_in (50)' in capsys.readouterr().err


def test_a_bag_that_says_nothing(tmp_path, capsys):
    with BagWriter(tmp_path / 'bag') as bag:
        known = ros_types.pose_with_covariance(1, 'map', Pose2D(), np.zeros((3, 3)))
        bag.write('/pose', ros_types.POSE, 1, known)
        ranges = np.full(3, np.inf, np.float32)
        scan = ros_types.laser_scan(
            1, 'laser', ranges, angle_min=0.0, angle_increment=0.1, range_max=5.0
        )
        bag.write('/scan', ros_types.SCAN, 1, scan)
    arguments = ['sample', str(tmp_path / 'bag'), '-o', str(tmp_path / 'out')]
    assert run([*arguments, '--no-return', 'ignore']) == 2
    assert 'no beam of 1 scans says anything: nothing to sample' in capsys.readouterr().err
    assert not (tmp_path / 'out').exists()

"""The command line as a user meets it: results, JSON, and one line for every mistake."""

import json
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
import yaml
from support.office import OFFICE_SCANS
from support.refusals import error_line

from ogm_mcmc.cli.main import run
from ogm_mcmc.io.map_files import load_map

CARMEN = (
    'ODOM 0 0 0 0 0 0 0.5 host 0.5\n'
    'FLASER 180 ' + ' '.join(['2.0'] * 180) + ' 0 0 0 0 0 0 1.0 host 1.0\n'
    'FLASER 180 ' + ' '.join(['81.83'] * 180) + ' 0.1 0 0 0.1 0 0 2.0 host 2.0\n'
)


def error_of(done):
    assert done.returncode == 2, done.stderr
    return error_line(done.stderr)


def test_map_writes_all_files_and_says_so(run_process, office_bag, tmp_path):
    done = run_process('map', office_bag, '-o', 'out', '--json')
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert result['scans_used'] == result['scans'] == OFFICE_SCANS
    assert result['dropped'] == {}
    assert set(result['files']) == {'pgm', 'yaml', 'png', 'npz'}
    assert result['settings']['fusion'] == 'per_scan'
    assert json.loads((tmp_path / 'out' / 'map.json').read_text()) == result
    grid_map = load_map(tmp_path / 'out' / 'map.yaml')
    assert grid_map.probability.shape == (result['height'], result['width'])
    with np.load(tmp_path / 'out' / 'map.npz') as data:
        assert np.nanmax(data['probability']) <= 1.0
        assert yaml.safe_load(str(data['settings'])) == result['settings']
    # The outer wall of the office, 16 m x 12 m, is all around.
    assert result['width'] * 0.05 == pytest.approx(16.0, abs=0.2)
    assert result['height'] * 0.05 == pytest.approx(12.0, abs=0.2)


def test_map_takes_options_and_parameter_file(run_cli, office_bag, tmp_path):
    (tmp_path / 'mine.yaml').write_text(
        '/**:\n  ros__parameters:\n    resolution: 0.2\n    map_frame: map\n'
        '    step:\n      l_occ: 2.0\n'
    )
    done = run_cli(
        *('map', office_bag, '-o', 'out', '--json', '--params-file', 'mine.yaml'),
        *('--fusion', 'per_beam', '--step.l-occ', '1.0'),
    )
    assert done.returncode == 0, done.stderr
    settings = json.loads(done.stdout)['settings']
    assert settings['resolution'] == 0.2
    assert settings['step.l_occ'] == 1.0
    assert settings['fusion'] == 'per_beam'


def test_import_info_map(run_cli, tmp_path):
    (tmp_path / 'a.log').write_text(CARMEN)
    done = run_cli('import-carmen', 'a.log', '-o', 'bag', '--json')
    assert done.returncode == 0, done.stderr
    summary = json.loads(done.stdout)
    assert summary['scans'] == {'scan': 2}
    assert summary['no_return'] == 180
    info = run_cli('info', 'bag')
    assert info.returncode == 0, info.stderr
    for expected in ('rosbag2 (mcap)', '/scan', '/pose', '/odom', 'beams 180', 'LaserScan'):
        assert expected in info.stdout
    details = json.loads(run_cli('info', 'bag', '--json').stdout)
    assert {topic['name']: topic['n_messages'] for topic in details['topics']} == {
        '/odom': 1,
        '/pose': 2,
        '/scan': 2,
    }
    assert run_cli('map', 'bag', '-o', 'out', '--no-return', 'ignore').returncode == 0
    occupied = np.nansum(load_map(tmp_path / 'out' / 'map.yaml').probability)
    assert occupied > 100


def test_simulate_is_the_same_for_the_same_seed(run_cli, run_process, tmp_path):
    """Also in another process, where sets and dictionaries have another order."""
    maps = []
    for name, seed, simulate in (('a', 3, run_process), ('b', 3, run_cli), ('c', 4, run_cli)):
        done = simulate('simulate', 'office', '-o', name, '--seed', seed, '--beams', 24)
        assert done.returncode == 0, done.stderr
        assert run_cli('map', name, '-o', f'{name}_map').returncode == 0
        with np.load(tmp_path / f'{name}_map' / 'map.npz') as data:
            maps.append(data['probability'])
    assert np.array_equal(maps[0], maps[1], equal_nan=True)
    assert not np.array_equal(maps[0], maps[2], equal_nan=True)


def test_bench_prints_the_promised_json(run_cli, office_bag):
    done = run_cli('bench', 'online', office_bag, '--repeats', '1')
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    for part in ('scene', 'bag'):
        assert result[part]['ms'] > 0.0
        assert result[part]['scans_per_s'] > 0.0
        assert result[part]['ns_per_cell'] > 0.0
        assert result[part]['cells'] > 100_000
    assert result['scene']['scans'] == 100
    assert result['bag']['scans'] == OFFICE_SCANS


def test_bench_with_doubt_about_the_poses(run_cli):
    done = run_cli(
        *('bench', 'online', '--repeats', '1', '--method', 'pose_uncertain'),
        *('--pose-sigma', '0.1', '--yaw-sigma', '0.02', '--pose-uncertain.samples', '5'),
    )
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)['scene']['samples'] == 5


def write_scan_only_bag(path):
    from ogm_mcmc.io import ros_types
    from ogm_mcmc.io.bags import BagWriter

    with BagWriter(path) as bag:
        ranges = np.ones(3, np.float32)
        scan = ros_types.laser_scan(
            1, 'laser', ranges, angle_min=0.0, angle_increment=0.1, range_max=5.0
        )
        bag.write('/scan', ros_types.SCAN, 1, scan)


@pytest.mark.parametrize(
    ('arguments', 'reason'),
    [
        (['map', 'nowhere', '-o', 'out'], 'nowhere: no such file or folder'),
        (['map', 'notes.txt', '-o', 'out'], 'notes.txt'),
        (['map', 'scans_only', '-o', 'out'], 'no poses in it'),
        (['map', '{bag}', '-o', 'notes.txt/out'], 'expected a writable folder'),
        (['map', '{bag}', '-o', 'out', '--resolution', '0'], 'resolution is 0.0'),
        (['map', '{bag}', '-o', 'out', '--resolution', 'fine'], 'resolution'),
        (['map', '{bag}', '-o', 'out', '--free-thresh', '0.8'], 'free_thresh is 0.8'),
        (['map', '{bag}', '-o', 'out', '--max-pose-gap', 'nan'], 'max_pose_gap is nan'),
        (['map', '{bag}', '-o', 'out', '--params-file', 'typo.yaml'], "'resolutoin'"),
        (['map', '{bag}', '-o', 'out', '--method', 'magic'], 'magic'),
        (['map', '{bag}', '-o', 'out', '--scan-topic', '/pose'], 'has type'),
        (['map', '{bag}', '-o', 'out', '--scan-topic', '/front'], 'no scans in it on /front'),
        (['map', '{bag}', '-o', 'out', '--params-file', 'notes.txt'], 'notes.txt'),
        (['map', '{bag}', '-o', 'out', '--max-cells', '5000'], 'max_cells'),
        (['import-carmen', 'notes.txt', '-o', 'out'], 'no laser line in it'),
        (['import-carmen', 'nowhere.log', '-o', 'out'], 'nowhere.log'),
        (['info', 'notes.txt'], 'notes.txt'),
        (['replay', 'nowhere'], 'nowhere: no such file or folder'),
        (['bench', 'online', '--scene', 'notes.txt'], 'expected an NPZ'),
        (['bench', 'online', '--pose-sigma', '-1'], '--pose-sigma is -1: expected'),
        (
            ['bench', 'online', '--yaw-sigma', '1e9'],
            '--yaw-sigma is 1000000000: expected 0 to 1000',
        ),
        (['bench', 'online', '--repeats', '0'], '--repeats is 0: expected 1 or more'),
        (['bench', 'online', '--resolution', '0.3'], '--resolution: expected with a BAG'),
        (['bench', 'refine', '--resolution', '0.3'], '--resolution: expected with a BAG'),
        (['bench', 'refine', '--only-bag'], '--only-bag: expected with a BAG'),
        (['bench', 'refine', '--time', '0'], '--time is 0: expected 0.1 to'),
        (['bench', 'online', '--scan-topic', '/none'], '--scan-topic: expected with a BAG'),
        (['bench', 'online', '--scene', 'empty.npz'], 'empty.npz: expected an NPZ'),
        (['bench', 'online', '--scene', 'cut.npz'], 'cut.npz: expected an NPZ'),
        (
            ['import-carmen', 'ok.log', '-o', 'out', '--range-max', '1e300'],
            '--range-max is 1e+300',
        ),
        (['import-carmen', 'ok.log', '-o', 'out', '--range-max', 'nan'], '--range-max is nan'),
        (['import-carmen', 'ok.log', '-o', 'out', '--particles', '-1'], '--particles is -1'),
        (['import-carmen', 'ok.log', '-o', 'out', '--repeat-step', '0'], '--repeat-step is 0'),
        (
            ['import-stata', '{bag}', '--poses', 'p', '-o', 'out', '--time-offset', '1e300'],
            '--time-offset is 1e+300: expected',
        ),
        (
            ['import-stata', '{bag}', '--poses', 'p', '-o', 'out', '--offset-x', '1e300'],
            '--offset-x is 1e+300: expected -100 to 100 m',
        ),
        (
            ['import-stata', '{bag}', '--poses', 'p', '-o', 'out', '--max-pose-gap', '0'],
            '--max-pose-gap is 0: expected',
        ),
        (
            ['import-stata', '{bag}', '--poses', 'p', '-o', '{bag}', '--overwrite'],
            'is the bag to read; expected a new name',
        ),
        (
            ['import-stata', '{bag}', '--poses', 'p', '-o', 'out', '--odometry-topic', '/none'],
            'no odometry in it on /none',
        ),
        (
            ['import-carmen', 'ok.log', '-o', 'notes.txt'],
            'notes.txt: exists and is no rosbag2; expected a new name',
        ),
        (['replay', '{bag}', '--rate', '-1'], 'error: rate is -1.0: expected a number from 0'),
        (['map', 'nowhere', '-o', 'a/new/out'], 'nowhere'),
        (['map', '{bag}', '-o', 'out', '--method', 'sonar'], 'no ranges in it'),
        (['map', '{bag}', '-o', 'out', '--mount.frames', 'a 1'], 'mount.frames'),
        (['simulate', 'moon', '-o', 'out'], 'moon'),
        (['simulate', 'office', '-o', 'out', '--seed', '-1'], '--seed is -1'),
        (['demo', 'nowhere.log'], 'nowhere.log'),
        ([], 'COMMAND'),
    ],
    ids=lambda value: ' '.join(value)[:40] if isinstance(value, list) else '',
)
def test_a_mistake_is_one_line_and_leaves_nothing(
    run_cli, office_bag, tmp_path, arguments, reason
):
    (tmp_path / 'notes.txt').write_text('nothing of use\n')
    (tmp_path / 'typo.yaml').write_text('/**:\n  ros__parameters:\n    resolutoin: 0.2\n')
    (tmp_path / 'ok.log').write_text(CARMEN)
    (tmp_path / 'empty.npz').write_bytes(b'')
    (tmp_path / 'cut.npz').write_bytes(b'PK\x03\x04 and no more')
    write_scan_only_bag(tmp_path / 'scans_only')
    before = sorted(tmp_path.rglob('*'))
    done = run_cli(*(argument.format(bag=office_bag) for argument in arguments))
    assert reason in error_of(done)
    left = [path for path in sorted(tmp_path.rglob('*')) if path not in before]
    assert left == []


def test_an_existing_bag_is_not_overwritten_by_accident(run_cli, tmp_path):
    (tmp_path / 'a.log').write_text(CARMEN)
    assert run_cli('import-carmen', 'a.log', '-o', 'bag').returncode == 0
    assert 'exists already' in error_of(run_cli('import-carmen', 'a.log', '-o', 'bag'))
    assert run_cli('import-carmen', 'a.log', '-o', 'bag', '--overwrite').returncode == 0


def test_a_mount_is_taken_into_account(run_cli, tmp_path):
    """A beam ahead and one to the left, from a sensor ahead of the base and head down."""
    from ogm_mcmc.geometry import Pose2D
    from ogm_mcmc.io import ros_types
    from ogm_mcmc.io.bags import BagWriter

    with BagWriter(tmp_path / 'bag') as bag:
        known = ros_types.pose_with_covariance(1, 'map', Pose2D(0.05, 0.05), np.zeros((3, 3)))
        bag.write('/pose', ros_types.POSE, 1, known)
        ranges = np.array([1.0, 2.0], np.float32)
        scan = ros_types.laser_scan(
            1, 'laser', ranges, angle_min=0.0, angle_increment=np.pi / 2, range_max=5.0
        )
        bag.write('/scan', ros_types.SCAN, 1, scan)
    (tmp_path / 'mine.yaml').write_text(
        'online_mapper:\n  ros__parameters:\n    resolution: 0.1\n    map_frame: map\n'
        '    mount:\n      x: 0.5\n      upside_down: true\n'
    )
    done = run_cli('map', 'bag', '-o', 'out', '--params-file', 'mine.yaml', '--json')
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)['settings']['mount.x'] == 0.5
    grid_map = load_map(tmp_path / 'out' / 'map.yaml')
    rows, columns = np.nonzero(grid_map.probability == 1.0)
    points = {grid_map.spec.center_of(int(c), int(r)) for r, c in zip(rows, columns, strict=True)}
    assert {(round(x, 3), round(y, 3)) for x, y in points} == {(1.55, 0.05), (0.55, -1.95)}


@pytest.mark.parametrize('how', [signal.SIGINT, signal.SIGTERM])
def test_a_stop_in_the_middle_leaves_the_old_map_or_the_new_one(office_bag, tmp_path, how):
    """Whenever it comes: no traceback, no other file, and never half of a set."""
    folder = tmp_path / 'maps'
    command = [sys.executable, '-m', 'ogm_mcmc', 'map', str(office_bag), '-o', str(folder)]
    subprocess.run([*command, '--resolution', '0.2'], check=True, capture_output=True)
    names = sorted(path.name for path in folder.iterdir())
    for delay_s in (0.2, 0.7, 1.0, 1.2, 1.4):
        process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
        time.sleep(delay_s)
        process.send_signal(how)
        _, errors = process.communicate(timeout=60)
        # Until our code runs the interpreter says so itself: ended by the signal, or code 1.
        if process.returncode >= 0 and 'init_import_site' not in errors:
            assert process.returncode in (0, 130, 143)
            assert 'Traceback' not in errors
        assert sorted(path.name for path in folder.iterdir()) == names
        settings = json.loads((folder / 'map.json').read_text())['settings']
        described = yaml.safe_load((folder / 'map.yaml').read_text())
        assert described['resolution'] == settings['resolution']


@pytest.mark.parametrize('name', ['', '..', '../map', 'a/b', '.map'])
def test_map_names_stay_inside_the_folder(run_cli, office_bag, tmp_path, name):
    done = run_cli('map', office_bag, '-o', 'maps', '--name', name)
    assert 'expected a file name' in error_of(done)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ('option', 'reason'),
    [('~nosuchuser/maps', 'home directory'), ('x' * 300, 'at most 255 bytes'), ('', 'is empty')],
)
def test_a_path_that_cannot_be_is_named_with_its_option(capsys, option, reason):
    with pytest.raises(SystemExit) as stopped:
        run(['map', 'bag', '-o', option])
    assert stopped.value.code == 2
    error = capsys.readouterr().err.splitlines()[-1]
    assert error.startswith('ogm_mcmc map: error: argument -o: ')
    assert reason in error

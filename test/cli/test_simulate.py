"""`simulate`: a bag, the true map and the true poses, which agree with each other."""

import csv
import json
import signal

import numpy as np
import pytest
from PIL import Image
from support.commands import command
from support.refusals import error_line

from ogm_mcmc.cli import simulate
from ogm_mcmc.cli.simulated_world import CELLS, check_cells
from ogm_mcmc.engine.bag_scans import PlacedScans, StreamChoice, choose_topics
from ogm_mcmc.errors import ConfigError
from ogm_mcmc.files import output_files
from ogm_mcmc.io.bags import BagReader
from ogm_mcmc.io.map_files import load_map
from ogm_mcmc.io.trajectory_files import read_trajectory
from ogm_mcmc.simulation import Exploration, GridWorld


def placed_scans(path):
    with BagReader(path) as bag:
        choice = StreamChoice()
        return list(PlacedScans(bag, choose_topics(bag, choice), choice))


@pytest.mark.jit
def test_bag_truth_and_poses_agree(tmp_path, capsys):
    code, out, err = command(
        capsys, 'simulate', 'building-10', '-o', tmp_path / 'bag', '--json', '--max-scans', 15,
        '--beams', 60, '--range-max', 7.5, '--noise', 0, '--dropout', 0,
    )  # fmt: skip
    assert code == 0, err
    result = json.loads(out)
    assert result['scans'] == 15
    world = GridWorld.from_map(load_map(tmp_path / 'bag_truth.yaml'))
    placed = placed_scans(tmp_path / 'bag')
    with (tmp_path / 'bag_poses.csv').open() as stream:
        rows = list(csv.DictReader(stream))
    assert [int(row['stamp_ns']) for row in rows] == [p.scan.stamp_ns for p in placed]
    for row, (scan, belief) in zip(rows, placed, strict=True):
        assert belief.mean.x_m == pytest.approx(float(row['x_m']), abs=1e-12)
        assert belief.mean.yaw_rad == pytest.approx(float(row['yaw_rad']), abs=1e-9)
        bearings = scan.angle_min_rad + scan.angle_increment_rad * np.arange(60)
        exact = world.ranges(belief.mean, bearings, 7.5)
        exact[exact > 7.5] = np.inf
        # Angles go through float32 in a message: a grazing beam may meet another cell.
        same = np.isclose(scan.ranges_m, exact, atol=1e-4)
        assert same.mean() > 0.9


def _against_truth(capsys, maps, truth):
    """Return the figures of a map beside the truth, in the cells that it measured."""
    code, out, _ = command(
        capsys, 'evaluate', maps / 'map.npz', '--truth', truth, '--json',
        '-o', maps, '--mask', 'measured',
    )  # fmt: skip
    assert code == 0
    return json.loads(out)


@pytest.mark.jit
def test_mapped_and_evaluated(tmp_path, capsys):
    """The whole way, and what comes out is the building."""
    bag, maps = tmp_path / 'bag', tmp_path / 'maps'
    arguments = ('--beams', 180, '--range-max', 7.5, '--noise-cells', 0.5)
    assert command(capsys, 'simulate', 'building-10', '-o', bag, *arguments)[0] == 0
    assert command(capsys, 'map', bag, '-o', maps, '--resolution', 0.1)[0] == 0
    figures = _against_truth(capsys, maps, tmp_path / 'bag_truth.yaml')
    assert figures['measured_cells'] > 180_000
    assert figures['roc_area'] > 0.98
    assert figures['best']['f1'] > 0.7


@pytest.mark.jit
def test_a_turned_world_is_mapped_and_evaluated(tmp_path, capsys):
    """What beams meet is where the truth has it, on a lattice that no wall follows."""
    bag, maps, picture = tmp_path / 'bag', tmp_path / 'maps', np.zeros((80, 110), np.uint8)
    picture[6:-6, 6:-6] = 255
    picture[6:50, 54:60] = 0
    Image.fromarray(picture).save(tmp_path / 'room.png')
    arguments = ('--turn', 23, '--beams', 180, '--noise', 0, '--min-scans', 4)
    assert command(capsys, 'simulate', tmp_path / 'room.png', '-o', bag, *arguments)[0] == 0
    assert command(capsys, 'map', bag, '-o', maps)[0] == 0
    figures = _against_truth(capsys, maps, tmp_path / 'bag_truth.yaml')
    assert figures['cells'] > 4000
    assert figures['roc_area'] > 0.95
    assert figures['best']['f1'] > 0.7


@pytest.mark.jit
def test_noise_in_cells_and_in_metres(tmp_path, capsys):
    """Cells of this world are 0.1 m: 2 cells are 0.2 m, to the last digit."""
    for name, noise in (('a', ('--noise-cells', 2)), ('b', ('--noise', 0.2))):
        few = ('--max-scans', 3, '--beams', 30)
        assert (
            command(capsys, 'simulate', 'building-9', '-o', tmp_path / name, *few, *noise)[0] == 0
        )
    for one, other in zip(placed_scans(tmp_path / 'a'), placed_scans(tmp_path / 'b'), strict=True):
        assert np.array_equal(one.scan.ranges_m, other.scan.ranges_m, equal_nan=True)


def test_a_picture_as_a_world(tmp_path, capsys):
    pixels = np.zeros((60, 80), np.uint8)
    pixels[5:-5, 5:-5] = 255
    pixels[30:34, 40:44] = 0
    Image.fromarray(pixels).save(tmp_path / 'hall.png')
    arguments = ('--resolution', 0.1, '--min-scans', 10, '--range-max', 3, '--beams', 90)
    code, out, _ = command(
        capsys, 'simulate', tmp_path / 'hall.png', '-o', tmp_path / 'bag', '--json', *arguments
    )
    assert code == 0
    assert json.loads(out)['scans'] >= 10
    truth = load_map(tmp_path / 'bag_truth.yaml')
    assert np.array_equal(truth.probability == 1.0, pixels[::-1] == 0)


@pytest.mark.jit
def test_believed_poses(tmp_path, capsys):
    """Particles instead of the truth in the bag; the truth beside it."""
    code, _, err = command(
        capsys, 'simulate', 'building-9', '-o', tmp_path / 'bag', '--localize', '--particles', 30,
        '--max-scans', 4, '--range-max', 7.5, '--beams', 90,
    )  # fmt: skip
    assert code == 0, err
    with (tmp_path / 'bag_poses.csv').open() as stream:
        true = [(float(row['x_m']), float(row['y_m'])) for row in csv.DictReader(stream)]
    with BagReader(tmp_path / 'bag') as bag:
        assert {topic.name: topic.n_messages for topic in bag.topics()} == {
            '/odom': 4, '/particles': 4, '/pose': 4, '/scan': 4,
        }  # fmt: skip
        choice = StreamChoice(pose_source='particles')
        placed = list(PlacedScans(bag, choose_topics(bag, choice), choice))
    for (_, belief), (x, y) in zip(placed, true, strict=True):
        assert belief.particles.poses.shape == (30, 3)
        assert np.hypot(belief.mean.x_m - x, belief.mean.y_m - y) < 0.3
        assert belief.mean.x_m != x


@pytest.mark.parametrize(
    ('arguments', 'reason'),
    [
        (['moon'], "world 'moon': expected office, ring, building-1"),
        (['notes.png'], 'expected a readable image'),
        (['office', '--beams', '0'], '--beams is 0: expected 1 to 100000'),
        (['office', '--seed', '-1'], '--seed is -1: expected 0 or more'),
        (['office', '--resolution', '0'], '--resolution is 0: expected 0.002 to 10 m'),
        (['building-1', '--clutter', '2'], '--clutter is 2: expected 0 to below 1'),
        (
            ['building-1', '--range-max', '0.01'],
            '--range-max is 0.01: expected more than --range-min',
        ),
        (['building-1', '--radius', '90'], '--radius is 90: expected 0 to 10 m (0 to 100 cells'),
        (['building-1', '--depth', '2'], '--depth is 2: expected 0 to 1'),
        (['building-1', '--noise', '1', '--noise-cells', '1'], 'not allowed with'),
        (['office', '--localize'], '--localize: expected with a world of cells, not office'),
        (['building-1', '--localize', '--particles', '0'], '--particles is 0: expected 1 to'),
        (['building-1', '--max-scans', '-3'], '--max-scans is -3: expected 1 or more'),
        (['building-1', '--min-scans', '-3'], '--min-scans is -3: expected 0 or more'),
        (
            ['building-1', '--min-scans', '8', '--max-scans', '2'],
            'expected at most --max-scans (2)',
        ),
        (['building-1', '--min-scans', '1001'], '--min-scans is 1001: expected at most'),
        (['building-1', '--radius', '-1'], '--radius is -1: expected 0 to 10 m'),
        (['building-1', '--radius', 'nan'], '--radius is nan: expected 0 to 10 m'),
        (['building-1', '--radius', '9'], 'expected a free place with 9 m of room'),
        (
            ['building-1', '--range-max', '1e9'],
            '--range-max is 1000000000: expected 0 to 100000 m',
        ),
        (
            ['building-1', '--range-max', '20000'],
            '--range-max is 20000: expected 0.1 to below 10000 m',
        ),
        (['building-1', '--range-min', '50'], '--range-min is 50: expected less than --range-max'),
        (['building-1', '--range-min', '-1'], '--range-min is -1: expected 0 to'),
        (['office', '--range-max', '1e300'], '--range-max is 1e+300: expected'),
        (['office', '--noise', '1e308'], '--noise is 1e+308: expected'),
        (['office', '--noise-cells', 'nan'], '--noise-cells is nan: expected 0 to 100000 cells'),
        (
            ['office', '--field-of-view', '720'],
            '--field-of-view is 720: expected 0.001 to 360 deg',
        ),
        (['office', '--resolution', '1e-6'], '--resolution is 1e-06: expected'),
        (['building-1', '--localize', '--particles', '1000000000'], '--particles is 1000000000'),
        (
            ['office', '--max-scans', '5'],
            '--max-scans: expected with a world of cells, not office',
        ),
        (['office', '--min-scans', '9'], '--min-scans: expected with a world of cells'),
        (['office', '--radius', '0.25'], '--radius: expected with a world of cells'),
        (['office', '--depth', '0.5'], '--depth: expected with a world of cells'),
        (['office', '--unknown', 'free'], '--unknown: expected with a map'),
        (['office', '--world-seed', '0'], '--world-seed: expected with building-1 to building-10'),
        (['hall.yaml', '--world-seed', '1'], '--world-seed: expected with building-1'),
        (
            ['hall.yaml', '--resolution', '0.1'],
            '--resolution: expected with office, ring or an',
        ),
        (
            ['building-9', '--resolution', '-1'],
            '--resolution: expected with office, ring or an',
        ),
        (['building-9', '--unknown', 'free'], '--unknown: expected with a map YAML'),
        (['building-9', '--particles', '9'], '--particles: expected with --localize'),
        (['office', '--turn', '9'], '--turn: expected with a world of cells'),
        (['building-9', '--turn', '400'], '--turn is 400: expected -360 to 360 degrees'),
        (['building-9', '--turn', '9', '--drive'], '--turn: expected without --localize and'),
        (['building-9', '--turn', '9', '--localize'], '--turn: expected without --localize and'),
        (['building-9', '--truth-resolution', '0.1'], '--truth-resolution: expected with --turn'),
        (
            ['building-9', '--turn', '0', '--truth-resolution', '0.1'],
            '--truth-resolution: expected with --turn',
        ),
        (
            ['building-9', '--turn', '9', '--truth-resolution', '1e-320'],
            'expected 0, or 0.0001 to 10 m',
        ),
        (
            ['building-9', '--turn', '9', '--truth-resolution', '1e-3'],
            'the turned truth of building-9 would have 57',
        ),
    ],
    ids=lambda value: ' '.join(value) if isinstance(value, list) else '',
)
def test_a_mistake_is_one_line_and_leaves_nothing(
    tmp_path, monkeypatch, capsys, arguments, reason
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'notes.png').write_text('nothing of use')
    (tmp_path / 'hall.yaml').write_text('nothing either')
    code, _, err = command(capsys, 'simulate', *arguments, '-o', 'bag')
    assert code == 2
    assert reason in error_line(err)
    assert {path.name for path in tmp_path.iterdir()} == {'notes.png', 'hall.yaml'}


@pytest.mark.jit
def test_the_truth_of_another_recording_is_not_overwritten(tmp_path, capsys):
    few = ('--max-scans', 1, '--beams', 4)
    (tmp_path / 'bag_poses.csv').write_text('mine')
    code, _, err = command(capsys, 'simulate', 'building-9', '-o', tmp_path / 'bag', *few)
    assert code == 2
    assert 'bag_poses.csv: exists already' in err
    again = ('simulate', 'building-9', '-o', tmp_path / 'bag', *few, '--overwrite')
    assert command(capsys, *again)[0] == 0
    assert command(capsys, *again)[0] == 0


@pytest.mark.jit
def test_a_stop_leaves_the_old_recording_with_its_truth_or_the_new_one(
    tmp_path, monkeypatch, capsys
):
    """The bag was new and all that belongs to it of the one before, or there was nothing of it."""

    def stop(*_):
        signal.raise_signal(signal.SIGINT)

    call = ('simulate', 'building-9', '-o', tmp_path / 'bag', '--max-scans', 1, '--overwrite')
    with monkeypatch.context() as patch:
        patch.setattr(simulate, 'write_shown', stop)
        assert command(capsys, *call, '--beams', 4)[0] == 130
        assert list(tmp_path.iterdir()) == []
    assert command(capsys, *call, '--beams', 4)[0] == 0
    before = contents(tmp_path)
    with monkeypatch.context() as patch:
        patch.setattr(simulate, 'write_shown', stop)
        assert command(capsys, *call, '--beams', 5, '--seed', 2)[0] == 130
    assert contents(tmp_path) == before
    # Once the first is in its place all others follow.
    with monkeypatch.context() as patch:
        exchange = output_files.replace_folder
        patch.setattr(output_files, 'replace_folder', lambda *a: (exchange(*a), stop()))
        assert command(capsys, *call, '--beams', 5, '--seed', 2)[0] == 130
    after = contents(tmp_path)
    assert set(after) == set(before)
    assert not [
        name for name in after if after[name] == before[name] and name.endswith(('mcap', 'csv'))
    ]
    assert command(capsys, *call, '--beams', 5, '--seed', 2)[0] == 0
    assert contents(tmp_path)['bag_poses.csv'] == after['bag_poses.csv']


def contents(folder):
    paths = (path for path in folder.rglob('*') if path.is_file())
    return {str(path.relative_to(folder)): path.read_bytes() for path in paths}


@pytest.mark.parametrize('overwrite', [[], ['--overwrite']])
def test_a_folder_in_the_way_cannot_be_overwritten(tmp_path, capsys, overwrite):
    (tmp_path / 'bag_truth.yaml').mkdir()
    few = ('--max-scans', 1, '--beams', 4)
    code, _, err = command(
        capsys, 'simulate', 'building-9', '-o', tmp_path / 'bag', *few, *overwrite
    )
    assert code == 2
    assert 'bag_truth.yaml: is a folder; expected a name for a file' in err
    assert '--overwrite' not in err


@pytest.mark.jit
def test_the_world_is_not_overwritten_with_its_truth(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    few = ('-o', 'bag', '--max-scans', 1, '--beams', 4)
    assert command(capsys, 'simulate', 'building-9', *few)[0] == 0
    held = (tmp_path / 'bag_truth.yaml').read_bytes()
    world = tmp_path / 'bag_truth.yaml'
    code, _, err = command(capsys, 'simulate', world, *few, '--overwrite')
    assert code == 2
    assert 'bag_truth.yaml: is the world itself' in err
    assert world.read_bytes() == held


@pytest.mark.parametrize('name', CELLS)
@pytest.mark.parametrize('end', ['low', 'high'])
def test_cells_are_what_a_robot_can_do(name, end):
    """What passes is taken by `Exploration`, and just beyond is not."""
    allowed = CELLS[name]
    limit = getattr(allowed, end)
    beyond = np.nextafter(limit, -np.inf if end == 'low' else np.inf)
    field = {'radius': 'radius', 'range_max': 'reach'}[name]
    for value in (limit, beyond, np.nextafter(limit, 5.0)):
        try:
            Exploration(**{field: float(value)})
        except ConfigError:
            assert not allowed.holds(float(value))
            with pytest.raises(ConfigError, match=r'^--.* cells of 1 m'):
                check_cells(name, float(value), 1.0)
        else:
            assert allowed.holds(float(value))
            check_cells(name, float(value), 1.0)


@pytest.mark.jit
def test_a_drive_with_drift_and_the_trajectory_that_corrects_it(tmp_path, capsys):
    """Odometry, scans and poses at the sensor's rate; corrected poses where the loop closes."""
    code, out, err = command(
        capsys, 'simulate', 'office', '--drive', '-o', tmp_path / 'bag', '--json', '--beams', 40,
        '--rate', 5, '--speed', 2, '--turn-rate', 5, '--poses', 'drifting', '--drift', 1,
    )  # fmt: skip
    assert code == 0, err
    count = json.loads(out)['scans']
    with BagReader(tmp_path / 'bag') as bag:
        counts = {topic.name: topic.n_messages for topic in bag.topics()}
        assert counts == {'/odom': count, '/pose': count, '/scan': count, '/trajectory': 1}
        said = [bag.decode(r).pose.pose.position for r in bag.records(['/pose'])]
        path = bag.decode(next(bag.records(['/trajectory'])))
    with (tmp_path / 'bag_poses.csv').open() as stream:
        true = {int(row['stamp_ns']): float(row['x_m']) for row in csv.DictReader(stream)}
    errors = np.abs(np.array([p.x for p in said]) - list(true.values()))
    assert errors[-1] < 1e-9 < 0.05 < errors.max()
    stamps = [p.header.stamp.sec * 10**9 + p.header.stamp.nanosec for p in path.poses]
    assert [p.pose.position.x for p in path.poses] == [true[stamp] for stamp in stamps]
    told = read_trajectory(tmp_path / 'bag_trajectory.tum')
    assert told.stamps_ns.tolist() == stamps
    # What `--trajectory` takes, for a map at the true poses.
    every = read_trajectory(tmp_path / 'bag_poses.csv')
    assert every.stamps_ns.tolist() == list(true)
    assert [pose.x_m for pose in every.poses] == list(true.values())


@pytest.mark.parametrize(
    ('arguments', 'reason'),
    [
        (['office', '--rate', '40'], '--rate: expected with --drive'),
        (['office', '--poses', 'true'], '--poses: expected with --drive'),
        (['office', '--drive', '--rate', '0'], '--rate is 0: expected 0.1 to 1000 Hz'),
        (['office', '--drive', '--sensor', 'sonar'], '--drive: expected with --sensor lidar'),
        (['building-9', '--drive', '--localize'], '--localize: expected without --drive'),
    ],
    ids=lambda value: ' '.join(value) if isinstance(value, list) else '',
)
def test_mistakes_about_a_drive(tmp_path, capsys, arguments, reason):
    code, _, err = command(capsys, 'simulate', *arguments, '-o', tmp_path / 'bag')
    assert code == 2
    assert reason in err
    assert not (tmp_path / 'bag').exists()

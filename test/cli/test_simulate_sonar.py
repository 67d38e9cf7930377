"""`simulate --sensor sonar`: readings, where the sonars sit, and the map that comes of them."""

import csv
import json
import math

import numpy as np
import pytest
from PIL import Image
from support.commands import command
from support.refusals import error_line

from ogm_mcmc.engine.bag_scans import PlacedScans, StreamChoice, choose_topics
from ogm_mcmc.geometry import Pose2D
from ogm_mcmc.io.bags import BagReader
from ogm_mcmc.io.map_files import load_grid
from ogm_mcmc.io.world_files import load_world
from ogm_mcmc.simulation import SonarRing


def placed_readings(path):
    with BagReader(path) as bag:
        choice = StreamChoice(sensor='range')
        return list(PlacedScans(bag, choose_topics(bag, choice), choice))


@pytest.fixture
def hall(tmp_path):
    """A picture of 8 m x 6 m with a pillar; 0.1 m a pixel."""
    pixels = np.zeros((60, 80), np.uint8)
    pixels[5:-5, 5:-5] = 255
    pixels[30:34, 40:44] = 0
    path = tmp_path / 'hall.png'
    Image.fromarray(pixels).save(path)
    return path


def distances_to(marked, places):
    """Distance (N,) in cells from each of (N, 2) places to the nearest marked cell."""
    there = np.argwhere(marked)
    squared = ((places[:, None, :] - there[None, :, :]) ** 2).sum(axis=2)
    return np.sqrt(squared.min(axis=1))


def assert_walls_are_where_they_are(map_file, truth_file):
    """Of drawn walls nine in ten are within 0.2 m of a true one, of true ones hardly any misses.

    What is drawn further off are the ends of arcs: an echo may come from anywhere in its cone.
    """
    grid, truth = load_grid(map_file), load_grid(truth_file)
    cell_m = grid.spec.resolution_m
    assert truth.spec.resolution_m == cell_m
    column, row = truth.spec.cell_of(
        grid.spec.origin_x_m + 0.5 * cell_m, grid.spec.origin_y_m + 0.5 * cell_m
    )
    # In cells of the truth, which may be the smaller of the two.
    measured = np.isfinite(grid.probability)
    known = np.argwhere(measured) + np.array([row, column])
    called = grid.probability[measured]
    walls = truth.probability == 1.0
    off_m = distances_to(walls, known[called > 0.5]) * cell_m
    assert (off_m <= 0.201).mean() > 0.9
    assert (off_m <= 0.401).mean() > 0.98
    inside = ((known >= 0) & (known < walls.shape)).all(axis=1)
    known, called = known[inside], called[inside]
    true = truth.probability[tuple(known.T)]
    drawn = np.zeros(walls.shape, bool)
    drawn[tuple(known[called > 0.5].T)] = True
    assert (true == 1.0).sum() > 300
    missing_m = distances_to(drawn, known[true == 1.0]) * cell_m
    assert (missing_m <= 0.151).mean() > 0.98
    clear = (true == 0.0) & (distances_to(walls, known) * cell_m > 0.3)
    assert clear.sum() > 1500
    assert (called[clear] < 0.5).mean() > 0.97


@pytest.mark.jit
def test_a_walk_through_the_office_is_mapped(tmp_path, capsys):
    bag, maps = tmp_path / 'bag', tmp_path / 'maps'
    arguments = ('--sensor', 'sonar', '--sonars', 12, '--resolution', 0.1)
    code, out, err = command(capsys, 'simulate', 'office', '-o', bag, *arguments, '--json')
    assert code == 0, err
    made = json.loads(out)
    assert made['scans'] == 12 * 1158
    code, out, err = command(
        capsys, 'map', bag, '-o', maps, '--params-file', made['sonars'], '--resolution', 0.1,
        '--json',
    )  # fmt: skip
    assert code == 0, err
    mapped = json.loads(out)
    assert mapped['settings']['method'] == 'sonar'
    assert mapped['scans_used'] == made['scans']
    assert_walls_are_where_they_are(maps / 'map.npz', tmp_path / 'bag_truth.yaml')


@pytest.mark.jit
def test_a_world_of_cells_is_explored_and_mapped(tmp_path, capsys, hall):
    bag, maps = tmp_path / 'bag', tmp_path / 'maps'
    code, out, err = command(
        capsys, 'simulate', hall, '-o', bag, '--sensor', 'sonar', '--resolution', 0.1,
        '--min-scans', 80, '--field-of-view', 20, '--json',
    )  # fmt: skip
    assert code == 0, err
    made = json.loads(out)
    assert made['scans'] >= 16 * 80
    code, _, err = command(
        capsys, 'map', bag, '-o', maps, '--method', 'sonar', '--resolution', 0.1,
        '--mount.frames', SonarRing().mounts_setting(),
    )  # fmt: skip
    assert code == 0, err
    assert_walls_are_where_they_are(maps / 'map.npz', tmp_path / 'bag_truth.yaml')


@pytest.mark.jit
def test_sonars_without_a_mount_are_told(tmp_path, capsys, hall):
    bag = tmp_path / 'bag'
    few = ('--sensor', 'sonar', '--sonars', 3, '--max-scans', 2)
    assert command(capsys, 'simulate', hall, '-o', bag, *few)[0] == 0
    unmounted = ('map', bag, '-o', tmp_path / 'maps', '--method', 'sonar')
    code, out, _ = command(capsys, *unmounted)
    assert code == 0
    assert 'all at (mount.x, mount.y): sonar_0, sonar_1, sonar_2\n' in out
    named = (*unmounted, '--params-file', tmp_path / 'bag_sonars.yaml', '--json')
    assert json.loads(command(capsys, *named)[1])['frames_without_mount'] == []
    some = (*unmounted, '--mount.frames', 'sonar_1 0 0 2', '--json')
    assert json.loads(command(capsys, *some)[1])['frames_without_mount'] == ['sonar_0', 'sonar_2']


@pytest.mark.jit
def test_readings_are_those_of_the_true_poses(tmp_path, capsys):
    """Without noise every reading is what the ring says of the CSV's pose, in order of frames."""
    code, _, err = command(
        capsys, 'simulate', 'building-9', '-o', tmp_path / 'bag', '--sensor', 'sonar',
        '--max-scans', 5, '--sonars', 6, '--ring-radius', 0.15, '--field-of-view', 30,
        '--range-max', 5, '--range-min', 0.3, '--noise', 0, '--dropout', 0, '--depth', 0,
    )  # fmt: skip
    assert code == 0, err
    with (tmp_path / 'bag_poses.csv').open() as stream:
        rows = list(csv.DictReader(stream))
    assert len(rows) == 5
    placed = placed_readings(tmp_path / 'bag')
    ring, world = SonarRing(6, 0.15, math.radians(30), 0.3, 5.0), load_world('building-9')
    for k, row in enumerate(rows):
        pose = Pose2D(float(row['x_m']), float(row['y_m']), float(row['yaw_rad']))
        exact = ring.exact_ranges(world, pose, 0.0)
        of_stop = placed[6 * k : 6 * k + 6]
        assert [p.scan.frame_id for p in of_stop] == [f'sonar_{s}' for s in range(6)]
        assert {p.scan.stamp_ns for p in of_stop} == {int(row['stamp_ns'])}
        for (scan, belief), nearest in zip(of_stop, exact, strict=True):
            assert belief.mean.x_m == pytest.approx(pose.x_m, abs=1e-12)
            assert scan.beam_width_rad == pytest.approx(math.radians(30), rel=1e-6)
            assert scan.range_max_m == 5.0
            expected = math.inf if nearest > 5.0 else -math.inf if nearest < 0.3 else nearest
            assert float(scan.ranges_m[0]) == pytest.approx(expected, rel=1e-6)


@pytest.mark.jit
def test_the_same_seed_makes_the_same_files(tmp_path, capsys, hall):
    for name, seed in (('a', 4), ('b', 4), ('c', 5)):
        code, _, err = command(
            capsys, 'simulate', hall, '-o', tmp_path / name / 'bag', '--sensor', 'sonar',
            '--max-scans', 4, '--clutter', 0.1, '--dropout', 0.1, '--seed', seed,
        )  # fmt: skip
        assert code == 0, err
    held = {
        name: {
            path.relative_to(tmp_path / name): path.read_bytes()
            for path in (tmp_path / name).rglob('*')
            if path.is_file()
        }
        for name in 'abc'
    }
    assert len(held['a']) == 7  # two of the bag, three of the true map, poses, sonars
    assert held['a'] == held['b']
    readings = {
        name: np.array([p.scan.ranges_m[0] for p in placed_readings(tmp_path / name / 'bag')])
        for name in 'ac'
    }
    assert np.isnan(readings['a']).any()
    assert not np.array_equal(readings['a'], readings['c'], equal_nan=True)


@pytest.mark.jit
def test_info_shows_the_ring(tmp_path, capsys, hall):
    few = ('--sensor', 'sonar', '--max-scans', 2)
    assert command(capsys, 'simulate', hall, '-o', tmp_path / 'bag', *few)[0] == 0
    code, out, _ = command(capsys, 'info', tmp_path / 'bag', '--json')
    assert code == 0
    topics = {topic['name']: topic for topic in json.loads(out)['topics']}
    ranges = topics['/range']
    assert (ranges['n_messages'], ranges['frame'], ranges['sensors']) == (32, 'sonar_0', 16)
    assert (ranges['field_of_view_rad'], ranges['range_m']) == (0.4, [0.05, 4.0])
    assert topics['/pose']['n_messages'] == 2
    assert 'sensors 16' in command(capsys, 'info', tmp_path / 'bag')[1]


@pytest.mark.jit
def test_sonars_of_a_bag_that_was_replaced_are_gone(tmp_path, capsys, hall):
    again = ('simulate', hall, '-o', tmp_path / 'bag', '--max-scans', 1, '--overwrite')
    assert command(capsys, *again, '--sensor', 'sonar')[0] == 0
    assert (tmp_path / 'bag_sonars.yaml').exists()
    assert command(capsys, *again)[0] == 0
    assert not (tmp_path / 'bag_sonars.yaml').exists()
    (tmp_path / 'other_sonars.yaml').write_text('mine')
    other = ('simulate', hall, '-o', tmp_path / 'other', '--max-scans', 1, '--sensor', 'sonar')
    code, _, err = command(capsys, *other)
    assert code == 2
    assert 'other_sonars.yaml: exists already' in err


@pytest.mark.parametrize(
    ('arguments', 'reason'),
    [
        (['--sensor', 'radar'], "invalid choice: 'radar'"),
        (['--sensor', 'sonar', '--sonars', '0'], '--sonars is 0: expected 1 to 1000'),
        (['--sensor', 'sonar', '--sonars', '2.5'], "invalid int value: '2.5'"),
        (['--sensor', 'sonar', '--ring-radius', '-1'], '--ring-radius is -1: expected 0 to 10 m'),
        (
            ['--sensor', 'sonar', '--field-of-view', '180'],
            '--field-of-view is 180: expected 0.001 to below 180 degrees',
        ),
        (['--sensor', 'sonar', '--field-of-view', '0'], '--field-of-view is 0: expected'),
        (
            ['--sensor', 'sonar', '--range-max', '0.01'],
            '--range-max is 0.01: expected more than --range-min',
        ),
        (['--sensor', 'sonar', '--range-max', 'inf'], '--range-max is inf: expected'),
        (['--sensor', 'sonar', '--noise', '-1'], '--noise is -1: expected'),
        (['--sensor', 'sonar', '--dropout', '1'], '--dropout is 1: expected 0 to below 1'),
        (['--sensor', 'sonar', '--clutter', 'nan'], '--clutter is nan: expected'),
        (['--sensor', 'sonar', '--beams', '9'], '--beams: expected with --sensor lidar'),
        (['--sensor', 'sonar', '--localize'], '--localize: expected with --sensor lidar'),
        (['--sonars', '0'], '--sonars: expected with --sensor sonar, not lidar'),
        (['--sonars', '8'], '--sonars: expected with --sensor sonar, not lidar'),
        (['--ring-radius', '0.3'], '--ring-radius: expected with --sensor sonar'),
    ],
    ids=lambda value: ' '.join(value) if isinstance(value, list) else '',
)
@pytest.mark.parametrize('world', ['office', 'hall.png'])
def test_a_mistake_is_one_line_and_leaves_nothing(
    tmp_path, monkeypatch, capsys, hall, world, arguments, reason
):
    monkeypatch.chdir(tmp_path)
    code, _, err = command(capsys, 'simulate', world, *arguments, '-o', 'bag')
    assert code == 2, err
    assert reason in error_line(err)
    assert list(tmp_path.iterdir()) == [hall]

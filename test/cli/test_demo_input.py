"""What the demo makes of any bag that `map` takes; no node is started."""

import argparse

import pytest
from support.transforms import transform

from ogm_mcmc.cli import demo
from ogm_mcmc.cli.demo import _common, _refiner_arguments, _replay_arguments
from ogm_mcmc.cli.demo_input import prepare
from ogm_mcmc.config import PosesConfig
from ogm_mcmc.errors import LogError
from ogm_mcmc.geometry import Pose2D
from ogm_mcmc.io import ros_types

SECOND = 1_000_000_000
STAMPS = [20 * SECOND + k * SECOND // 10 for k in range(6)]


@pytest.fixture
def looked_into(write_bag, tmp_path):
    """Write records, prepare them with options of the demo: (input, options)."""

    def run(records, *arguments, kind='mcap'):
        parser = argparse.ArgumentParser()
        demo.add_to(parser.add_subparsers())
        options = parser.parse_args(['demo', str(write_bag(records, kind)), *arguments])
        return prepare(options.input, tmp_path, options), options

    return run


@pytest.fixture
def scans(make_scan):
    return [('/front/scan', stamp, make_scan(stamp)) for stamp in STAMPS]


def odometry():
    return [('/odom', t, ros_types.odometry(t, Pose2D(), 0.0, 0.0)) for t in STAMPS]


def test_a_ros_1_bag_with_odometry(looked_into, scans, tmp_path):
    source, options = looked_into([*scans, *odometry()], kind='ros1')
    assert (source.pose_source, source.pose_topic, source.computed) == ('odom', '/odom', '')
    assert (source.map_frame, source.base_frame) == ('odom', 'base_link')
    assert (source.n_scans, source.beams) == (6, 5)
    said = ' '.join(_replay_arguments(options, source, '/x'))
    assert '--topics /front/scan,/odom --remap /front/scan=scan,/odom=odom' in said
    assert '--pose-source none' in said


def test_a_turned_laser_and_tf_only(looked_into, scans, tmp_path):
    moving = [('/tf', t, transform(t, 'map', 'base_link', 1.0, 0.0, 0.0)) for t in STAMPS]
    held = ('/tf_static', 1, transform(1, 'base_link', 'laser', 0.2, 0.0, 1.5))
    source, options = looked_into([*scans, *moving, held], '--max-pose-gap', '3')
    assert (source.pose_source, source.computed, source.mounts) == (
        'pose',
        'tf',
        'laser 0.2 0 1.5',
    )
    said = ' '.join(_replay_arguments(options, source, '/x'))
    assert '--topics /front/scan --remap /front/scan=scan --scan-topic /front/scan' in said
    assert '--pose-source tf --map-frame map --base-frame base_link' in said
    common = _common(options, source, tmp_path)
    assert common['mount.frames'] == 'laser 0.2 0 1.5'
    assert common['max_pose_gap'] == 3.0


def test_lasers_of_which_one_moves(looked_into, scans, make_scan, tmp_path):
    """Odometry could be sent as it is; where a laser moves to is sent with computed poses."""
    records = [*scans, *odometry(), *(('/rear', t, make_scan(t, frame='rear')) for t in STAMPS)]
    records.append(('/tf_static', 1, transform(1, 'base_link', 'rear', -0.2, 0.0, 3.0)))
    for k, t in enumerate(STAMPS):
        records.append(('/tf', t, transform(t, 'base_link', 'laser', 0.2, 0.0, 0.1 * k)))
    source, options = looked_into(records)
    assert (source.computed, source.moving, source.mounts) == ('odom', True, 'rear -0.2 0 3')
    common = _common(options, source, tmp_path)
    assert (common['mount_source'], common['mount.frames']) == ('topic', 'rear -0.2 0 3')
    said = ' '.join(_replay_arguments(options, source, '/x'))
    assert '--pose-source odom' in said
    assert '--wait-topics 4' in said  # two lasers, poses and mounts


def test_a_laser_whose_place_is_sent_again_and_again_does_not_move(looked_into, scans):
    """ROS 1 robots say on /tf where everything sits: odometry goes as it is."""
    again = [('/tf', t, transform(t, 'base_link', 'laser', 0.2, 0.0, 1.5)) for t in STAMPS]
    source, _ = looked_into([*scans, *odometry(), *again])
    assert (source.computed, source.moving, source.mounts) == ('', False, 'laser 0.2 0 1.5')


def prepared(tmp_path, path, *arguments):
    parser = argparse.ArgumentParser()
    demo.add_to(parser.add_subparsers())
    options = parser.parse_args(['demo', str(path), *arguments])
    return prepare(options.input, tmp_path, options)


def test_a_bag_is_one_whatever_it_is_called(write_bag, scans, tmp_path):
    bag = write_bag([*scans, *odometry()], 'ros1')
    for name in ('recording', 'run.bag.active', 'run.orig'):
        path = bag.rename(tmp_path / name)
        assert prepared(tmp_path, path).bag == path
        bag = path
    with pytest.raises(LogError, match='no such file; expected a CARMEN log or a bag'):
        prepared(tmp_path, tmp_path / 'none')


def test_a_log_without_angles_and_poses(write_log, tmp_path):
    readings = ' '.join(['2.0'] * 541)
    lines = [f'ODOM {0.1 * k} 0 0 0 0 0 {k} host {k}' for k in range(3)]
    lines += [f'RAWLASER1 0 0 0 0 50 0 0 541 {readings} 0 {k}.5 host 0' for k in range(2)]
    source = prepared(tmp_path, write_log(*lines), '--field-of-view', '270')
    assert (source.pose_source, source.n_scans, source.beams) == ('pose', 2, 541)
    with pytest.raises(LogError, match='or --field-of-view'):
        prepared(tmp_path, write_log(*lines))


def test_poses_of_a_file(looked_into, scans, tmp_path):
    path = tmp_path / 'poses.tum'
    path.write_text('20.0 1 2 0 0 0 0 1\n21.0 1 3 0 0 0 0 1\n')
    source, options = looked_into([*scans, *odometry()], '--trajectory', str(path))
    assert (source.pose_source, source.computed) == ('pose', 'trajectory')
    said = _replay_arguments(options, source, '/x')
    assert f'--trajectory {path}' in ' '.join(said)
    assert '--trajectory-deviations' not in said
    for method, sent in (('pose_uncertain', True), ('adaptive', True), ('counting', False)):
        options.method = method
        arguments = _replay_arguments(options, source, '/x')
        assert ('--trajectory-deviations' in arguments) == sent
    # Where the refined map's poses are estimated deviations would count twice: they are not.
    assert 'poses:=' not in ' '.join(_refiner_arguments(options, source, tmp_path))
    assert PosesConfig().poses == 'fixed'

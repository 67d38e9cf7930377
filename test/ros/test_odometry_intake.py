"""Odometry beside the poses in use, heard by `refine_server` for joint poses."""

import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed: no ROS tests')

from rclpy.parameter import Parameter
from support.local_ros import local_node, odometry, pose, scan, transforms

from ogm_mcmc.geometry import PlacedScan, Pose2D, PoseBelief
from ogm_mcmc.io.messages import read_scan
from ogm_mcmc.io.tf_messages import read_transform
from ogm_mcmc.ros.odometry_intake import OdometryIntake
from ogm_mcmc.ros.refine_server import RefineServer

pytestmark = [pytest.mark.ros]


def parameters(**values):
    return [Parameter(name.replace('__', '.'), value=value) for name, value in values.items()]


@pytest.mark.parametrize(
    ('chosen', 'heard'),
    [
        ({'poses': 'joint'}, True),
        ({'poses': 'joint', 'trajectory__odometry': False}, False),
        ({'poses': 'fixed'}, False),
        ({'poses': 'joint', 'pose_source': 'odom'}, False),
        ({'poses': 'joint', 'map_frame': 'odom'}, False),
    ],
)
def test_odometry_is_kept_at_scans_where_joint_poses_want_it(monkeypatch, chosen, heard):
    monkeypatch.setattr(RefineServer, 'warm_up', lambda self: None)
    with local_node(RefineServer, parameter_overrides=parameters(**chosen)) as node:
        assert node.odometry.used == heard
        for k in range(4):
            if chosen.get('pose_source') == 'odom':
                node.intake.on_pose(odometry(float(k), 0.1 * k))
            else:
                frame = chosen.get('map_frame', 'map')
                node.intake.on_pose(pose(float(k), 0.1 * k, frame=frame))
            node.odometry.on_odometry(odometry(k + 0.1, 0.2 * k))
            node.intake.on_scan(scan(float(k), (1.0, 1.5, 2.0)))
        node.odometry.adapt()
        assert len(node.recording) == 4
        # The first scan is older than all odometry.
        expected = {'scans with odometry': 3} if heard else {}
        assert node.odometry.values() == expected
        if heard:
            assert node.odometry.at(2_000_000_000).x_m == pytest.approx(0.38)
            node.odometry.clear()
            assert node.odometry.at(2_000_000_000) is None


@pytest.fixture
def server(monkeypatch):
    monkeypatch.setattr(RefineServer, 'warm_up', lambda self: None)
    with local_node(RefineServer, parameter_overrides=parameters(poses='joint')) as node:
        yield node


def test_only_odometry_of_the_base_is_taken(server):
    """As from a bag: in a frame called odom; of another child only while tf knows nothing."""
    taken, problems = server.odometry.track.source.stamps, server.intake.problems
    elsewhere = odometry(1.0)
    elsewhere.header.frame_id = 'map'
    server.odometry.on_odometry(elsewhere)
    assert problems.all() == {'odometry_wrong_frame': 1}
    server.odometry.on_odometry(odometry(1.0, child='turret'))
    assert len(taken) == 1
    for entry in transforms(('base_link', 'laser', 0.0)).transforms:
        server.intake.transforms.tree.add(read_transform(entry))
    for msg in (odometry(2.0, child='turret'), odometry(3.0), odometry(4.0, child='')):
        server.odometry.on_odometry(msg)
    assert len(taken) == 3
    assert problems.all() == {'odometry_wrong_frame': 1, 'odometry_wrong_child': 1}


def test_odometry_whose_clock_stands_still_is_said(server, monkeypatch):
    """The messages of one moment are taken, so that they tell of more than one sender."""
    now = [0.0]
    monkeypatch.setattr('ogm_mcmc.ros.odometry_intake.time.monotonic', lambda: now[0])
    taken, problems = server.odometry.track.source.stamps, server.intake.problems
    for now[0] in (0.0, 0.9):
        server.odometry.on_odometry(odometry(7.0))
    assert problems.all() == {}
    assert len(taken) == 1
    for now[0] in (1.1, 1.2):
        server.odometry.on_odometry(odometry(7.0))
    assert problems.all() == {'odometry_unstamped': 2}
    server.odometry.on_odometry(odometry(8.0))
    assert problems.all() == {'odometry_unstamped': 2}
    assert len(taken) == 2


def limits_of(source):
    return source.max_gap_ns, source.max_speed_m_s, source.max_turn_rad_s


def test_limits_of_poses_hold_for_odometry_too(server):
    node, expected = server, (9_000_000_000, 50.0, 70.0)
    values = {'max_pose_gap': 9.0, 'max_speed': 50.0, 'max_turn_rate': 70.0}
    assert all(one.successful for one in node.set_parameters(parameters(**values)))
    assert (
        limits_of(node.odometry.track.source) == expected == limits_of(node.intake.placer.source)
    )
    fresh = OdometryIntake(node, node.intake, node.poses)
    assert limits_of(fresh.track.source) == expected
    fresh.from_tf = True
    tree = node.intake.transforms.tree
    for k in range(3):
        for entry in transforms(('odom', 'base_link', float(k), 40.0 * k)).transforms:
            tree.add(read_transform(entry))
    fresh.want(PlacedScan(read_scan(scan(0.5, (1.0, 2.0))), PoseBelief(Pose2D())))
    assert limits_of(fresh.track.source) == expected
    assert fresh.at(500_000_000).x_m == pytest.approx(20.0)  # 40 m/s

"""Odometry beside the poses in use, heard by `refine_server` for joint poses."""

import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed: no ROS tests')

from rclpy.parameter import Parameter
from support.local_ros import local_node, odometry, pose, scan

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
                node.intake.on_pose(pose(float(k), 0.1 * k))
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

"""Refined poses on their topics: message by message, and out of a server in this process."""

import math

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed: no ROS tests')

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import Path
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger
from support.rooms import noisy_drive
from support.ros import Observer

from ogm_mcmc.engine.joint_poses import RefinedTrajectory
from ogm_mcmc.geometry import Pose2D, PoseBelief
from ogm_mcmc.io.messages import read_pose, stamp_of
from ogm_mcmc.ros.qos import LATCHED
from ogm_mcmc.ros.refine_server import RefineServer
from ogm_mcmc.ros.trajectory_publisher import correction_values, path_message, pose_message

pytestmark = [pytest.mark.ros]

SPREAD = np.array([[0.04, 0.01, 0.002], [0.01, 0.09, 0.0], [0.002, 0.0, 0.01]])


def two_poses(covariance):
    beliefs = [PoseBelief(Pose2D()), PoseBelief(Pose2D(1.0, -2.0, 0.5), covariance)]
    return RefinedTrajectory([10**9, 2_500_000_000], beliefs, Pose2D(0.1, 0.0, math.radians(2.0)))


def test_messages_hold_poses_stamps_and_covariance():
    path = path_message(two_poses(SPREAD), 'map')
    assert [stamp_of(pose) for pose in path.poses] == [10**9, 2_500_000_000]
    assert stamp_of(path) == 2_500_000_000
    assert {path.header.frame_id, *(pose.header.frame_id for pose in path.poses)} == {'map'}
    read = read_pose(pose_message(two_poses(SPREAD), 'map'))
    assert (read.mean.x_m, read.mean.y_m) == (1.0, -2.0)
    assert read.mean.yaw_rad == pytest.approx(0.5)
    np.testing.assert_allclose(read.covariance, SPREAD)
    assert not any(pose_message(two_poses(None), 'map').pose.covariance)


def test_what_diagnostics_say():
    values = correction_values(two_poses(SPREAD))
    assert values['correction of the latest pose, x (m)'] == '0.1000'
    assert values['correction of the latest pose, yaw (degrees)'] == '2.0000'
    assert values['standard deviation of the latest pose (m)'] == f'{math.sqrt(0.13):.4f}'
    assert 'standard deviation of its yaw (degrees)' not in correction_values(two_poses(None))
    assert correction_values(None) == {}
    told = two_poses(None)._replace(points=(0.01, 0.0123, 0.015))
    said = correction_values(told)['points off their lines (95 % interval)']
    assert said == '0.0123 m (0.0100 to 0.0150)'


def test_a_server_refines_poses_publishes_and_saves_them(tmp_path):
    truth, placed = noisy_drive()
    chosen = {
        'poses': 'joint', 'trajectory.draws': 8, 'window.resolution': 0.1, 'patch.size': 1,
        'patch.prior': 'uniform', 'max_sweeps': 80, 'r_hat': 0.0, 'save_directory': str(tmp_path),
    }  # fmt: skip
    overrides = [Parameter(name, value=value) for name, value in chosen.items()]
    with Observer() as observer:
        server = RefineServer(context=observer.context, parameter_overrides=overrides)
        try:
            observer.executor.add_node(server)
            paths = observer.collect(Path, 'trajectory_refined', LATCHED)
            latest = observer.collect(PoseWithCovarianceStamped, 'pose_refined', LATCHED)
            reports = observer.collect(DiagnosticArray, '/diagnostics', 10)
            for one in placed:
                server.recording.add(one)

            def refines() -> bool:
                """Whether it is ready, and so begins."""
                return server.on_refine(Trigger.Request(), Trigger.Response()).success

            observer.until(refines, 60.0)
            observer.until(lambda: bool(paths) and bool(latest), 60.0)  # once it knows how sure
            found = np.array([(p.pose.position.x, p.pose.position.y) for p in paths[-1].poses])
            off = found - truth[:, :2]
            assert np.hypot(*(off - off.mean(axis=0)).T).mean() < 0.01
            assert np.sqrt(read_pose(latest[-1]).covariance[0, 0]) < 0.06
            observer.until(lambda: 'poses refined' in str(reports[-1:]), 20.0)
            for name in ('points off their lines', 'sigma of ranges', 'clutter beams'):
                assert f'{name} (' in str(reports[-1])
            assert "value='joint'" in str(reports[-1])  # poses of the map
            assert server.on_save_map(Trigger.Request(), Trigger.Response()).success
            for name in ('trajectory.txt', 'trajectory_deviations.csv'):
                lines = (tmp_path / f'map_refined_{name}').read_text().splitlines()
                assert len(lines) == 17
            server.on_clear(Trigger.Request(), Trigger.Response())
            observer.until(lambda: not paths[-1].poses)
            late_paths = observer.collect(Path, 'trajectory_refined', LATCHED)
            late = observer.collect(PoseWithCovarianceStamped, 'pose_refined', LATCHED)
            observer.until(lambda: bool(late_paths))
            assert not late_paths[-1].poses
            assert not late, 'a pose of before ~/clear'
            later = two_poses(SPREAD)
            server.trajectory.publish(later, 'map')
            observer.until(lambda: bool(late))  # on the topic that began anew
            assert latest[-1] == late[-1] == pose_message(later, 'map')
            server.trigger_deactivate()
            server.trajectory.publish(two_poses(None), 'map')  # both are there until cleanup
            server.trajectory.clear('map')
        finally:
            server.destroy_node()

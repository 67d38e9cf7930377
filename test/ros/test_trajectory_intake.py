"""`trajectory`: both nodes place their scans anew; what cannot be used is said."""

import importlib.util
import math
import time

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed: no ROS tests')

from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger
from support.local_ros import Logs, local_node, odometry, pose, scan
from support.strategies import fan

from ogm_mcmc.errors import ConfigError
from ogm_mcmc.geometry import PlacedScan, PoseBelief, PoseSamples
from ogm_mcmc.ros.online_mapper import OnlineMapper
from ogm_mcmc.ros.refine_server import RefineServer

pytestmark = [pytest.mark.ros]

SCANS = 12


def path(poses, frame='map'):
    """Return a Path of (stamp in s, x, y, yaw)."""
    message = Path()
    message.header.frame_id = frame
    for time_s, x, y, yaw in poses:
        posed = PoseStamped()
        posed.header.stamp.sec = int(time_s)
        posed.header.stamp.nanosec = round(time_s % 1.0 * 1e9)
        posed.pose.position.x, posed.pose.position.y = x, y
        posed.pose.orientation.z, posed.pose.orientation.w = math.sin(yaw / 2), math.cos(yaw / 2)
        message.poses.append(posed)
    return message


def parameters(**values):
    return [Parameter(name.replace('__', '.'), value=value) for name, value in values.items()]


def walk(node):
    """Send scans of a robot that drifts aside while it goes ahead, one a second."""
    for k in range(1, SCANS + 1):
        node.intake.on_pose(pose(float(k), 0.1 * k, 0.05 * k))
        node.intake.on_scan(scan(float(k), (1.0, 1.5, 2.0)))


CORRECTED = path([(float(k), 0.1 * k, 0.0, 0.0) for k in range(1, SCANS - 1)])


def test_the_live_map_is_made_anew_without_codes_known_by_then(monkeypatch):
    chosen = parameters(keep_scans=True, resolution=0.1, no_return='ignore')
    with local_node(OnlineMapper, parameter_overrides=chosen) as node:
        walk(node)
        node.intake.codes.chosen_m = 2.0
        made_of = []
        monkeypatch.setattr(
            node.kept, 'correct', lambda *_: made_of.extend(node.kept.recording.snapshot())
        )
        node.trajectory.on_path(CORRECTED)
        assert len(made_of) == SCANS
        assert all(one.scan.ranges_m.tolist() == [1.0, 1.5, math.inf] for one in made_of)


def test_the_live_map_is_made_anew_and_swapped_in():
    chosen = parameters(keep_scans=True, resolution=0.1, no_return='ignore')
    with local_node(OnlineMapper, parameter_overrides=chosen) as node:
        walk(node)
        before = node.pipeline.map()
        node.trajectory.on_path(CORRECTED)
        deadline = time.monotonic() + 30.0
        while node.kept.busy and time.monotonic() < deadline:
            node.on_housekeeping()
            time.sleep(0.01)
        last = node.trajectory.last
        assert (last.covered, last.moved) == (SCANS - 2, SCANS - 2)
        assert last.furthest_m == pytest.approx(0.05 * (SCANS - 2), abs=1e-6)
        after = node.pipeline.map()
        assert node.pipeline.scans_used == SCANS
        assert (after.spec, before.spec) != (before.spec, after.spec) or (
            after.probability.tobytes() != before.probability.tobytes()
        )
        lanes = [round(placed.pose.y_m, 2) for placed in node.kept.recording.snapshot()]
        assert lanes == [0.0] * (SCANS - 2) + [0.55, 0.6]
        watched = [round(placed.pose.y_m, 2) for placed in node.no_return._watch._kept]
        assert watched == lanes  # beams without a return are judged by the same poses
        node.publish_diagnostics()
        values = node._kept_values()
        assert values['scans placed anew by it'] == SCANS - 2
        assert values['scans kept for corrections'] == SCANS


@pytest.mark.parametrize(('method', 'kept'), [('two_assumption', False), ('pose_uncertain', True)])
def test_clouds_are_kept_only_for_methods_that_look_at_them(method, kept):
    cloud = PoseSamples.checked(np.array([[0.0, 0.0, 0.0], [0.02, 0.0, 0.0]]))
    belief = PoseBelief(cloud.mean(), cloud.covariance(), cloud)
    chosen = parameters(keep_scans=True, resolution=0.1, method=method)
    with local_node(OnlineMapper, parameter_overrides=chosen) as node:
        node.map_scan(PlacedScan(fan(1.0), belief))
        (placed,) = node.kept.recording.snapshot()
        assert (placed.belief.particles is not None) == kept
        assert placed.belief.covariance is not None


def test_a_mapper_that_keeps_no_scans_says_so():
    with local_node(OnlineMapper, parameter_overrides=parameters(resolution=0.1)) as node:
        assert node.trajectory is None
        assert node._kept_values() == {'scans kept for corrections': 'none: keep_scans is off'}
        node.on_housekeeping()


def test_the_window_of_refine_server_follows_and_bad_messages_are_said():
    chosen = parameters(
        window__resolution=0.1, patch__size=1, patch__prior='uniform', window__no_return='ignore'
    )
    with local_node(RefineServer, parameter_overrides=chosen) as node:
        logs = Logs(node)
        walk(node)
        node.corrected.on_path(CORRECTED)
        assert node.corrected.last.moved == SCANS - 2
        lanes = [round(placed.pose.y_m, 2) for placed in node.recording.snapshot()]
        assert lanes == [0.0] * (SCANS - 2) + [0.55, 0.6]
        # A newer one counts from what was said at the time, not from what was corrected.
        node.corrected.on_path(path([(float(k), 0.1 * k, 0.3, 0.0) for k in range(1, SCANS + 1)]))
        assert [round(p.pose.y_m, 2) for p in node.recording.snapshot()] == [0.3] * SCANS
        for message, reason in (
            (path([(1.0, 0.0, 0.0, 0.0)], frame='odom'), 'trajectory_wrong_frame'),
            (path([]), 'trajectory_invalid'),
            (path([(1.0, 0.0, 0.0, 0.0), (1.0, 1.0, 0.0, 0.0)]), 'trajectory_invalid'),
            (path([(1.0, math.nan, 0.0, 0.0)]), 'trajectory_invalid'),
            (path([(1.0, 9e5, 9e5, 0.0), (2.0, 0.0, 0.0, 0.0)]), 'trajectory_off_map'),
        ):
            before = node.intake.problems.all()[reason]
            node.corrected.on_path(message)
            assert node.intake.problems.all()[reason] == before + 1
        assert [round(p.pose.y_m, 2) for p in node.recording.snapshot()] == [0.3] * SCANS
        assert any('expected poses that carry their own stamps' in line or 'odom' in line
                   for line in logs.of('warning'))  # fmt: skip
        assert node.corrected.values()['trajectories received'] == 7


def test_sampling_goes_on_with_corrected_scans(monkeypatch):
    """When it does, and for how long: see `test_sampling_orders`."""
    chosen = parameters(window__resolution=0.1, patch__size=1, patch__prior='uniform')
    with local_node(RefineServer, parameter_overrides=chosen) as node:
        walk(node)
        ordered = []
        monkeypatch.setattr(type(node.worker), 'wanted', property(lambda worker: bool(ordered)))
        monkeypatch.setattr(
            node.worker, 'refine', lambda scans, *_, **__: ordered.append(scans[0].pose.y_m)
        )
        node.on_refine(None, Trigger.Response())
        node.corrected.on_path(path([(float(k), 0.1 * k, 0.5, 0.0) for k in range(1, SCANS)]))
        node.on_housekeeping()
        assert ordered == pytest.approx([0.05, 0.5])


def test_maps_and_answers_are_in_the_frame_that_odometry_names():
    chosen = parameters(
        pose_source='odom', window__resolution=0.1, patch__size=1, patch__prior='uniform'
    )
    with local_node(RefineServer, parameter_overrides=chosen) as node:
        assert node.maps.frame_id() == 'map'
        assert not node.of_odometry()
        node.intake.on_pose(odometry(1.0))
        assert node.of_odometry()
        assert node.maps.frame_id() == 'odom'
        assert node.collisions.frame_id() == 'odom'


@pytest.mark.parametrize('node_type', [OnlineMapper, RefineServer])
def test_slam_toolbox_and_cartographer_need_their_messages(node_type, monkeypatch):
    """Said in one line where they are not installed, before any kernel is compiled."""
    monkeypatch.setattr(node_type, 'warm_up', lambda node: pytest.fail('compiled before'))
    for source, needed in (
        ('slam_toolbox', 'slam_toolbox of November 2025'),
        ('cartographer', 'cartographer_ros_msgs'),
    ):
        chosen = parameters(trajectory_source=source, window__resolution=0.1, patch__size=1,
                            patch__prior='uniform')  # fmt: skip
        if importlib.util.find_spec(needed.split()[0]) is None:
            with (
                pytest.raises(ConfigError, match=f'{needed}.* installed'),
                local_node(node_type, parameter_overrides=chosen),
            ):
                pass


def test_a_trajectory_source_without_kept_scans_is_warned_about(monkeypatch):
    monkeypatch.setattr('ogm_mcmc.ros.online_mapper.check_installed', lambda source: None)
    said = []
    monkeypatch.setattr(
        'rclpy.impl.rcutils_logger.RcutilsLogger.warning', lambda log, text, **_: said.append(text)
    )
    chosen = parameters(trajectory_source='cartographer')
    with local_node(OnlineMapper, parameter_overrides=chosen):
        (line,) = (text for text in said if 'keep_scans' in text)
        assert line.startswith("trajectory_source is 'cartographer': expected keep_scans")

"""`collision_query` in, `collision_risk` out: the numbers, and every query that has no answer."""

import time

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed: no ROS tests')

from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path
from rclpy.parameter import Parameter
from std_msgs.msg import Float32MultiArray
from support.local_ros import Logs, local_node

from ogm_mcmc.engine.collision import chance_of_unknown
from ogm_mcmc.engine.refined_map import RefinedMap
from ogm_mcmc.geometry import GridMap, GridSpec, SampleBits
from ogm_mcmc.ros.qos import QUESTIONS
from ogm_mcmc.ros.refine_server import RefineServer

pytestmark = [pytest.mark.ros]


def way(*places, frame_id='map'):
    """A path as planners send it: no stamps of its own, no turns."""
    msg = Path()
    msg.header.frame_id = frame_id
    for x, y in places:
        pose = PoseStamped()
        pose.pose.position.x, pose.pose.position.y = float(x), float(y)
        msg.poses.append(pose)
    return msg


def result(spec, maps):
    known = np.ones((spec.height, spec.width), bool)
    mean = GridMap(spec, maps.mean(axis=0, dtype=np.float32))
    samples = SampleBits.of_maps(spec, maps, known)
    unknown = chance_of_unknown(samples, 0.2)
    return RefinedMap(
        1, mean, mean, 0.2, len(maps), 1, 0, final=True, samples=samples, unknown=unknown
    )


@pytest.fixture(scope='module')
def server():
    values = {'patch.prior': 'uniform', 'patch.size': 1, 'robot_radius': 0.06}
    overrides = [Parameter(name, value=value) for name, value in values.items()]
    with local_node(RefineServer, parameter_overrides=overrides) as node:
        node.heard = []
        node.create_subscription(Float32MultiArray, 'collision_risk', node.heard.append, QUESTIONS)
        node.ask = node.create_publisher(Path, 'collision_query', QUESTIONS)
        node.until(lambda: node.ask.get_subscription_count() == 1)
        node.until(lambda: node.count_subscribers('collision_risk') == 1)
        yield node


def answer(node, msg):
    count = len(node.heard)
    node.ask.publish(msg)
    node.until(lambda: len(node.heard) > count)
    assert node.heard[-1].layout.dim[0].size == len(node.heard[-1].data)
    return list(node.heard[-1].data)


def test_each_query_has_its_answer(server, monkeypatch):
    maps = np.zeros((4, 3, 7), np.uint8)
    maps[1, :, 3] = 1
    newest = result(GridSpec(0.1, 7, 3), maps)
    monkeypatch.setattr(server.collisions, 'newest', lambda: newest)
    before = server.collisions.answered
    places = [(0.15, 0.15), (0.45, 0.15), (0.85, 0.15)]
    assert answer(server, way(*places)) == pytest.approx([0.0, 0.25, 0.3, 0.4])
    # The radius may change while the node runs.
    server.set_parameters([Parameter('robot_radius', value=0.01)])
    assert answer(server, way(*places[:2])) == pytest.approx([0.0, 0.0, 0.25])
    server.set_parameters([Parameter('robot_radius', value=0.06)])
    assert server.collisions.answered == before + 2


@pytest.mark.parametrize(
    ('msg', 'reason'),
    [
        (way((0.1, 0.1), frame_id='odom'), 'collision_query_wrong_frame'),
        (way(), 'collision_query_invalid'),
        (way((0.1, float('nan'))), 'collision_query_invalid'),
        (way((1e9, 0.1)), 'collision_query_invalid'),
    ],
)
def test_bad_queries_are_counted_and_answered_with_nothing(server, monkeypatch, msg, reason):
    newest = result(GridSpec(0.1, 7, 3), np.zeros((4, 3, 7), np.uint8))
    monkeypatch.setattr(server.collisions, 'newest', lambda: newest)
    before = server.intake.problems.all()[reason]
    assert answer(server, msg) == []
    assert server.intake.problems.all()[reason] == before + 1


def test_too_early(server):
    logs = Logs(server)
    assert answer(server, way((0.1, 0.1))) == []
    assert server.intake.problems.all()['collision_query_too_early'] == 1
    assert ['no sweep of a refined map counts' in text for text in logs.of('warning')] == [True]


@pytest.mark.jit
def test_callback_is_in_time(server, monkeypatch):
    """Reading and answering 100 poses with 64 samples: 5 ms is the promise."""
    rng = np.random.default_rng(1)
    spec = GridSpec(0.05, 400, 400)
    newest = result(spec, (rng.random((64, 400, 400)) < 0.01).astype(np.uint8))
    monkeypatch.setattr(server.collisions, 'newest', lambda: newest)
    msg = way(*(10.0 + np.cumsum(rng.normal(0.0, 0.05, (100, 2)), axis=0)))
    seconds = []
    for _ in range(10):
        began = time.thread_time()
        server.collisions.on_query(msg)
        seconds.append(time.thread_time() - began)
    print(f'callback: {1e3 * min(seconds):.2f} ms')
    assert min(seconds) < 5e-3

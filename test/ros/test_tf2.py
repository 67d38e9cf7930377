"""Our tree of transforms against the real tf2 library, where it is installed.

Elsewhere a naive twin covers the same cases, see `test_transform_tree`.
"""

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed: no ROS tests')
pytest.importorskip(
    'tf2_py', reason='tf2_py is not installed (no wheel has it): test_transform_tree has a twin'
)

import tf2_py as tf2
from geometry_msgs.msg import TransformStamped
from rclpy.duration import Duration
from rclpy.time import Time

from ogm_mcmc.engine.transform_tree import TransformError, TransformTree
from ogm_mcmc.io.tf_messages import read_transform

pytestmark = [pytest.mark.ros]

FRAMES = 'abcdefg'  # g hangs on nothing
PARENTS = {'b': 'a', 'c': 'b', 'd': 'b', 'e': 'a', 'f': 'e'}
STATIC = 'df'
NS = 10**9

FAULTS = {
    'unknown': tf2.LookupException,
    'unconnected': tf2.ConnectivityException,
    'early': tf2.ExtrapolationException,
    'late': tf2.ExtrapolationException,
}


def entry(rng, parent, child, stamp_ns):
    """Return a message with any place and turn."""
    message = TransformStamped(child_frame_id=child)
    message.header.frame_id = parent
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_ns, NS)
    move, turn = message.transform.translation, message.transform.rotation
    move.x, move.y, move.z = rng.normal(size=3)
    x, y, z, w = rng.normal(size=4)
    turn.x, turn.y, turn.z, turn.w = np.array([x, y, z, w]) / np.linalg.norm([x, y, z, w])
    return message


def filled(rng):
    """Return tf2 and our tree with the same entries, in any order."""
    buffer, tree = tf2.BufferCore(Duration(seconds=1000)), TransformTree()
    for child in rng.permutation(list(PARENTS)):
        static = child in STATIC
        for stamp in rng.choice(np.arange(2, 14), 1 if static else rng.integers(1, 7), False):
            message = entry(rng, PARENTS[child], child, int(stamp) * NS // 2)
            add = buffer.set_transform_static if static else buffer.set_transform
            add(message, 'test')
            tree.add(read_transform(message), static=static)
    lonely = entry(rng, 'h', 'g', NS)
    buffer.set_transform(lonely, 'test')
    tree.add(read_transform(lonely))
    return buffer, tree


def asked(buffer, target, source, stamp_ns):
    """Return what tf2 says as numbers (7,), or the kind of its refusal."""
    try:
        found = buffer.lookup_transform_core(target, source, Time(nanoseconds=stamp_ns))
    except tuple(set(FAULTS.values())) as error:
        return type(error)
    move, turn = found.transform.translation, found.transform.rotation
    return np.array([move.x, move.y, move.z, turn.x, turn.y, turn.z, turn.w])


def ours(tree, target, source, stamp_ns):
    """Return what our tree says, likewise."""
    try:
        found = tree.lookup(target, source, stamp_ns)
    except TransformError as error:
        return FAULTS[error.reason]
    return np.array([*found.translation, *found.quaternion])


@pytest.mark.parametrize('seed', range(5))
def test_the_tree_answers_as_tf2_does(seed):
    rng = np.random.default_rng(seed)
    buffer, tree = filled(rng)
    answered = refused = 0
    for target, source in ((t, s) for t in FRAMES for s in (*FRAMES, 'nowhere') if s != t):
        for stamp_ns in (NS, 2 * NS, 3_250_000_000, 5 * NS // 2, 4 * NS):
            expected = asked(buffer, target, source, stamp_ns)
            found = ours(tree, target, source, stamp_ns)
            if isinstance(found, type):
                assert found is expected, (target, source, stamp_ns)
                refused += 1
                continue
            if found[3:] @ expected[3:] < 0.0:
                found[3:] *= -1.0  # the same turn
            assert found == pytest.approx(expected, abs=1e-9), (target, source, stamp_ns)
            answered += 1
    assert answered > 20
    assert refused > 20

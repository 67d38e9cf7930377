import math

import numpy as np
import pytest

from ogm_mcmc.engine.transform_tree import TransformTree
from ogm_mcmc.geometry import Pose2D, SensorMount
from ogm_mcmc.io.bags import BagReader, BagWriter, typestore
from ogm_mcmc.io.tf_messages import (
    TF_TYPES,
    fill_transform,
    is_static,
    read_transform,
    read_transforms,
)

S = 1_000_000_000
LEVEL = (0.0, 0.0, 0.0, 1.0)


def make(name, *fields):
    return typestore().types[name](*fields)


def stamped(parent, child, stamp_ns=0, move=(0.0, 0.0, 0.0), turn=LEVEL):
    stamp = make('builtin_interfaces/msg/Time', *divmod(stamp_ns, S))
    return make(
        'geometry_msgs/msg/TransformStamped',
        make('std_msgs/msg/Header', stamp, parent),
        child,
        make(
            'geometry_msgs/msg/Transform',
            make('geometry_msgs/msg/Vector3', *move),
            make('geometry_msgs/msg/Quaternion', *turn),
        ),
    )


def message(*transforms):
    return make(TF_TYPES[0], list(transforms))


@pytest.mark.parametrize(
    ('topic', 'expected'),
    [('/tf', False), ('/tf_static', True), ('/robot/tf_static', True), ('tf_static', True)],
)
def test_which_topics_are_static(topic, expected):
    assert is_static(topic) is expected


def test_a_message_is_read_in_full():
    read = read_transforms(
        message(
            stamped('/map', '/odom', 1_700_000_000 * S + 7, (1.0, 2.0, 3.0)),
            stamped('odom', 'base_link', turn=(0.0, 0.0, 0.6, 0.8)),
        )
    )
    first, second = read.entries
    assert (first.parent, first.child) == ('map', 'odom')
    assert first.stamp_ns == 1_700_000_000 * S + 7
    assert first.transform == ((1.0, 2.0, 3.0), LEVEL)
    assert second.transform.quaternion == (0.0, 0.0, 0.6, 0.8)
    assert read.faults == []


@pytest.mark.parametrize('upside_down', [False, True])
def test_what_is_filled_in_is_read_back(upside_down):
    one = stamped('', '', turn=(0.0, 0.0, 0.0, 0.0))
    mount = SensorMount(Pose2D(0.25, -0.5, 2.5), upside_down)
    fill_transform(one, 'base_link', 'laser', mount, 3 * S + 7)
    read = read_transform(one)
    assert (read.parent, read.child, read.stamp_ns) == ('base_link', 'laser', 3 * S + 7)
    pose, flipped = read.transform.planar()
    assert (pose.x_m, pose.y_m, pose.yaw_rad) == pytest.approx((0.25, -0.5, 2.5))
    assert flipped is upside_down


def test_a_transform_at_fault_does_not_take_the_others_with_it():
    read = read_transforms(
        message(
            stamped('map', 'odom', turn=(0.0, 0.0, 0.0, 0.0)),
            stamped('odom', 'base', move=(0.0, math.nan, 0.0)),
            stamped('', 'base'),
            stamped('base', '/base'),
            stamped('base', 'laser'),
        )
    )
    assert [one.child for one in read.entries] == ['laser']
    assert read.faults == [
        'map -> odom: quaternion (0.0, 0.0, 0.0, 0.0): expected unit length, got 0',
        'odom -> base: transform (0.0, nan, 0.0) (0.0, 0.0, 0.0, 1.0): expected finite numbers',
        '(no name) -> base: expected two frames',
        'base -> base: expected two frames',
    ]


def test_from_a_bag_into_a_tree(tmp_path):
    path = tmp_path / 'bag'
    with BagWriter(path) as bag:
        for k in range(3):
            sent = message(stamped('odom', 'base', k * S, (float(k), 0.0, 0.0)))
            bag.write('/tf', TF_TYPES[0], k * S, sent)
        mount = message(stamped('base', 'laser', 0, (0.25, 0.0, 0.0)))
        bag.write('/tf_static', TF_TYPES[0], 0, mount)
    tree = TransformTree()
    with BagReader(path) as bag:
        for record in bag.records():
            for entry in read_transforms(bag.decode(record)).entries:
                tree.add(entry, static=is_static(record.topic), arrival_ns=record.time_ns)
    xs = [tree.lookup('odom', 'laser', stamp).translation[0] for stamp in (0, S // 2, 2 * S)]
    np.testing.assert_allclose(xs, [0.25, 0.75, 2.25])

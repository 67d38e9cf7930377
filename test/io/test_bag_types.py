"""Old definitions of the types we use."""

import contextlib
import sqlite3

import pytest
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from ogm_mcmc.errors import BagError
from ogm_mcmc.io import ros_types
from ogm_mcmc.io.bag_storage import Definition
from ogm_mcmc.io.bag_types import MessageType, typestore
from ogm_mcmc.io.bags import BagReader
from ogm_mcmc.io.messages import read_range

OLD_SCAN = 'std_msgs/Header header\nfloat32 angle_min\n'


def old_range(store, *, ros1=False):
    types = store.types
    stamp = types['builtin_interfaces/msg/Time'](5, 7)
    header = types['std_msgs/msg/Header'](*((3,) if ros1 else ()), stamp, 'sonar')
    return types[ros_types.RANGE](header, 0, 0.5, 0.25, 4.0, 1.5)


@pytest.fixture(params=['humble mcap', 'humble sqlite3', 'ros1', 'without definitions'])
def old_bag(request, tmp_path):
    """Write a bag with one Range of before Iron, which had no variance."""
    ros1 = request.param == 'ros1'
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    message = old_range(store, ros1=ros1)
    path = tmp_path / ('old.bag' if ros1 else 'old')
    plugin = StoragePlugin.MCAP if 'mcap' in request.param else StoragePlugin.SQLITE3
    with Ros1Writer(path) if ros1 else Ros2Writer(path, version=8, storage_plugin=plugin) as bag:
        connection = bag.add_connection('/range', ros_types.RANGE, typestore=store)
        serialize = store.serialize_ros1 if ros1 else store.serialize_cdr
        bag.write(connection, 10, serialize(message, ros_types.RANGE))
    if request.param == 'without definitions':
        with contextlib.closing(sqlite3.connect(path / 'old.db3')) as database:
            database.execute('DELETE FROM message_definitions')
            database.commit()
    return path


def test_range_of_before_iron(old_bag):
    with BagReader(old_bag) as bag:
        assert (bag.problem('/range'), bag.unsendable('/range')) == ('', '')
        (record,) = bag.records()
        assert read_range(bag.decode(record)).ranges_m.tolist() == [1.5]
        sent = typestore().deserialize_cdr(bag.cdr(record), ros_types.RANGE)
    assert (sent.header.stamp.sec, sent.header.frame_id) == (5, 'sonar')
    assert (sent.field_of_view, sent.min_range, sent.max_range) == (0.5, 0.25, 4.0)
    assert (sent.range, sent.variance) == (1.5, 0.0)


@pytest.mark.parametrize(
    ('definition', 'reason'),
    [
        (OLD_SCAN, 'has no ranges here'),
        ('std_msgs/Header header\nstring range\n', 'range of .* is of another type'),
        ('std_msgs/Header header\nfloat32 range\nfloat32 loudness\n', 'has loudness here'),
    ],
)
def test_definitions_that_cannot_be_sent(definition, reason):
    name = ros_types.SCAN if definition == OLD_SCAN else ros_types.RANGE
    header = f'{"=" * 80}\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n'
    time = f'{"=" * 80}\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n'
    kind = MessageType(name, Definition('ros2msg', definition + header + time), 'cdr')
    assert kind.problem == ''
    with pytest.raises(ValueError, match=reason):
        kind.to_cdr(bytes(40))


def test_a_type_jazzy_does_not_know_passes_through(tmp_path):
    store, name = get_typestore(Stores.ROS2_JAZZY), 'own_msgs/msg/Thing'
    store.register(get_types_from_msg('float32 x', name))
    with Ros2Writer(tmp_path / 'bag', version=9, storage_plugin=StoragePlugin.MCAP) as bag:
        connection = bag.add_connection('/thing', name, typestore=store)
        raw = bytes(store.serialize_cdr(store.types[name](1.5), name))
        bag.write(connection, 1, raw)
        bag.write(connection, 2, b'\x07')
    with BagReader(tmp_path / 'bag') as reader:
        good, wrong = reader.records()
        assert reader.cdr(good) == raw
        with pytest.raises(BagError, match='no CDR'):
            reader.cdr(wrong)


def test_particle_clouds_need_no_definition():
    kind = MessageType(ros_types.PARTICLE_CLOUD, Definition(), 'cdr')
    assert kind.problem == ''

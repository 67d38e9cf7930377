"""The node `replay`: every kind of bag, rates, topics, clock, pause, loop."""

import json
import sys
import time

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed: no ROS tests')

from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import LaserScan, Range
from std_msgs.msg import String
from std_srvs.srv import SetBool
from support.local_ros import refusal, replayed
from support.refusals import error_line
from support.ros import NodeProcess, Observer

from ogm_mcmc.io import ros_types
from ogm_mcmc.io.bags import BagReader, Offer, typestore
from ogm_mcmc.ros import replay as replay_module
from ogm_mcmc.ros.pacing import Pacer
from ogm_mcmc.ros.qos import SENSOR, recorded_profile
from ogm_mcmc.ros.replay import Replay, main

pytestmark = [pytest.mark.ros]

COUNT, STEP_S = 20, 0.05


def scans():
    for index in range(COUNT):
        stamp = 1_000_000_000 + round(index * STEP_S * 1e9)
        ranges = np.linspace(0.5, 1.0 + index, 7, dtype=np.float32)
        yield (
            stamp,
            ros_types.laser_scan(
                stamp, 'laser', ranges, angle_min=-1.0, angle_increment=0.1, range_max=30.0
            ),
        )


def rosbag2(path, plugin):
    store = typestore()
    with Ros2Writer(path, version=9, storage_plugin=plugin) as writer:
        connection = writer.add_connection('/scan', ros_types.SCAN, typestore=store)
        for stamp, msg in scans():
            writer.write(connection, stamp, store.serialize_cdr(msg, ros_types.SCAN))
        text = writer.add_connection('/text', 'std_msgs/msg/String', typestore=store)
        hello = store.types['std_msgs/msg/String']('hello')
        writer.write(text, stamp, store.serialize_cdr(hello, 'std_msgs/msg/String'))


def rosbag1(path):
    store = get_typestore(Stores.ROS1_NOETIC)
    with Ros1Writer(path) as writer:
        connection = writer.add_connection('/scan', ros_types.SCAN, typestore=store)
        header = store.types['std_msgs/msg/Header']
        kind = store.types[ros_types.SCAN]
        for index, (stamp, msg) in enumerate(scans()):
            fields = {name: getattr(msg, name) for name in msg.__dataclass_fields__}
            fields.pop('__msgtype__', None)
            fields['header'] = header(index, msg.header.stamp, msg.header.frame_id)
            writer.write(connection, stamp, store.serialize_ros1(kind(**fields), ros_types.SCAN))


@pytest.fixture
def bag(tmp_path):
    rosbag2(tmp_path / 'bag', StoragePlugin.MCAP)
    return tmp_path / 'bag'


def play(path, *arguments):
    return NodeProcess('replay', [str(path), '--json', '--wait', '20', *map(str, arguments)])


def finished(observer, player):
    observer.until(lambda: not player.running(), 60.0)
    assert player.wait() == 0, player.output
    return json.loads(player.output.strip().splitlines()[-1])


@pytest.mark.parametrize('kind', ['mcap', 'sqlite3', 'ros1'])
def test_every_kind_of_bag_arrives_byte_for_byte(tmp_path, kind):
    path = tmp_path / ('bag.bag' if kind == 'ros1' else 'bag')
    if kind == 'ros1':
        rosbag1(path)
    else:
        rosbag2(path, StoragePlugin[kind.upper()])
    with Observer() as observer:
        received = observer.collect(LaserScan, 'scan', 100, raw=True)
        done = replayed(path, observer, wait_topics=1, topics='scan')
        observer.until(lambda: len(received) == COUNT, 10.0)
    assert done.published == {'/scan': COUNT}
    store = typestore()
    expected = [bytes(store.serialize_cdr(msg, ros_types.SCAN)) for _, msg in scans()]
    assert received == expected


def test_rate_start_remap_and_clock(bag):
    last = 1.0 + (COUNT - 1) * STEP_S
    with Observer() as observer:
        received = observer.collect(LaserScan, 'front/scan', 100)
        clocks = observer.collect(Clock, '/clock', 1000)
        arguments = ('--rate', 0.5, '--start', 0.5, '--remap', 'scan=front/scan', '--clock')
        with play(bag, *arguments, '--topics', 'scan') as player:
            done = finished(observer, player)

        def stamps():
            return [clock.clock.sec + 1e-9 * clock.clock.nanosec for clock in clocks]

        observer.until(lambda: len(received) == COUNT // 2 and stamps()[-1] > last - 1e-6, 10.0)
    assert done['seconds'] >= 0.45 / 0.5  # a busy machine may well be late
    assert stamps() == sorted(stamps())
    assert stamps()[-1] == pytest.approx(last)
    assert len(stamps()) > COUNT // 2


class Clockwork:
    """Stands for the module `time`: it goes on only while somebody sleeps."""

    def __init__(self):
        self.now = 100.0

    def monotonic(self):
        return self.now

    def sleep(self, seconds):
        self.now += seconds


@pytest.mark.parametrize(('rate', 'start'), [(2.0, 0.5), (1.0, 0.0), (0.5, 0.2)])
def test_messages_are_sent_when_they_are_due(bag, monkeypatch, rate, start):
    clockwork, due = Clockwork(), []
    really = Replay._publish

    def publish(node, *message):
        due.append(clockwork.now - 100.0)
        really(node, *message)

    monkeypatch.setattr(Replay, '_publish', publish)
    monkeypatch.setattr(replay_module, 'time', clockwork)
    with Observer() as observer:
        received = observer.collect(LaserScan, 'scan', 100)
        done = replayed(bag, observer, wait_topics=1, topics='scan', rate=rate, start=start)
        observer.until(lambda: len(received) == len(due), 10.0)
    sent = [STEP_S * index - start for index in range(COUNT)]
    assert due == pytest.approx([when / rate for when in sent if when > -1e-9], abs=1e-6)
    assert done.seconds == pytest.approx(due[-1])


def test_who_listens_has_answered_before_the_first_message(bag, monkeypatch):
    """Before, it may not know of the publishers, and a best-effort reader loses what comes."""
    events = []

    def note(kind, name):
        really = getattr(kind, name)

        def noted(self, *arguments):
            result = really(self, *arguments)
            events.append((name, result))
            return result

        monkeypatch.setattr(kind, name, noted)

    note(Pacer, '_answered')
    note(Replay, '_publish')
    with Observer() as observer:
        heard = observer.collect(LaserScan, 'scan', SENSOR)
        replayed(bag, observer, wait_topics=1, topics='scan')
        observer.until(lambda: len(heard) == COUNT, 10.0)
    assert events[0] == ('_answered', True)


def nothing_comes(received, seconds):
    """Return a condition: for so many seconds no message came."""
    seen = [len(received), time.monotonic()]

    def silent():
        if len(received) != seen[0]:
            seen[:] = len(received), time.monotonic()
        return time.monotonic() - seen[1] > seconds

    return silent


def test_pause_and_loop(bag):
    with Observer() as observer:
        received = observer.collect(LaserScan, 'scan', 1000)
        with play(bag, '--loop', '--start-paused', '--rate', 5) as player:
            observer.call(SetBool, 'replay/pause', SetBool.Request(data=True))
            assert received == []
            observer.call(SetBool, 'replay/pause', SetBool.Request(data=False))
            observer.until(lambda: len(received) > 2 * COUNT, 30.0)
            observer.call(SetBool, 'replay/pause', SetBool.Request(data=True))
            observer.until(nothing_comes(received, 0.5), 10.0)
            observer.call(SetBool, 'replay/pause', SetBool.Request(data=False))
            paused = len(received)
            observer.until(lambda: len(received) > paused, 30.0)
            assert player.stop() == 0, player.output
            observer.lets_go_of('replay')
    assert 'Traceback' not in player.output


def test_types_that_are_not_installed_are_left_out(tmp_path):
    store = get_typestore(Stores.ROS2_JAZZY)
    store.register(get_types_from_msg('float32 x', 'nowhere_msgs/msg/Thing'))
    with Ros2Writer(tmp_path / 'bag', version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        thing = writer.add_connection('/thing', 'nowhere_msgs/msg/Thing', typestore=store)
        text = writer.add_connection('/text', 'std_msgs/msg/String', typestore=store)
        made = store.types['nowhere_msgs/msg/Thing'](1.0)
        writer.write(thing, 10, store.serialize_cdr(made, 'nowhere_msgs/msg/Thing'))
        hello = store.types['std_msgs/msg/String']('hello')
        writer.write(text, 20, store.serialize_cdr(hello, 'std_msgs/msg/String'))
    with Observer() as observer:
        texts = observer.collect(String, 'text', 10)
        done = replayed(tmp_path / 'bag', observer, wait_topics=1)
        observer.until(lambda: bool(texts), 10.0)
    assert texts[0].data == 'hello'
    assert 'nowhere_msgs/msg/Thing' in done.skipped_topics['/thing']


def test_nobody_listens(bag):
    with NodeProcess('replay', [str(bag), '--json', '--wait', '0.3']) as player:
        assert player.wait() == 1, player.output
    assert 'nobody listened to /scan, /text within 0.3 s' in player.output.replace('//', '/')
    assert json.loads(player.output.strip().splitlines()[-1])['published'] == {}


def test_a_stray_stamp_is_not_waited_for_and_one_wrong_message_is_left_out(tmp_path):
    store = typestore()
    text = store.types['std_msgs/msg/String']
    with Ros2Writer(tmp_path / 'bag', version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection('/text', 'std_msgs/msg/String', typestore=store)
        # 1970, 53 years later, and after what a time message holds.
        for stamp_s in (0, 1_700_000_000, 1_700_000_000, 2**33):
            raw = store.serialize_cdr(text(str(stamp_s)), 'std_msgs/msg/String')
            writer.write(connection, stamp_s * 10**9, raw)
        writer.write(connection, (2**33 + 1) * 10**9, b'\x07')
    with Observer() as observer:
        texts = observer.collect(String, 'text', 10)
        with play(tmp_path / 'bag', '--rate', 1, '--clock') as player:
            done = finished(observer, player)
        observer.until(lambda: len(texts) == 4, 10.0)
    assert [message.data for message in texts] == ['0', *['1700000000'] * 2, str(2**33)]
    assert done['skipped_seconds'] == 2**33
    assert done['skipped_messages'] == 1
    assert done['seconds'] < 5.0
    assert player.output.count('not waiting for that') == 2


@pytest.mark.parametrize(
    ('latched', 'best_effort', 'depth'),
    [(True, False, 3), (False, False, 100), (False, True, 100)],
)
def test_topics_are_offered_as_they_were(tmp_path, latched, best_effort, depth):
    store = typestore()
    durability = QosDurability.TRANSIENT_LOCAL if latched else QosDurability.VOLATILE
    never = QosTime(0, 0)
    offer = Qos(
        QosHistory.KEEP_LAST,
        3,
        QosReliability.BEST_EFFORT if best_effort else QosReliability.RELIABLE,
        durability,
        never,
        never,
        QosLiveliness.AUTOMATIC,
        never,
        False,
    )
    with Ros2Writer(tmp_path / 'bag', version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection(
            '/text', 'std_msgs/msg/String', typestore=store, offered_qos_profiles=[offer]
        )
        hello = store.types['std_msgs/msg/String']('hello')
        writer.write(connection, 1, store.serialize_cdr(hello, 'std_msgs/msg/String'))
    with BagReader(tmp_path / 'bag') as reader:
        profile = recorded_profile('/text', reader.offer('/text'))
    assert (profile.durability == DurabilityPolicy.TRANSIENT_LOCAL) == latched
    assert (profile.reliability == ReliabilityPolicy.BEST_EFFORT) == best_effort
    assert profile.depth == depth


def test_the_known_latched_topics_of_old_recordings():
    for name in ('/tf_static', '/robot/map'):
        profile = recorded_profile(name, Offer())
        assert profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
        assert profile.depth == 100
    assert recorded_profile('/tf_static', Offer(latched=True, depth=1)).depth == 100
    assert recorded_profile('/map', Offer(latched=True, depth=1)).depth == 1


def test_nothing_left_to_send(tmp_path):
    store, name = get_typestore(Stores.ROS2_JAZZY), 'nowhere_msgs/msg/Thing'
    store.register(get_types_from_msg('float32 x', name))
    with Ros2Writer(tmp_path / 'bag', version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection('/thing', name, typestore=store)
        writer.write(connection, 1, store.serialize_cdr(store.types[name](1.0), name))
    with NodeProcess('replay', [str(tmp_path / 'bag')]) as player:
        assert player.wait() == 2, player.output
    assert '/thing is left out: its type nowhere_msgs/msg/Thing is not installed' in player.output
    assert 'no topic in it can be published' in player.output


@pytest.mark.parametrize(
    ('arguments', 'reason'),
    [
        (['nowhere'], 'no such file or folder'),
        (['{bag}', '--topics', 'nothing'], 'no topic nothing in it: expected one of scan, text'),
        (['{bag}', '--remap', 'nonsense'], 'expected OLD=NEW'),
        (['{bag}', '--remap', 'nothing=scan'], 'no such topic'),
        (['{bag}', '--remap', 'scan=1bad'], 'cannot be published as 1bad'),
        (['{bag}', '--remap', 'scan=text'], 'cannot be published as text'),
        (['{bag}', '--rate', '-1'], 'rate'),
        (['{bag}', '--start', '50', '--loop'], 'start is 50 s'),
        (['{bag}', '--ros-args', '--params-file', 'nowhere.yaml'], 'nowhere.yaml'),
    ],
)
def test_mistakes_are_one_line(bag, capfd, arguments, reason):
    path, *rest = (argument.format(bag=bag) for argument in arguments)
    assert reason in refusal(main, capfd, path, '--wait', '0', *rest)


def test_a_mistake_ends_the_process_with_one_line():
    with NodeProcess('replay', ['nowhere', '--wait', '0']) as player:
        assert player.wait() == 2, player.output
    assert 'no such file or folder' in error_line(player.output)


def test_the_command_line_is_the_same_node(bag):
    with Observer() as observer:
        received = observer.collect(LaserScan, 'scan', 100)
        command = (sys.executable, '-m', 'ogm_mcmc', 'replay')
        arguments = [str(bag), '--rate', '0', '--json', '--topics', 'scan', '--wait', '20']
        with NodeProcess('', arguments, command=command) as player:
            done = finished(observer, player)
        observer.until(lambda: len(received) == COUNT, 10.0)
    assert done['published'] == {'/scan': COUNT}
    with BagReader(bag) as reader:
        assert reader.message_count == COUNT + 1


@pytest.mark.parametrize('release', [Stores.ROS2_HUMBLE, Stores.ROS1_NOETIC])
def test_ranges_of_before_iron_reach_a_subscriber_of_today(tmp_path, release):
    """They had no `variance`."""
    store, ros1 = get_typestore(release), release == Stores.ROS1_NOETIC
    path = tmp_path / ('old.bag' if ros1 else 'old')
    kinds = store.types
    with Ros1Writer(path) if ros1 else Ros2Writer(path, version=8) as bag:
        connection = bag.add_connection('/range', ros_types.RANGE, typestore=store)
        for k in range(5):
            stamp = kinds['builtin_interfaces/msg/Time'](5, k)
            header = kinds['std_msgs/msg/Header'](*((k,) if ros1 else ()), stamp, 'sonar')
            message = kinds[ros_types.RANGE](header, 0, 0.5, 0.25, 4.0, 1.0 + k)
            serialize = store.serialize_ros1 if ros1 else store.serialize_cdr
            bag.write(connection, 10 + k, serialize(message, ros_types.RANGE))
    with Observer() as observer:
        heard = observer.collect(Range, '/range', 10)
        replayed(path, observer, wait_topics=1)
        observer.until(lambda: len(heard) == 5)
    assert [(one.range, one.variance) for one in heard] == [(1.0 + k, 0.0) for k in range(5)]

"""Bags that are damaged or hold what we do not know: one line, always a BagError."""

import contextlib
import random
import sqlite3

import pytest
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from support.refusals import refusal_of

from ogm_mcmc.errors import BagError, OgmError
from ogm_mcmc.io import ros_types
from ogm_mcmc.io.bags import BagReader

KINDS = ('mcap', 'sqlite3', 'ros1')
CUSTOM = 'robot_msgs/msg/Battery'


@pytest.fixture
def recording(make_scan):
    return [('/scan', k, make_scan(k)) for k in range(1, 9)]


def read_all(path):
    with BagReader(path) as bag:
        return [(bag.decode(record), bag.cdr(record)) for record in bag.records()]


def message_of(path):
    message = refusal_of(BagError, read_all, path)
    assert str(path) in message
    assert 'expected' in message
    return message


def storage_file(path):
    return path if path.is_file() else next(p for p in path.iterdir() if p.suffix != '.yaml')


def test_no_such_path(tmp_path):
    for name in ('none', 'none.bag', 'none.mcap', 'deep/none'):
        assert 'no such file' in message_of(tmp_path / name)


def test_folder_that_holds_no_recording(tmp_path):
    assert 'no metadata.yaml in it and no storage file' in message_of(tmp_path)


@pytest.mark.parametrize(
    'text',
    ['', 'a: [', 'rosbag2_bagfile_information: {version: 9}', '[1, 2]', '\0', 'x: y\n\nz: 3\n'],
)
def test_metadata_that_is_none(write_bag, recording, text):
    path = write_bag(recording)
    (path / 'metadata.yaml').write_text(text, encoding='utf-8')
    message_of(path)


def test_storage_file_is_gone(write_bag, recording):
    path = write_bag(recording)
    storage_file(path).unlink()
    message_of(path)


# SQLite never looks at what it does not need, which may be all of the last page.
CUTS = {'mcap': 0.999, 'sqlite3': 0.6, 'ros1': 0.999}


@pytest.mark.parametrize(
    ('kind', 'share'),
    [(k, s) for k, most in CUTS.items() for s in (0.0, 0.003, 0.3, 0.6, 0.9, 0.999) if s <= most],
)
def test_cut_off(write_bag, recording, kind, share):
    path = write_bag(recording, kind)
    assert len(read_all(path)) == 8
    file = storage_file(path)
    content = file.read_bytes()
    file.write_bytes(content[: int(share * len(content))])
    message_of(path)
    if path != file:
        message_of(file)


def test_cut_off_after_its_first_bytes(write_bag, recording):
    file = storage_file(write_bag(recording))
    file.write_bytes(file.read_bytes()[:8])  # those that say what it is
    assert 'it ends where a record was to begin' in message_of(file)


@pytest.mark.parametrize('name', ['noise.bag', 'noise.mcap', 'noise.db3', 'noise', 'noise.yaml'])
def test_random_bytes(tmp_path, name):
    path = tmp_path / name
    path.write_bytes(random.Random(8).randbytes(5000))
    message_of(path)


@pytest.mark.parametrize('kind', KINDS)
def test_damage_anywhere_never_surprises(write_bag, recording, kind):
    """Some flipped bytes go unnoticed; whatever is noticed is a BagError of one line."""
    path, rng = write_bag(recording, kind), random.Random(11)
    file = storage_file(path)
    content, messages = file.read_bytes(), []
    for _ in range(25):
        damaged = bytearray(content)
        for _ in range(4):
            damaged[rng.randrange(len(damaged))] ^= rng.randrange(1, 256)
        file.write_bytes(damaged)
        try:
            read_all(path)
        except BagError as error:
            messages.append(str(error))
    assert messages
    assert all(str(path) in message and '\n' not in message for message in messages)
    file.write_bytes(content)
    assert len(read_all(path)) == 8


@pytest.mark.parametrize('kind', KINDS)
def test_mutations_end_in_one_line(write_bag, make_scan, kind):
    """Whatever becomes of a few bytes of the storage or its metadata: a BagError or nothing."""
    path, rng = write_bag([('/scan', k, make_scan(k)) for k in (1, 2)], kind), random.Random(5)
    files = sorted(path.iterdir()) if path.is_dir() else [path]
    messages = []
    for _ in range(100):
        file = rng.choice(files)
        content = file.read_bytes()
        damaged, at = bytearray(content), rng.randrange(len(content))
        what, size = rng.choice(('set', 'cut out', 'double', 'swap in')), rng.choice((1, 4, 8, 40))
        if what == 'set':
            damaged[at : at + size] = rng.choice((b'\x00', b'\xff', b'*', b'7')) * size
        elif what == 'cut out':
            del damaged[at : at + size]
        elif what == 'double':
            damaged[at:at] = damaged[at : at + size]
        else:
            damaged[at : at + size] = rng.randbytes(size)
        file.write_bytes(damaged)
        try:
            with BagReader(path) as bag:
                for topic in bag.topics():
                    bag.problem(topic.name), bag.unsendable(topic.name), bag.offer(topic.name)
                for record in bag.records():
                    bag.decode(record)
                    bag.cdr(record)
        except OgmError as error:
            messages.append(str(error))
        file.write_bytes(content)
    assert 0 < len(messages) < 100
    assert not any('\n' in message for message in messages)


def write_raw(tmp_path, kind, scan, topics):
    """Write a good scan on /scan, then raw bytes on topics: {topic: (type, definition, raw)}."""
    if kind == 'ros1':
        store, path = get_typestore(Stores.ROS1_NOETIC), tmp_path / 'raw.bag'
        writer, serialize = Ros1Writer(path), store.serialize_ros1
        header = store.types['std_msgs/msg/Header'](3, scan.header.stamp, scan.header.frame_id)
        fields = {n: getattr(scan, n) for n in scan.__dataclass_fields__ if n != '__msgtype__'}
        scan = store.types[ros_types.SCAN](**(fields | {'header': header}))
    else:
        store, path = get_typestore(Stores.ROS2_JAZZY), tmp_path / 'raw'
        plugin = StoragePlugin.MCAP if kind == 'mcap' else StoragePlugin.SQLITE3
        writer, serialize = (
            Ros2Writer(path, version=9, storage_plugin=plugin),
            store.serialize_cdr,
        )
    with writer:
        connection = writer.add_connection('/scan', ros_types.SCAN, typestore=store)
        writer.write(connection, 1, serialize(scan, ros_types.SCAN))
        for topic, (msgtype, definition, raw) in topics.items():
            if msgtype not in store.fielddefs:
                store.register(get_types_from_msg(definition, msgtype))
            connection = writer.add_connection(topic, msgtype, typestore=store)
            writer.write(connection, 2, raw)
    return path


@pytest.mark.parametrize('kind', KINDS)
def test_unknown_type_on_another_topic(tmp_path, make_scan, kind):
    content = (CUSTOM, 'float32 volts\nstring label\n', b'\x01\x02\x03')
    path = write_raw(tmp_path, kind, make_scan(1), {'/battery': content})
    with BagReader(path) as bag:
        assert [topic.msgtype for topic in bag.topics()] == [CUSTOM, ros_types.SCAN]
        assert bag.find('scans', [ros_types.SCAN]).name == '/scan'
        (scan,) = map(bag.decode, bag.records(['/scan']))
        assert scan.ranges.tolist() == make_scan(1).ranges.tolist()
        (battery,) = bag.records(['/battery'])
        with pytest.raises(BagError, match=f'expected a readable {CUSTOM} on /battery'):
            bag.decode(battery)
        if kind == 'ros1':
            with pytest.raises(BagError, match='/battery cannot be turned into its ROS 2 form'):
                bag.cdr(battery)


@pytest.mark.parametrize(
    'command',
    [
        "DELETE FROM message_definitions WHERE topic_type = '{type}'",
        "UPDATE message_definitions SET encoding = '', encoded_message_definition = ''"
        " WHERE topic_type = '{type}'",
    ],
    ids=['no row', 'empty row'],
)
def test_definition_that_was_not_recorded(tmp_path, make_scan, command):
    """`ros2 bag record` leaves the definition empty where it does not find one."""
    content = (CUSTOM, 'float32 volts\nstring label\n', b'\0\1\0\0\1\2\3\4\0\0\0\0')
    path = write_raw(tmp_path, 'sqlite3', make_scan(1), {'/battery': content})
    with contextlib.closing(sqlite3.connect(storage_file(path))) as database:
        database.execute(command.format(type=CUSTOM))
        database.commit()
    with BagReader(path) as bag:
        (scan,) = map(bag.decode, bag.records(['/scan']))
        assert scan.ranges.size == 5
        with pytest.raises(BagError, match='/battery'):
            list(map(bag.decode, bag.records(['/battery'])))


@pytest.mark.parametrize('kind', KINDS)
@pytest.mark.parametrize(
    'raw', [b'', b'\0\1\0\0', b'\0\1\0\0\1\0\0\0\2\0\0\0\xff\xff\xff\x7fabc', bytes(30)]
)
def test_corrupted_payload(tmp_path, make_scan, kind, raw):
    path = write_raw(tmp_path, kind, make_scan(1), {'/scan2': (ros_types.SCAN, '', raw)})
    message = message_of(path)
    assert '/scan2' in message
    assert ros_types.SCAN in message

"""mcap files as other writers make them, put together here byte by byte."""

import struct

import pytest

from ogm_mcmc.errors import BagError
from ogm_mcmc.io import ros_types
from ogm_mcmc.io.bags import BagReader, typestore

MAGIC = b'\x89MCAP0\r\n'
SCAN_DEFINITION = typestore().generate_msgdef(ros_types.SCAN)[0].encode()


def text(value):
    raw = value if isinstance(value, bytes) else value.encode()
    return struct.pack('<I', len(raw)) + raw


def record(code, content):
    return struct.pack('<BQ', code, len(content)) + content


def schema(key, name, encoding, definition):
    return record(3, struct.pack('<H', key) + text(name) + text(encoding) + text(definition))


def channel(key, schema_key, topic, encoding, metadata=b''):
    head = struct.pack('<HH', key, schema_key)
    return record(4, head + text(topic) + text(encoding) + text(metadata))


def message(key, time_ns, raw):
    return record(5, struct.pack('<HIQQ', key, 0, time_ns, time_ns) + raw)


def chunk(*records):
    plain = b''.join(records)
    head = struct.pack('<QQQI', 0, 2**62, len(plain), 0)
    return record(6, head + text('') + struct.pack('<Q', len(plain)) + plain)


@pytest.fixture
def write_mcap(tmp_path):
    """Write records into a file without index or counts."""

    def write(*records, profile='ros2'):
        path = tmp_path / 'made.mcap'
        header = record(1, text(profile) + text('a test'))
        footer = record(2, struct.pack('<QQI', 0, 0, 0))
        path.write_bytes(MAGIC + header + b''.join(records) + footer + MAGIC)
        return path

    return write


@pytest.fixture
def scan_records(make_scan):
    def records(stamps):
        def raw(stamp):
            return bytes(typestore().serialize_cdr(make_scan(stamp), ros_types.SCAN))

        return [message(1, stamp, raw(stamp)) for stamp in stamps]

    return records


SCAN_TOPIC = (
    schema(1, ros_types.SCAN, 'ros2msg', SCAN_DEFINITION),
    channel(1, 1, '/scan', 'cdr'),
)

FOREIGN = {
    'service event': (
        schema(2, 'demo/srv/Sum_Event', 'ros2msg', f'{"=" * 80}\nSRV: demo/srv/Sum\nint64 a\n---'),
        channel(2, 2, '/other', 'cdr'),
        'definition of its type demo/srv/Sum_Event cannot be read',
    ),
    'protobuf': (
        schema(2, 'foxglove.Log', 'protobuf', b'\x0a\xff\xfe\x80'),
        channel(2, 2, '/other', 'protobuf'),
        "encoded as 'protobuf', not as cdr",
    ),
    'json': (
        schema(2, 'log', 'jsonschema', '{}'),
        channel(2, 2, '/other', 'json'),
        "encoded as 'json'",
    ),
    'flatbuffer as cdr': (
        schema(2, 'log', 'flatbuffer', b'\xff'),
        channel(2, 2, '/other', 'cdr'),
        "defined in 'flatbuffer'",
    ),
    'no schema': (b'', channel(2, 0, '/other', 'cdr'), 'its type (none) is not defined'),
    'empty definition': (
        schema(2, 'own_msgs/msg/Thing', 'ros2msg', ''),
        channel(2, 2, '/other', 'cdr'),
        '',
    ),
}


@pytest.mark.parametrize('name', FOREIGN)
@pytest.mark.parametrize('profile', ['ros2', ''])
def test_a_foreign_topic_leaves_the_others_readable(write_mcap, scan_records, name, profile):
    its_schema, its_channel, reason = FOREIGN[name]
    other = (its_schema, its_channel, message(2, 2, bytes(40)))
    path = write_mcap(*other, *SCAN_TOPIC, *scan_records([1, 3]), profile=profile)
    with BagReader(path) as bag:
        assert [(t.name, t.n_messages) for t in bag.topics()] == [('/other', 1), ('/scan', 2)]
        assert bag.problem('/scan') == ''
        assert reason in bag.problem('/other')
        assert [bag.decode(r).ranges.size for r in bag.records(['/scan'])] == [5, 5]
        (foreign,) = bag.records(['/other'])
        if reason:
            with pytest.raises(BagError, match='/other'):
                bag.decode(foreign)


@pytest.mark.parametrize('chunked', [False, True])
def test_messages_come_in_order_of_time(write_mcap, scan_records, chunked):
    parts = [scan_records([4, 2, 9]), scan_records([3, 1]), scan_records([7])]
    records = [chunk(*part) for part in parts] if chunked else [r for part in parts for r in part]
    with BagReader(write_mcap(*SCAN_TOPIC, *records)) as bag:
        assert [r.time_ns for r in bag.records()] == [1, 2, 3, 4, 7, 9]
        assert [r.time_ns for r in bag.records(['/scan'], 4)] == [4, 7, 9]
        assert (bag.message_count, bag.start_ns, bag.duration_ns) == (6, 1, 8)


def test_ros1_messages_in_an_mcap(write_mcap):
    path = write_mcap(
        schema(1, 'std_msgs/String', 'ros1msg', 'string data'),
        channel(1, 1, '/text', 'ros1'),
        message(1, 5, text('hello')),
        profile='ros1',
    )
    with BagReader(path) as bag:
        (stored,) = bag.records()
        assert (stored.msgtype, bag.decode(stored).data) == ('std_msgs/msg/String', 'hello')
        hello = typestore().types['std_msgs/msg/String']('hello')
        assert bag.cdr(stored) == bytes(typestore().serialize_cdr(hello, stored.msgtype))


def test_what_was_offered(write_mcap):
    profile = '- {durability: %s, depth: %d}\n'
    offers = {
        '/latched': profile % ('transient_local', 1) + profile % ('1', 2),
        '/volatile': profile % ('volatile', 5),
        '/sensor': '- {durability: volatile, depth: 5, reliability: 2}\n',
        '/mixed': ''.join(
            f'- {{durability: volatile, depth: 1, reliability: {kind}}}\n'
            for kind in ('best_effort', 'reliable')
        ),
        '/rubbish': '[7, {]',
        '/number': '7',
        '/none': '',
    }
    channels = [
        channel(key, 0, name, 'cdr', text('offered_qos_profiles') + text(offer))
        for key, (name, offer) in enumerate(offers.items())
    ]
    with BagReader(write_mcap(*channels)) as bag:
        found = [tuple(bag.offer(name)) for name in offers]
    assert found == [
        (True, 3, False),
        (False, 5, False),
        (False, 5, True),
        (False, 2, False),
        *[(False, 0, False)] * 3,
    ]

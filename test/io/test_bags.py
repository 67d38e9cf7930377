"""Bags of three kinds, written here and read back by `BagReader`."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer

from ogm_mcmc.errors import BagError, OutputError
from ogm_mcmc.files import folders
from ogm_mcmc.files.processes import host_name
from ogm_mcmc.io import ros_types
from ogm_mcmc.io.bags import BagReader, BagTopic, BagWriter, typestore

SECOND = 1_000_000_000
KINDS = {'mcap': 'rosbag2 (mcap)', 'sqlite3': 'rosbag2 (sqlite3)', 'ros1': 'ROS 1 bag'}
TIMES = [5 * SECOND + k * SECOND // 4 for k in range(6)]


@pytest.fixture
def recording(make_scan, make_pose):
    """Six poses and scans, each pose first."""
    records = []
    for k, stamp in enumerate(TIMES):
        records.append(('/pose', stamp, make_pose(stamp, x=0.5 * k, variances=(0.5, 0.25, 0.125))))
        records.append(('/scan', stamp, make_scan(stamp, ranges=(k, 1.5, np.inf, np.nan, 4.0))))
    return records


def equal_scans(first, second):
    names = ('angle_min', 'angle_max', 'angle_increment', 'scan_time', 'range_min', 'range_max')
    return (
        first.ranges.dtype == second.ranges.dtype == np.float32
        and np.array_equal(first.ranges, second.ranges, equal_nan=True)
        and all(np.float32(getattr(first, n)) == np.float32(getattr(second, n)) for n in names)
        and first.header.stamp == second.header.stamp
        and first.header.frame_id == second.header.frame_id
    )


@pytest.mark.parametrize('kind', KINDS)
def test_round_trip(write_bag, recording, kind):
    with BagReader(write_bag(recording, kind)) as bag:
        assert bag.kind == KINDS[kind]
        assert bag.message_count == 12
        assert bag.start_ns == TIMES[0]
        assert bag.duration_ns == pytest.approx(TIMES[-1] - TIMES[0], abs=1)
        assert bag.topics() == [
            BagTopic('/pose', ros_types.POSE, 6),
            BagTopic('/scan', ros_types.SCAN, 6),
        ]
        records = list(bag.records(['/scan']))
        assert [(r.topic, r.msgtype, r.time_ns) for r in records] == [
            ('/scan', ros_types.SCAN, time) for time in TIMES
        ]
        scans = [bag.decode(record) for record in records]
        assert [bag.decode(r).pose.pose.position.x for r in bag.records(['/pose'])] == [
            0.5 * k for k in range(6)
        ]
    written = [message for topic, _, message in recording if topic == '/scan']
    assert all(equal_scans(a, b) for a, b in zip(scans, written, strict=True))


@pytest.mark.parametrize('kind', KINDS)
def test_cdr_is_what_ros2_sends(write_bag, recording, kind):
    """Of ROS 1 records too, whose stored bytes differ."""
    written = {(topic, time): message for topic, time, message in recording}
    with BagReader(write_bag(recording, kind)) as bag:
        for record in bag.records():
            message = written[record.topic, record.time_ns]
            assert bag.cdr(record) == bytes(typestore().serialize_cdr(message, record.msgtype))
            assert (bag.cdr(record) == record.raw) == (kind != 'ros1')


@pytest.mark.parametrize('kind', KINDS)
def test_messages_come_in_order_of_time(write_bag, make_scan, make_pose, kind):
    shuffled = [TIMES[k] for k in (3, 0, 5, 1, 4, 2)]
    records = [('/scan', time, make_scan(time)) for time in shuffled]
    records += [('/pose', time + 1, make_pose(time)) for time in reversed(shuffled)]
    with BagReader(write_bag(records, kind)) as bag:
        order = [(record.time_ns, record.topic) for record in bag.records()]
    assert order == sorted([(t, '/scan') for t in TIMES] + [(t + 1, '/pose') for t in TIMES])


@pytest.mark.parametrize('kind', KINDS)
def test_start_offset(write_bag, recording, kind):
    with BagReader(write_bag(recording, kind)) as bag:

        def times(start_ns):
            return [record.time_ns for record in bag.records(['/scan'], start_ns)]

        assert times(0) == TIMES
        assert times(TIMES[2]) == TIMES[2:]
        assert times(TIMES[2] + 1) == TIMES[3:]
        assert times(TIMES[-1] + 1) == []


@pytest.mark.parametrize('kind', KINDS)
def test_topics_that_are_not_there(write_bag, recording, kind):
    with BagReader(write_bag(recording, kind)) as bag:
        assert list(bag.records(['/none'])) == []
        assert list(bag.records([])) == []


@pytest.mark.parametrize('kind', KINDS)
def test_empty_bag(write_bag, kind):
    with BagReader(write_bag([], kind)) as bag:
        assert (bag.message_count, bag.start_ns, bag.duration_ns) == (0, 0, 0)
        assert bag.topics() == []
        assert list(bag.records()) == []
        with pytest.raises(BagError, match='it holds nothing'):
            bag.find('scans', [ros_types.SCAN])


@pytest.mark.parametrize('kind', KINDS)
def test_a_file_of_its_own(write_bag, recording, kind):
    """A storage file without its folder, as people send them around."""
    path = write_bag(recording, kind)
    file = path if path.is_file() else next(p for p in path.iterdir() if p.suffix != '.yaml')
    alone = path.parent / 'alone' / file.name
    alone.parent.mkdir()
    file.rename(alone)
    with BagReader(alone) as bag:
        assert bag.kind == KINDS[kind]
        assert [record.time_ns for record in bag.records(['/scan'])] == TIMES


def test_find(write_bag, make_scan, make_pose):
    records = [
        ('/a_pose', 1, make_pose(1)),
        ('/b_scan', 2, make_scan(2)),
        ('/c_scan', 3, make_scan(3)),
    ]
    with BagReader(write_bag(records)) as bag:
        assert bag.find('scans', [ros_types.SCAN]).name == '/b_scan'
        assert bag.find('scans', [ros_types.SCAN], '/c_scan').name == '/c_scan'
        assert bag.find('scans', [ros_types.SCAN], 'c_scan') == BagTopic(
            '/c_scan', ros_types.SCAN, 1
        )
        types = (ros_types.ODOMETRY, ros_types.POSE, ros_types.SCAN)
        assert bag.find('poses', types).name == '/a_pose'
        assert bag.find('poses', reversed(types)).name == '/b_scan'
        with pytest.raises(BagError, match=r'/a_pose has type .*Stamped: expected .*as scans'):
            bag.find('scans', [ros_types.SCAN], '/a_pose')
        with pytest.raises(BagError, match=r'no scans in it on /d_scan.*holds /a_pose \(geom'):
            bag.find('scans', [ros_types.SCAN], '/d_scan')
        with pytest.raises(BagError, match='no odometry in it: expected nav_msgs/msg/Odometry'):
            bag.find('odometry', [ros_types.ODOMETRY])
    assert str(BagTopic('/scan', ros_types.SCAN, 3)) == '/scan (sensor_msgs/msg/LaserScan)'
    assert str(BagTopic('/scan', ros_types.SCAN, 0)).endswith('LaserScan, no messages)')


@pytest.mark.parametrize(
    ('msgtype', 'node'),
    [
        ('sensor_msgs/msg/MultiEchoLaserScan', 'MultiEchoLaserScan: laser_proc makes'),
        ('sensor_msgs/msg/PointCloud2', 'PointCloud2: pointcloud_to_laserscan makes'),
    ],
)
def test_find_names_what_makes_scans(tmp_path, msgtype, node):
    writer = Ros2Writer(tmp_path / 'bag', version=9, storage_plugin=StoragePlugin.MCAP)
    with writer:
        writer.write(writer.add_connection('/echo', msgtype, typestore=typestore()), 1, b'')
    with BagReader(tmp_path / 'bag') as bag:
        with pytest.raises(BagError, match=f'no scans in it: .*/echo is {node}'):
            bag.find('scans', [ros_types.SCAN])
        with pytest.raises(BagError, match=f'topic echo has type .*/echo is {node}'):
            bag.find('scans', [ros_types.SCAN], 'echo')
        with pytest.raises(BagError, match='no poses in it') as caught:
            bag.find('poses', [ros_types.POSE])
        assert 'makes LaserScan' not in str(caught.value)


def test_find_prefers_topics_with_messages(tmp_path, make_scan):
    writer = Ros2Writer(tmp_path / 'bag', version=9, storage_plugin=StoragePlugin.MCAP)
    with writer:
        writer.add_connection('/a_empty', ros_types.SCAN, typestore=typestore())
        connection = writer.add_connection('/b_full', ros_types.SCAN, typestore=typestore())
        raw = typestore().serialize_cdr(make_scan(1), ros_types.SCAN)
        writer.write(connection, 1, raw)
    with BagReader(tmp_path / 'bag') as bag:
        assert bag.find('scans', [ros_types.SCAN]).name == '/b_full'
        with pytest.raises(BagError, match='no scans in it on a_empty'):
            bag.find('scans', [ros_types.SCAN], 'a_empty')


def test_notes_and_compression(tmp_path, make_scan):
    with BagWriter(tmp_path / 'deep' / 'bag') as bag:
        for stamp in TIMES:
            bag.write('/scan', ros_types.SCAN, stamp, make_scan(stamp, ranges=[2.5] * 5000))
        bag.note('source', 'intel.log')
    metadata = (tmp_path / 'deep' / 'bag' / 'metadata.yaml').read_text(encoding='utf-8')
    assert 'source: intel.log' in metadata
    assert 'storage_identifier: mcap' in metadata
    (stored,) = (tmp_path / 'deep' / 'bag').glob('*.mcap')
    assert stored.stat().st_size < 6 * 5000 * 4 / 4


@pytest.mark.parametrize('error', [RuntimeError, KeyboardInterrupt])
@pytest.mark.parametrize('folder', ['.', 'new/deep'])
def test_writer_is_all_or_nothing(tmp_path, make_scan, error, folder):
    path = tmp_path / folder / 'bag'
    with pytest.raises(error, match='halfway'), BagWriter(path) as bag:  # noqa: PT012
        bag.write('/scan', ros_types.SCAN, 1, make_scan(1))
        assert not path.exists()
        raise error('halfway')
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize('failing', ['old', 'new'])
def test_an_old_bag_stays_whole_until_the_new_one_is_in_place(
    tmp_path, write_bag, recording, make_scan, monkeypatch, failing
):
    path = write_bag(recording)
    before = {file.name: file.read_bytes() for file in path.iterdir()}
    replace = Path.replace

    def fails(self, target):
        if Path(target).name.startswith('.ogm_mcmc_old-') == (failing == 'old'):
            monkeypatch.setattr(Path, 'replace', replace)
            raise OSError(5, 'Input/output error')
        return replace(self, target)

    monkeypatch.setattr(Path, 'replace', fails)
    monkeypatch.setattr(folders, '_exchanged', lambda one, other: False)
    with (
        pytest.raises(OutputError, match='Input/output error'),
        BagWriter(path, overwrite=True) as bag,
    ):
        bag.write('/scan', ros_types.SCAN, 1, make_scan(1))
    assert {file.name: file.read_bytes() for file in path.iterdir()} == before
    assert list(tmp_path.iterdir()) == [path]


def test_an_old_bag_gives_way_to_a_complete_one(tmp_path, write_bag, recording, make_scan):
    path = write_bag(recording)
    with BagWriter(path, overwrite=True) as bag:
        bag.write('/scan', ros_types.SCAN, 1, make_scan(1))
    with BagReader(path) as bag:
        assert bag.message_count == 1
    assert list(tmp_path.iterdir()) == [path]


def test_a_writer_removes_what_a_killed_one_left_and_puts_the_old_bag_back(
    tmp_path, write_bag, recording, make_scan
):
    path = write_bag(recording)
    ended = subprocess.run([sys.executable, '-c', 'import os; print(os.getpid())'], stdout=-1)
    of_dead = f'{host_name()}-{int(ended.stdout)}'
    path.rename(tmp_path / f'.ogm_mcmc_old-{of_dead}-{path.name}')  # killed between two renames
    left = tmp_path / f'.ogm_mcmc-{of_dead}-abc'
    left.mkdir()
    with pytest.raises(OutputError, match='exists already'):
        BagWriter(path)
    with BagReader(path) as bag:
        assert bag.message_count == len(recording)
    with BagWriter(path, overwrite=True) as bag:
        bag.write('/scan', ros_types.SCAN, 1, make_scan(1))
    assert list(tmp_path.iterdir()) == [path]


def test_a_writer_leaves_hidden_folders_of_others_alone(tmp_path, write_bag, recording, make_scan):
    path = write_bag(recording)
    living = f'.ogm_mcmc_old-{host_name()}-{os.getpid()}-{path.name}'
    elsewhere = f'.ogm_mcmc_old-{host_name()}x-1-{path.name}'
    names = {f'.{path.name}-before', living, elsewhere}
    for name in names:
        (tmp_path / name).mkdir()
    with pytest.raises(OutputError, match='exists already'):
        BagWriter(path)
    path.rename(tmp_path / 'moved')
    with BagWriter(path) as bag:
        bag.write('/scan', ros_types.SCAN, 1, make_scan(1))
    with BagReader(path) as bag:
        assert bag.message_count == 1
    assert {one.name for one in tmp_path.iterdir()} == names | {path.name, 'moved'}


def test_writer_refuses_what_exists(tmp_path, write_bag, recording):
    path = write_bag(recording)
    with pytest.raises(OutputError, match='exists already'):
        BagWriter(path)
    photos = tmp_path / 'photos'
    photos.mkdir()
    for other in (photos, write_bag(recording, 'ros1')):
        with pytest.raises(OutputError, match='no rosbag2; expected a new name'):
            BagWriter(other, overwrite=True)
    with BagReader(path) as bag:
        assert bag.message_count == 12


def test_writer_below_a_file(tmp_path):
    (tmp_path / 'file').write_text('x')
    with pytest.raises(OutputError, match='file: expected a writable folder'):
        BagWriter(tmp_path / 'file' / 'bag')
    assert [path.name for path in tmp_path.iterdir()] == ['file']

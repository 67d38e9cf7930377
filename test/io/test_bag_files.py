"""Folders that are not quite a rosbag2, and recordings that were not closed."""

import bz2
import gzip
import lzma

import pytest
import yaml
from support.refusals import refusal_of

from ogm_mcmc.errors import BagError
from ogm_mcmc.io.bag_files import plain_yaml
from ogm_mcmc.io.bags import BagReader, BagWriter


@pytest.fixture
def recording(make_scan):
    return [('/scan', k, make_scan(k)) for k in range(1, 9)]


def times_of(path):
    with BagReader(path) as bag:
        return [record.time_ns for record in bag.records()]


def refusal(path):
    return refusal_of(BagError, times_of, path)


def stored(path):
    return next(file for file in path.iterdir() if file.suffix != '.yaml')


@pytest.fixture
def change_metadata():
    def change(path, **fields):
        file = path / 'metadata.yaml'
        content = yaml.safe_load(file.read_text(encoding='utf-8'))
        content['rosbag2_bagfile_information'].update(fields)
        file.write_text(yaml.safe_dump(content), encoding='utf-8')

    return change


@pytest.mark.parametrize('kind', ['mcap', 'sqlite3'])
def test_the_only_storage_file_is_read(write_bag, recording, kind, change_metadata):
    path = write_bag(recording, kind)
    change_metadata(path, storage_identifier='')
    assert times_of(path) == list(range(1, 9))
    stored(path).rename(path / f'other{stored(path).suffix}')
    assert times_of(path) == list(range(1, 9))
    (path / 'metadata.yaml').unlink()
    assert times_of(path) == list(range(1, 9))


@pytest.mark.parametrize(
    'fields',
    [
        {'message_count': 'many', 'duration': None, 'starting_time': []},
        {'message_count': 10**30, 'version': 77},
        {'topics_with_message_count': [{'topic_metadata': 5}], 'files': 'none'},
        {'storage_identifier': 'magnetic tape', 'compression_format': 7},
    ],
)
def test_what_the_metadata_counts_does_not_matter(write_bag, recording, fields, change_metadata):
    path = write_bag(recording)
    change_metadata(path, **fields)
    with BagReader(path) as bag:
        assert (bag.message_count, bag.start_ns, bag.duration_ns) == (8, 1, 7)
    assert times_of(path) == list(range(1, 9))


@pytest.mark.parametrize('names', [None, [], {}, 7, [['a']], ['gone.mcap', 'lost.mcap']])
def test_metadata_without_files_names_the_one_to_give(
    write_bag, recording, names, change_metadata
):
    path = write_bag(recording)
    change_metadata(path, relative_file_paths=names)
    if names == [['a']]:  # one file of another name: as if it was renamed
        assert times_of(path) == list(range(1, 9))
        return
    assert str(stored(path)) in refusal(path)


def test_several_storage_files_without_metadata(write_bag, recording):
    path = write_bag(recording)
    (path / 'metadata.yaml').unlink()
    (path / 'second.mcap').write_bytes(stored(path).read_bytes())
    message = refusal(path)
    assert f'`ros2 bag reindex {path}`' in message
    assert f'{path / "bag.mcap"} or {path / "second.mcap"}' in message


def test_split_recordings_come_in_order_of_time(tmp_path, make_scan, change_metadata):
    """Whatever the order of their names."""
    for name, stamps in (('one', (5, 6, 9)), ('two', (1, 7, 8))):
        with BagWriter(tmp_path / name) as bag:
            for stamp in stamps:
                bag.write('/scan', 'sensor_msgs/msg/LaserScan', stamp, make_scan(stamp))
    stored(tmp_path / 'two').rename(tmp_path / 'one' / 'two.mcap')
    change_metadata(tmp_path / 'one', relative_file_paths=['one.mcap', 'sub/two.mcap'])
    assert times_of(tmp_path / 'one') == [1, 5, 6, 7, 8, 9]
    with BagReader(tmp_path / 'one') as bag:
        assert [(topic.name, topic.n_messages) for topic in bag.topics()] == [('/scan', 6)]
        assert (bag.start_ns, bag.duration_ns) == (1, 8)


def test_yaml_that_grows_is_refused(write_bag, recording):
    path = write_bag(recording)
    bomb = 'a: &a [x, x]\nb: &b [*a, *a]\nrosbag2_bagfile_information: *b\n'
    (path / 'metadata.yaml').write_text(bomb, encoding='utf-8')
    message = refusal(path)
    assert 'a YAML alias' in message
    assert str(stored(path)) in message
    (path / 'metadata.yaml').write_text('#' * 8_000_001, encoding='utf-8')
    assert '8000001 bytes' in refusal(path)


@pytest.mark.parametrize('text', ['[' * 20_000, 'a: b: c', '!!python/object:os.system {}', '\0'])
def test_yaml_that_is_none(text):
    with pytest.raises(ValueError, match='no YAML'):
        plain_yaml(text)


def test_an_asterisk_is_no_alias():
    assert plain_yaml('note: 2 * 3 is "*six*"') == {'note': '2 * 3 is "*six*"'}


@pytest.mark.parametrize('pack', [gzip.compress, bz2.compress, lzma.compress])
def test_packed_recordings(tmp_path, pack):
    path = tmp_path / 'recording.packed'
    path.write_bytes(pack(b'what is in it'))
    assert 'a packed archive, to be unpacked first: expected an mcap' in refusal(path)


@pytest.mark.parametrize(
    ('content', 'name', 'told'),
    [
        (b'# CARMEN Logfile\n', 'a.log', 'import-carmen'),
        (b'FLASER 180', 'a', 'import-carmen'),
        (gzip.compress(b'FLASER', mtime=0), 'a.log.gz', 'import-carmen'),
        (b'   \n', 'a', 'its first bytes are of none'),
        (bytes(20), 'a', 'its first bytes are of none'),
    ],
)
def test_logs_are_told_from_rubbish(tmp_path, content, name, told):
    path = tmp_path / name
    path.write_bytes(content)
    assert told in refusal(path)


def test_recordings_that_were_not_closed(write_bag, recording):
    file = stored(write_bag(recording, name='cut'))
    file.write_bytes(file.read_bytes()[:-200])
    assert f'was not closed: `mcap recover {file}' in refusal(file)
    assert f'was not closed: `mcap recover {file}' in refusal(file.parent)
    bag = write_bag(recording, 'ros1')
    content = bag.read_bytes()
    bag.write_bytes(content[:-30])
    assert f'its index is damaged: `rosbag reindex {bag}` mends it' in refusal(bag)
    bag.write_bytes(content[: len(content) // 2])
    assert f'was not closed: `rosbag reindex {bag}`' in refusal(bag)
    at = content.index(b'index_pos=') + len(b'index_pos=')
    bag.write_bytes(content[:at] + bytes(8) + content[at + 8 :])
    assert f'was not closed: `rosbag reindex {bag}`' in refusal(bag)
    database = stored(write_bag(recording, 'sqlite3', name='wal'))
    database.with_name(f'{database.name}-wal').write_bytes(b'')
    assert times_of(database) == list(range(1, 9))
    database.with_name(f'{database.name}-wal').write_bytes(b'messages')
    message = refusal(database)
    assert 'was not closed' in message
    assert 'wal_checkpoint' in message
    whole = stored(write_bag(recording, 'sqlite3', name='short'))
    whole.write_bytes(whole.read_bytes()[: whole.stat().st_size // 2])
    assert f"it is cut off: `sqlite3 {whole} '.recover' | sqlite3" in refusal(whole)


def test_the_metadata_is_not_the_recording(write_bag, recording):
    bag = write_bag(recording)
    assert refusal(bag / 'metadata.yaml').endswith(f'expected the folder that it is in, {bag}')

"""Storage files of the three kinds behind one interface: mcap, sqlite3 and ROS 1 bag."""

from __future__ import annotations

import contextlib
import sqlite3
from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from rosbags.rosbag1 import Reader as Ros1Reader

from ogm_mcmc.errors import BagError
from ogm_mcmc.io.bag_files import kind_of, mending, plain_yaml, unmerged, unpacked
from ogm_mcmc.io.mcap_reader import McapReader

__all__ = ['Definition', 'Offer', 'Storage', 'StoredTopic', 'open_storage']

# The deepest queue a publisher is given for what a recording says.
DEEPEST = 1000

# How rosbag2 writes durability: its number, or its name since version 9 of the metadata.
TRANSIENT_LOCAL = (1, 'transient_local')

# Reliability likewise.
BEST_EFFORT = (2, 'best_effort')

# Renamed, with the same fields.
RENAMED = {'tf/msg/tfMessage': 'tf2_msgs/msg/TFMessage'}


class Definition(NamedTuple):
    """Definition of a type as stored: `encoding` ros2msg, ros2idl, a foreign one, or none."""

    encoding: str = ''
    text: str = ''


class Offer(NamedTuple):
    """What the recorded publishers of a topic offered.

    Latched or not, messages kept, and whether all of them were best effort.
    """

    latched: bool = False
    depth: int = 0
    best_effort: bool = False


class StoredTopic(NamedTuple):
    """A topic of one storage file; `serialization` is cdr, ros1 or something foreign."""

    key: int
    name: str
    msgtype: str
    n_messages: int
    definition: Definition
    serialization: str
    offer: Offer


class Storage(Protocol):
    """An open storage file; times of the first and last message in ns (0, 0 if there is none)."""

    topics: list[StoredTopic]
    start_ns: int
    end_ns: int

    def messages(self, keys: Collection[int], start_ns: int) -> Iterator[tuple[int, int, bytes]]:
        """Yield (topic key, time of recording in ns, bytes) in order of time."""

    def close(self) -> None:
        """Close the file."""


def open_storage(path: Path) -> Storage:
    """Open a storage file of any kind.

    Raises BagError for a file that is none or was not closed; a damaged one may raise anything.
    """
    kind = kind_of(path)
    if kind == 'sqlite3' and (reason := unmerged(path)):
        raise BagError(f'{path}: {reason}')
    try:
        return STORAGES[kind](path)
    except BagError:
        raise
    except Exception as error:
        reason = mending(path, kind)
        if reason:
            raise BagError(f'{path}: expected a complete recording: {reason}') from error
        raise


def _offer(profiles: Any) -> Offer:
    """Sum up `offered_qos_profiles`, a text of YAML or a list; what is not understood is none."""
    with contextlib.suppress(ValueError, TypeError, KeyError, AttributeError, OverflowError):
        offers = plain_yaml(profiles) if isinstance(profiles, str) else profiles
        latched = any(offer['durability'] in TRANSIENT_LOCAL for offer in offers or ())
        # Each publisher kept so many of its own messages; here one stands for all of them.
        depth = sum(max(1, int(offer['depth'])) for offer in offers or ())
        kinds = [offer.get('reliability') in BEST_EFFORT for offer in offers or ()]
        return Offer(latched, min(depth, DEEPEST), bool(kinds) and all(kinds))
    return Offer()


class McapStorage:
    """An mcap file."""

    def __init__(self, path: Path) -> None:
        self._reader = reader = McapReader(path)
        self.start_ns, self.end_ns = reader.start_ns, reader.end_ns
        self.topics = [self._topic(key) for key in reader.channels]

    def _topic(self, key: int) -> StoredTopic:
        topic, schema, encoding, metadata = self._reader.channels[key]
        definition, name = Definition(), ''
        if schema is not None:
            # ROS 1 names a type by two parts.
            name = (
                schema.name.replace('/', '/msg/') if schema.name.count('/') == 1 else schema.name
            )
            # Some encodings have definitions that are no text; then only their name counts.
            text = schema.data.decode(errors='replace')
            definition = Definition(schema.encoding, text)
        offer = _offer(metadata.get('offered_qos_profiles', ''))
        n_messages = self._reader.counts[key]
        return StoredTopic(key, topic, name, n_messages, definition, encoding, offer)

    def messages(self, keys: Collection[int], start_ns: int) -> Iterator[tuple[int, int, bytes]]:
        """Yield (topic key, time of recording in ns, bytes) in order of time."""
        for key, time_ns, raw in self._reader.messages(keys, start_ns):
            yield key, time_ns, unpacked(raw)

    def close(self) -> None:
        """Close the file."""
        self._reader.close()


class SqliteStorage:
    """A sqlite3 file of any version of rosbag2: definitions and offers came later."""

    def __init__(self, path: Path) -> None:
        where = f'{path.absolute().as_uri()}?mode=ro&immutable=1'
        self._database = sqlite3.connect(where, uri=True, check_same_thread=False)
        try:
            self.topics = self._read_topics()
            ((first, last),) = self._database.execute(
                'SELECT min(timestamp), max(timestamp) FROM messages'
            )
        except BaseException:
            self.close()
            raise
        self.start_ns, self.end_ns = int(first or 0), int(last or 0)

    def _read_topics(self) -> list[StoredTopic]:
        counts = dict(
            self._database.execute('SELECT topic_id, count(*) FROM messages GROUP BY topic_id')
        )
        definitions = {
            row['topic_type']: Definition(
                str(row['encoding']), str(row['encoded_message_definition'])
            )
            for row in self._rows('message_definitions')
        }
        return [
            StoredTopic(
                int(row['id']),
                str(row['name']),
                str(row['type']),
                int(counts.get(row['id'], 0)),
                definitions.get(row['type'], Definition()),
                str(row['serialization_format']),
                _offer(row.get('offered_qos_profiles', '')),
            )
            for row in self._rows('topics')
        ]

    def _rows(self, table: str) -> Iterator[dict[str, Any]]:
        """Yield the rows of a table that may not be there."""
        known = self._database.execute('SELECT name FROM sqlite_master WHERE type = ?', ('table',))
        if (table,) not in known.fetchall():
            return
        cursor = self._database.execute(f'SELECT * FROM {table}')
        names = [column[0] for column in cursor.description]
        for row in cursor:
            yield dict(zip(names, row, strict=True))

    def messages(self, keys: Collection[int], start_ns: int) -> Iterator[tuple[int, int, bytes]]:
        """Yield (topic key, time of recording in ns, bytes) in order of time."""
        marks = ','.join('?' * len(keys))
        rows = self._database.execute(
            'SELECT topic_id, timestamp, data FROM messages '
            f'WHERE timestamp >= ? AND topic_id IN ({marks}) ORDER BY timestamp, id',
            (start_ns, *keys),
        )
        for key, time_ns, raw in rows:
            yield int(key), int(time_ns), unpacked(bytes(raw))

    def close(self) -> None:
        """Close the file."""
        self._database.close()


class Ros1Storage:
    """A ROS 1 bag."""

    def __init__(self, path: Path) -> None:
        self._reader = Ros1Reader(path)
        self._reader.open()
        has_messages = self._reader.message_count > 0
        self.start_ns = int(self._reader.start_time) if has_messages else 0
        self.end_ns = int(self._reader.end_time) - 1 if has_messages else 0
        self._connections = {link.id: link for link in self._reader.connections}
        self.topics = [
            StoredTopic(
                link.id,
                link.topic,
                RENAMED.get(link.msgtype, link.msgtype),
                link.msgcount,
                Definition('ros2msg', link.msgdef.data),
                'ros1',
                Offer(bool(getattr(link.ext, 'latching', False)), 1),
            )
            for link in self._reader.connections
        ]

    def messages(self, keys: Collection[int], start_ns: int) -> Iterator[tuple[int, int, bytes]]:
        """Yield (topic key, time of recording in ns, bytes) in order of time."""
        links = [self._connections[key] for key in keys]
        for link, time_ns, raw in self._reader.messages(links, start=start_ns or None):
            yield link.id, time_ns, bytes(raw)

    def close(self) -> None:
        """Close the file."""
        self._reader.close()


STORAGES: dict[str, Callable[[Path], Storage]] = {
    'mcap': McapStorage,
    'sqlite3': SqliteStorage,
    'ros1': Ros1Storage,
}

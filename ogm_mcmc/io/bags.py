"""Bags of any kind the rosbags library reads, and rosbag2 (mcap, zstd) out."""

from __future__ import annotations

import contextlib
import shutil
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple, Self

from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.rosbag2.enums import CompressionFormat, CompressionMode
from rosbags.typesys import Stores, get_typestore

from ogm_mcmc.errors import BagError, OutputError

__all__ = ['BagReader', 'BagRecord', 'BagTopic', 'BagWriter', 'typestore']

TYPESTORE = get_typestore(Stores.ROS2_JAZZY)


def typestore() -> Any:
    """Return the message types of Jazzy, as rosbags knows them."""
    return TYPESTORE


class BagTopic(NamedTuple):
    """One topic of a bag."""

    name: str
    msgtype: str
    n_messages: int


class BagRecord(NamedTuple):
    """One stored message: topic, type, time of recording in ns and the bytes as stored."""

    topic: str
    msgtype: str
    time_ns: int
    raw: bytes


class BagReader:
    """Read-only view of a ROS 1 bag or a rosbag2 (folder, .mcap or .db3); a context manager.

    Whatever goes wrong while reading raises BagError with the path and the reason.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        if not path.exists():
            raise BagError(f'{path}: no such file or folder; expected a bag')
        if path.is_dir() and not (path / 'metadata.yaml').exists():
            raise BagError(f'{path}: no metadata.yaml in it; expected a rosbag2 folder')
        with self._explained('expected a ROS 1 bag or a rosbag2'):
            self._reader = AnyReader([path], default_typestore=TYPESTORE)

    @contextlib.contextmanager
    def _explained(self, expectation: str) -> Iterator[None]:
        # A damaged bag can make its reader fail in any way at all, hence Exception.
        try:
            yield
        except BagError:
            raise
        except Exception as error:
            reason = ' '.join(str(error).split()) or type(error).__name__
            raise BagError(f'{self.path}: {expectation} ({reason})') from error

    def __enter__(self) -> Self:
        """Open the bag."""
        with self._explained('expected a complete bag'):
            self._reader.open()
        self._ros2 = self._reader.is2
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close the bag."""
        self._reader.close()

    @property
    def kind(self) -> str:
        """How the bag is stored."""
        if not self._ros2:
            return 'ROS 1 bag'
        names = ' '.join(str(path) for path in _files_of(self.path))
        return 'rosbag2 (mcap)' if '.mcap' in names else 'rosbag2 (sqlite3)'

    @property
    def start_ns(self) -> int:
        """Time of the first message; 0 in an empty bag."""
        return int(self._reader.start_time) if self.message_count else 0

    @property
    def duration_ns(self) -> int:
        """From the first message to the last; 0 in an empty bag."""
        return int(self._reader.duration) if self.message_count else 0

    @property
    def message_count(self) -> int:
        """Number of messages on all topics."""
        return int(self._reader.message_count)

    def topics(self) -> list[BagTopic]:
        """All topics by name."""
        return [
            BagTopic(name, info.msgtype or 'several types', info.msgcount)
            for name, info in sorted(self._reader.topics.items())
        ]

    def find(self, role: str, msgtypes: Iterable[str], wanted: str = '') -> BagTopic:
        """Return the topic that plays a role: the one wanted, or the first of a fitting type.

        Raises BagError that names what the bag holds instead.
        """
        accepted = tuple(msgtypes)
        topics = self.topics()
        # A topic with messages comes before an empty one, then the order of the accepted types.
        fitting = sorted(
            (topic for topic in topics if topic.msgtype in accepted),
            key=lambda topic: (topic.n_messages == 0, accepted.index(topic.msgtype)),
        )
        if wanted:
            fitting = [topic for topic in topics if _same_topic(topic.name, wanted)]
            if fitting and fitting[0].msgtype not in accepted:
                raise BagError(
                    f'{self.path}: topic {wanted} has type {fitting[0].msgtype}: '
                    f'expected {" or ".join(accepted)} as {role}'
                )
        if not fitting or fitting[0].n_messages == 0:
            held = ', '.join(f'{topic.name} ({topic.msgtype})' for topic in topics) or 'nothing'
            name = f' on {wanted}' if wanted else ''
            raise BagError(
                f'{self.path}: no {role} in it{name}: expected {" or ".join(accepted)}; '
                f'it holds {held}'
            )
        return fitting[0]

    def records(
        self, topics: Iterable[str] | None = None, start_ns: int = 0
    ) -> Iterator[BagRecord]:
        """Yield stored messages in order of their time, of the named topics or of all."""
        wanted = None if topics is None else set(topics)
        connections = [
            connection
            for connection in self._reader.connections
            if wanted is None or connection.topic in wanted
        ]
        if not connections:
            return
        with self._explained('expected a complete bag'):
            for connection, time_ns, raw in self._reader.messages(
                connections=connections, start=start_ns or None
            ):
                yield BagRecord(connection.topic, connection.msgtype, time_ns, bytes(raw))

    def decode(self, record: BagRecord) -> Any:
        """Return a message object with the field names of ROS 2."""
        expectation = f'expected a readable {record.msgtype} on {record.topic}'
        with self._explained(expectation):
            return self._reader.deserialize(record.raw, record.msgtype)

    def cdr(self, record: BagRecord) -> bytes:
        """Return the message as ROS 2 sends it; stored rosbag2 bytes pass through untouched."""
        if self._ros2:
            return record.raw
        expectation = f'{record.msgtype} on {record.topic} cannot be turned into its ROS 2 form'
        with self._explained(expectation):
            return bytes(TYPESTORE.ros1_to_cdr(record.raw, record.msgtype))


def _same_topic(name: str, wanted: str) -> bool:
    return name.lstrip('/') == wanted.lstrip('/')


def _files_of(path: Path) -> list[Path]:
    return sorted(path.iterdir()) if path.is_dir() else [path]


class BagWriter:
    """A new rosbag2 (mcap, zstd): written under a temporary name, in place when complete."""

    def __init__(self, path: Path, *, overwrite: bool = False) -> None:
        self.path = path
        self.overwrite = overwrite
        if path.exists() and not (path / 'metadata.yaml').exists():
            raise OutputError(f'{path}: exists and is no rosbag2; expected a new name')
        if path.exists() and not overwrite:
            raise OutputError(f'{path}: exists already; expected a new name (or --overwrite)')
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._folder = Path(tempfile.mkdtemp(dir=path.parent, prefix=f'.{path.name}-'))
        except OSError as error:
            raise OutputError(f'{path}: cannot be written ({error.strerror})') from error
        self._writer = Writer(
            self._folder / path.name, version=9, storage_plugin=StoragePlugin.MCAP
        )
        self._writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
        self._connections: dict[str, Any] = {}

    def __enter__(self) -> Self:
        """Start writing."""
        try:
            with self._explained():
                self._writer.open()
        except OutputError:
            shutil.rmtree(self._folder, ignore_errors=True)
            raise
        return self

    @contextlib.contextmanager
    def _explained(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            reason = error.strerror or error
            raise OutputError(f'{self.path}: cannot be written ({reason})') from error

    def note(self, key: str, value: str) -> None:
        """Keep a remark in the bag's metadata."""
        self._writer.set_custom_data(key, value)

    def write(self, topic: str, msgtype: str, time_ns: int, message: Any) -> None:
        """Append a rosbags message object."""
        if topic not in self._connections:
            self._connections[topic] = self._writer.add_connection(
                topic, msgtype, typestore=TYPESTORE
            )
        data = TYPESTORE.serialize_cdr(message, msgtype)
        with self._explained():
            self._writer.write(self._connections[topic], time_ns, data)

    def _put_in_place(self) -> None:
        """Move the complete bag to its name; one that was there goes only after that."""
        new, old = self._folder / self.path.name, self._folder / '.old'
        if not self.path.exists():
            new.replace(self.path)
            return
        self.path.replace(old)
        try:
            new.replace(self.path)
        except BaseException:
            old.replace(self.path)
            raise

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Put the bag in place, or leave nothing behind after an error."""
        try:
            with self._explained():
                self._writer.__exit__(kind, error, trace)
                if kind is None:
                    self._put_in_place()
        finally:
            shutil.rmtree(self._folder, ignore_errors=True)

"""Bags of any kind in, rosbag2 (mcap, zstd) out."""

from __future__ import annotations

import contextlib
import heapq
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple, Self

from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.rosbag2.enums import CompressionFormat, CompressionMode

from ogm_mcmc.errors import BagError, OgmError, OutputError
from ogm_mcmc.files.folders import put_back, replace_folder
from ogm_mcmc.files.output_files import folder_to_fill, scratch_folder
from ogm_mcmc.io.bag_files import kind_of, storage_files, stored_note, unpack_file
from ogm_mcmc.io.bag_storage import DEEPEST, Offer, Storage, StoredTopic, open_storage
from ogm_mcmc.io.bag_types import TYPESTORE, MessageType, message_type, typestore

__all__ = ['BagReader', 'BagRecord', 'BagTopic', 'BagWriter', 'Offer', 'typestore']

# A remark in the metadata, followed by a topic.
FRAME_OF = 'frame of '

KINDS = {'mcap': 'rosbag2 (mcap)', 'sqlite3': 'rosbag2 (sqlite3)', 'ros1': 'ROS 1 bag'}

# What people record in place of scans, and who makes scans of it.
CONVERTERS = {
    'sensor_msgs/msg/MultiEchoLaserScan': 'laser_proc makes LaserScan of it',
    'sensor_msgs/msg/PointCloud2': 'pointcloud_to_laserscan makes LaserScan of it',
}


class BagTopic(NamedTuple):
    """One topic of a bag."""

    name: str
    msgtype: str
    n_messages: int

    def __str__(self) -> str:
        """Return `/scan (sensor_msgs/msg/LaserScan)`, and that it is empty."""
        return f'{self.name} ({self.msgtype}{"" if self.n_messages else ", no messages"})'


class BagRecord(NamedTuple):
    """One stored message: topic, type, time of recording in ns and the bytes as stored.

    `stored` is the topic as its file describes it.
    """

    topic: str
    msgtype: str
    time_ns: int
    raw: bytes
    stored: StoredTopic


class BagReader:
    """Read-only view of a ROS 1 bag or a rosbag2 (folder, .mcap or .db3); a context manager.

    Whatever goes wrong while reading raises BagError with the path and the reason. A topic of a
    foreign type or encoding is listed like the others; `problem` says why it cannot be read.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._storages: list[Storage] = []
        if not path.exists():
            raise BagError(f'{path}: no such file or folder; expected a bag')
        with self._explained('expected a ROS 1 bag or a rosbag2'):
            self._files = storage_files(path)
            self._kind = kind_of(self._files[0])

    @contextlib.contextmanager
    def _explained(self, expectation: str) -> Iterator[None]:
        # A damaged bag can make its reader fail in any way at all, hence Exception.
        try:
            yield
        except OgmError:
            raise
        except Exception as error:
            reason = ' '.join(str(error).split()) or type(error).__name__
            raise BagError(f'{self.path}: {expectation} ({reason})') from error

    def __enter__(self) -> Self:
        """Open the bag."""
        with contextlib.ExitStack() as stack, self._explained('expected a complete bag'):
            for file in self._files:
                if kind_of(file) == 'zstd':
                    folder = stack.enter_context(tempfile.TemporaryDirectory(prefix='ogm-bag-'))
                    file = unpack_file(file, Path(folder))
                    self._kind = kind_of(file)
                storage = open_storage(file)
                stack.callback(storage.close)
                self._storages.append(storage)
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        """Close the bag."""
        self._storages.clear()
        self._stack.close()

    @property
    def kind(self) -> str:
        """How the bag is stored."""
        return KINDS[self._kind]

    @property
    def start_ns(self) -> int:
        """Time of the first message; 0 in an empty bag."""
        return min((storage.start_ns for storage in self._filled()), default=0)

    @property
    def duration_ns(self) -> int:
        """From the first message to the last; 0 in an empty bag."""
        last = max((storage.end_ns for storage in self._filled()), default=0)
        return max(0, last - self.start_ns)

    @property
    def message_count(self) -> int:
        """Number of messages on all topics."""
        return sum(topic.n_messages for topic in self._stored())

    def _filled(self) -> list[Storage]:
        return [s for s in self._storages if any(topic.n_messages for topic in s.topics)]

    def _stored(self, name: str | None = None) -> list[StoredTopic]:
        """Return the topics of all files, or the one of a name in each of them."""
        every = (topic for storage in self._storages for topic in storage.topics)
        return [topic for topic in every if name is None or topic.name == name]

    def topics(self) -> list[BagTopic]:
        """All topics by name, also those that cannot be read."""
        named: dict[str, list[StoredTopic]] = {}
        for topic in self._stored():
            named.setdefault(topic.name, []).append(topic)
        return [
            BagTopic(
                name,
                group[0].msgtype if len({t.msgtype for t in group}) == 1 else 'several types',
                sum(topic.n_messages for topic in group),
            )
            for name, group in sorted(named.items())
        ]

    def problem(self, name: str) -> str:
        """Say why the messages of a topic cannot be read; '' if they can."""
        return next(filter(None, (self._type(t).problem for t in self._stored(name))), '')

    def unsendable(self, name: str) -> str:
        """Say why ROS 2 cannot send the messages of a topic; '' if it can."""
        if len({topic.msgtype for topic in self._stored(name)}) > 1:
            return 'its messages are of several types'
        return next(filter(None, (self._type(t).unsendable for t in self._stored(name))), '')

    def noted_frame(self, topic: str) -> str:
        """Return whose poses a topic has, where `BagWriter.note_frame` left word of it."""
        return stored_note(self.path, f'{FRAME_OF}{topic}')

    def offer(self, name: str) -> Offer:
        """Return what the recorded publishers of a topic offered, all of them together."""
        offers = [topic.offer for topic in self._stored(name)]
        depth = sum(offer.depth for offer in offers)
        return Offer(
            any(offer.latched for offer in offers),
            min(depth, DEEPEST),
            bool(offers) and all(offer.best_effort for offer in offers),
        )

    def _type(self, topic: StoredTopic) -> MessageType:
        return message_type(topic.msgtype, topic.definition, topic.serialization)

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
                    f'expected {" or ".join(accepted)} as {role}{_conversion(fitting, accepted)}'
                )
        if not fitting or fitting[0].n_messages == 0:
            held = ', '.join(map(str, topics)) or 'nothing'
            name = f' on {wanted}' if wanted else ''
            raise BagError(
                f'{self.path}: no {role} in it{name}: expected {" or ".join(accepted)}; '
                f'it holds {held}{_conversion(topics, accepted)}'
            )
        if problem := self.problem(fitting[0].name):
            raise BagError(
                f'{self.path}: {fitting[0].name} cannot be read as {role}: {problem}: '
                f'expected messages of {fitting[0].msgtype}'
            )
        return fitting[0]

    def records(
        self, topics: Iterable[str] | None = None, start_ns: int = 0
    ) -> Iterator[BagRecord]:
        """Yield stored messages in order of their time, of the named topics or of all."""
        wanted = None if topics is None else set(topics)
        streams = [self._records(storage, wanted, start_ns) for storage in self._storages]
        with self._explained('expected a complete bag'):
            yield from heapq.merge(*streams, key=lambda record: record.time_ns)

    def _records(
        self, storage: Storage, wanted: set[str] | None, start_ns: int
    ) -> Iterator[BagRecord]:
        chosen = {t.key: t for t in storage.topics if wanted is None or t.name in wanted}
        if not chosen:
            return
        for key, time_ns, raw in storage.messages(chosen, start_ns):
            topic = chosen[key]
            yield BagRecord(topic.name, topic.msgtype, time_ns, raw, topic)

    def decode(self, record: BagRecord) -> Any:
        """Return a message object with the field names of ROS 2."""
        expectation = f'expected a readable {record.msgtype} on {record.topic}'
        with self._explained(expectation):
            return self._type(record.stored).decode(record.raw)

    def cdr(self, record: BagRecord) -> bytes:
        """Return the message as ROS 2 Jazzy sends it.

        Stored rosbag2 bytes pass through untouched; ROS 1 messages and those of older definitions
        are converted, and what those did not have is 0 or empty.
        """
        expectation = (
            f'{record.msgtype} on {record.topic} cannot be turned into its ROS 2 form: '
            'expected a complete message'
        )
        with self._explained(expectation):
            return self._type(record.stored).to_cdr(record.raw)


def _same_topic(name: str, wanted: str) -> bool:
    return name.lstrip('/') == wanted.lstrip('/')


def _conversion(topics: list[BagTopic], accepted: tuple[str, ...]) -> str:
    """Name the node that makes scans of what is there."""
    if 'sensor_msgs/msg/LaserScan' not in accepted:
        return ''
    hints = [
        f'; {topic.name} is {topic.msgtype.rpartition("/")[2]}: {CONVERTERS[topic.msgtype]}'
        for topic in topics
        if topic.msgtype in CONVERTERS
    ]
    return ''.join(hints)


class BagWriter:
    """A new rosbag2 (mcap, zstd): written under a temporary name, in place when complete.

    into  a folder where it stays under its name, for who puts it in place with other files
    """

    def __init__(self, path: Path, *, overwrite: bool = False, into: Path | None = None) -> None:
        self.path = path
        self.overwrite = overwrite
        self._in_place = into is None
        self._scratch = contextlib.ExitStack()
        with self._explained():
            put_back(path)
        if path.exists() and not (path / 'metadata.yaml').exists():
            raise OutputError(f'{path}: exists and is no rosbag2; expected a new name')
        if path.exists() and not overwrite:
            raise OutputError(f'{path}: exists already; expected a new name (or --overwrite)')
        if into is None:
            self._scratch.enter_context(folder_to_fill(path.parent))
            with self._explained():
                into = self._scratch.enter_context(scratch_folder(path.parent))
        self._folder = into
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
            self._scratch.close()
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

    def note_frame(self, topic: str, frame: str) -> None:
        """Keep word of the frame whose poses a topic has: their messages cannot say so."""
        self.note(f'{FRAME_OF}{topic}', frame)

    def write(self, topic: str, msgtype: str, time_ns: int, message: Any) -> None:
        """Append a rosbags message object."""
        if topic not in self._connections:
            self._connections[topic] = self._writer.add_connection(
                topic, msgtype, typestore=TYPESTORE
            )
        data = TYPESTORE.serialize_cdr(message, msgtype)
        with self._explained():
            self._writer.write(self._connections[topic], time_ns, data)

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
                if kind is None and self._in_place:
                    replace_folder(self._folder / self.path.name, self.path)
        finally:
            self._scratch.close()

"""An mcap file: its channels of any encoding, and its messages in order of time.

Written here since the reader of rosbags refuses a whole file for the sake of one channel that is
not of ROS. Format: https://mcap.dev/spec
"""

from __future__ import annotations

import heapq
import sys
import zlib
from collections import Counter
from collections.abc import Collection, Iterator
from itertools import count
from pathlib import Path
from struct import Struct
from typing import NamedTuple

import lz4.frame  # type: ignore[import-untyped]

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

__all__ = ['McapChannel', 'McapReader', 'McapSchema']

MAGIC_SIZE, FOOTER_SIZE = 8, 29
HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK = 1, 2, 3, 4, 5, 6
CHUNK_INDEX, STATISTICS, DATA_END = 8, 11, 15

RECORD_HEAD = Struct('<BQ')
MESSAGE_HEAD = Struct('<HIQQ')
CHUNK_HEAD = Struct('<QQQI')
CHUNK_INDEX_HEAD = Struct('<QQQQ')
STATISTICS_HEAD = Struct('<QHIIIIQQ')
INDEX_ENTRY = Struct('<HQ')
U16, U32, U64 = Struct('<H'), Struct('<I'), Struct('<Q')


class McapSchema(NamedTuple):
    """Name and definition of a type; the definition of some encodings is no text."""

    name: str
    encoding: str
    data: bytes


class McapChannel(NamedTuple):
    """A topic: its schema (None where it has none), how messages are encoded, and remarks."""

    topic: str
    schema: McapSchema | None
    encoding: str
    metadata: dict[str, str]


class Part(NamedTuple):
    """A piece of the file that is read at once: a chunk, or one message that is in none.

    `channels` are those in it, empty where the index does not say.
    """

    start_ns: int
    end_ns: int
    offset: int
    channels: tuple[int, ...] = ()


class Fields:
    """Reads the fields of a record one after the other; raises ValueError where it ends early."""

    def __init__(self, data: bytes) -> None:
        self.data, self.at = data, 0

    def take(self, size: int) -> bytes:
        """Return the next bytes."""
        part = self.data[self.at : self.at + size]
        if len(part) != size:
            raise ValueError(f'a record ends early: {size} bytes wanted, {len(part)} there')
        self.at += size
        return part

    def numbers(self, form: Struct) -> tuple[int, ...]:
        """Return several numbers."""
        return form.unpack(self.take(form.size))

    def number(self, form: Struct) -> int:
        """Return one number."""
        return self.numbers(form)[0]

    def text(self) -> str:
        """Return a text."""
        return self.take(self.number(U32)).decode()


class McapReader:
    """An open mcap file; a damaged one may raise anything.

    `channels` by id, `counts` of messages by channel id, `start_ns` and `end_ns` of the first and
    the last message.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.channels: dict[int, McapChannel] = {}
        self.counts: Counter[int] = Counter()
        self.start_ns, self.end_ns = 0, 0
        self._schemas: dict[int, McapSchema] = {}
        self._parts: list[Part] = []
        self._file = path.open('rb')
        self._size = path.stat().st_size
        try:
            self._open()
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _open(self) -> None:
        self._file.seek(MAGIC_SIZE)
        # Its profile may be missing or not of ROS: what counts is how each channel is encoded.
        code, _ = self._record()
        if code != HEADER:
            raise ValueError('no header at its start')
        data_start = self._file.tell()
        end = self._file.seek(-MAGIC_SIZE - FOOTER_SIZE, 2)
        code, footer = self._record()
        if code != FOOTER:
            raise ValueError('no footer at its end')
        summary = U64.unpack_from(footer)[0]
        complete = False
        if summary:
            self._file.seek(summary)
            complete = self._read_summary(end)
        if not complete:
            self._scan(data_start, end)

    def _record(self) -> tuple[int, bytes]:
        head = self._file.read(RECORD_HEAD.size)
        if len(head) < RECORD_HEAD.size:
            raise ValueError('it ends where a record was to begin')
        code, size = RECORD_HEAD.unpack(head)
        left = self._size - self._file.tell()
        if size > left:
            raise ValueError(f'a record of {size} bytes where {left} are left')
        return code, self._file.read(size)

    def _read_summary(self, end: int) -> bool:
        """Read schemas, channels, index and counts; False when they are not all there."""
        counted = False
        while self._file.tell() < end:
            code, content = self._record()
            fields = Fields(content)
            if code == CHUNK_INDEX:
                start, stop, offset, _ = fields.numbers(CHUNK_INDEX_HEAD)
                size = fields.number(U32)
                held = tuple(number for number, _ in INDEX_ENTRY.iter_unpack(fields.take(size)))
                self._parts.append(Part(start, stop, offset, held))
            elif code == STATISTICS:
                total, *_, self.start_ns, self.end_ns = fields.numbers(STATISTICS_HEAD)
                for _ in range(fields.number(U32) // 10):
                    channel = fields.number(U16)
                    self.counts[channel] = fields.number(U64)
                counted = total == sum(self.counts.values())
            else:
                self._note(code, fields)
        # Messages outside of chunks have no index: they are found by a scan.
        none_lost = bool(self._parts) or not self.counts.total()
        return counted and none_lost and self.counts.keys() <= self.channels.keys()

    def _note(self, code: int, fields: Fields) -> None:
        if code == SCHEMA:
            key = fields.number(U16)
            name, encoding = fields.text(), fields.text()
            self._schemas[key] = McapSchema(name, encoding, fields.take(fields.number(U32)))
        elif code == CHANNEL:
            key, schema = fields.number(U16), self._schemas.get(fields.number(U16))
            topic, encoding = fields.text(), fields.text()
            end = fields.number(U32) + fields.at
            metadata = {}
            while fields.at < end:
                name = fields.text()
                metadata[name] = fields.text()
            self.channels.setdefault(key, McapChannel(topic, schema, encoding, metadata))

    def _scan(self, start: int, end: int) -> None:
        """Read the whole file once, for want of an index."""
        self._parts.clear()
        self.counts.clear()
        self.start_ns, self.end_ns = 2**64, 0
        self._file.seek(start)
        while (offset := self._file.tell()) < end:
            code, content = self._record()
            if code == DATA_END:
                break
            if code not in (CHUNK, MESSAGE):
                self._note(code, Fields(content))
                continue
            times = []
            for inner, record in _inside(code, content):
                if inner == MESSAGE:
                    channel, _, time_ns, _ = MESSAGE_HEAD.unpack_from(record)
                    self.counts[channel] += 1
                    times.append(time_ns)
                else:
                    self._note(inner, Fields(bytes(record)))
            if times:
                self._parts.append(Part(min(times), max(times), offset))
                self.start_ns = min(self.start_ns, *times)
                self.end_ns = max(self.end_ns, *times)

    def messages(
        self, channels: Collection[int], start_ns: int = 0
    ) -> Iterator[tuple[int, int, bytes]]:
        """Yield (channel id, time of recording in ns, message) in order of time."""
        wanted = frozenset(channels)
        order, waiting = count(), list[tuple[int, int, int, bytes]]()
        for part in sorted(self._parts):
            unwanted = part.channels and not any(map(wanted.__contains__, part.channels))
            if part.end_ns < start_ns or unwanted:
                continue
            while waiting and waiting[0][0] < part.start_ns:
                time_ns, _, channel, raw = heapq.heappop(waiting)
                yield channel, time_ns, raw
            self._file.seek(part.offset)
            code, content = self._record()
            for inner, record in _inside(code, content):
                if inner != MESSAGE:
                    continue
                channel, _, time_ns, _ = MESSAGE_HEAD.unpack_from(record)
                if channel in wanted and time_ns >= start_ns:
                    raw = bytes(record[MESSAGE_HEAD.size :])
                    heapq.heappush(waiting, (time_ns, next(order), channel, raw))
        while waiting:
            time_ns, _, channel, raw = heapq.heappop(waiting)
            yield channel, time_ns, raw


def _chunk(content: bytes) -> bytes:
    """Return the records of a chunk, decompressed and checked."""
    fields = Fields(content)
    _, _, size, checksum = fields.numbers(CHUNK_HEAD)
    compression = fields.text()
    packed = fields.take(fields.number(U64))
    if compression == 'zstd':
        plain = zstd.decompress(packed)
    elif compression == 'lz4':
        plain = lz4.frame.decompress(packed)
    elif compression == '':
        plain = packed
    else:
        raise ValueError(f'compression {compression!r}: expected zstd, lz4 or none')
    if len(plain) != size or (checksum and zlib.crc32(plain) != checksum):
        raise ValueError('a chunk is damaged')
    return plain


def _inside(code: int, content: bytes) -> Iterator[tuple[int, memoryview]]:
    """Yield the records of a chunk, or the record itself."""
    if code != CHUNK:
        yield code, memoryview(content)
        return
    plain, at = memoryview(_chunk(content)), 0
    while at < len(plain):
        code, size = RECORD_HEAD.unpack_from(plain, at)
        at += RECORD_HEAD.size
        if at + size > len(plain):
            raise ValueError('a record ends after its chunk')
        yield code, plain[at : at + size]
        at += size

"""Stamp and frame of a stored message, without decoding the rest of it."""

from __future__ import annotations

import struct
from typing import NamedTuple

from ogm_mcmc.io.bags import BagRecord

__all__ = ['StoredHeader', 'stored_header']

NS_PER_S = 1_000_000_000

# CDR begins with four bytes that name the encoding, ROS 1 has a number of the sequence.
SKIPPED = 4


class StoredHeader(NamedTuple):
    """Stamp in ns, and frame without the leading slash of ROS 1."""

    stamp_ns: int
    frame: str


def stored_header(record: BagRecord) -> StoredHeader | None:
    """Read the std_msgs/Header a message begins with; None where the bytes hold none."""
    raw = record.raw
    ros1 = record.stored.serialization == 'ros1'
    order = '<' if ros1 or len(raw) < 2 or raw[1] & 1 else '>'
    try:
        seconds, nanoseconds, length = struct.unpack_from(
            f'{order}{"I" if ros1 else "i"}II', raw, SKIPPED
        )
        text = raw[SKIPPED + 12 : SKIPPED + 12 + length].decode()
    except (struct.error, UnicodeDecodeError):
        return None
    return StoredHeader(seconds * NS_PER_S + nanoseconds, text.rstrip('\0').lstrip('/'))

"""Times of a log as a bag can hold them: within the range of a ROS stamp, none of them twice."""

from __future__ import annotations

import bisect
import itertools
from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

__all__ = [
    'MAX_STAMP_S',
    'NS_PER_S',
    'MendedTimes',
    'in_order_of_the_file',
    'storable_times',
    'strictly_increasing',
]

NS_PER_S = 1_000_000_000
MAX_STAMP_S = 2.0**31 - 1.0

COUNTER_S = 2.0**32  # where an unsigned clock of seconds starts again
SMALL_STEP_BACK_S = 1.0  # records of several sources are written a little out of order
CLOSE_S = 3600.0


class MendedTimes(NamedTuple):
    """Times from 0 on that never fall; `shift_s`: by how much the first moved; jumps closed."""

    times_s: list[float]
    shift_s: float
    jumps: int


def in_order_of_the_file(times_s: Sequence[float]) -> MendedTimes:
    """Return times (N,) that start at 0 and follow the order of the file, whatever the clock did.

    For logs whose clock is negative or wraps around: distances between records are kept; where
    the clock steps back, the records go on at the time reached, and so they do where it starts
    again, by the seconds since where it is a counter of 32 bits. A stray time that the next ones
    do not follow moves no other.
    """
    offsets = [-times_s[0]]  # the one in use is the last
    latest = 0.0
    mended = []
    jumps = 0
    before = times_s[0]
    for time in times_s:
        for offset in reversed(offsets):
            if -SMALL_STEP_BACK_S <= time + offset - latest <= CLOSE_S:
                break
        else:
            offset = offsets[-1]
            ahead = time + offset - latest
            if not 0.0 <= ahead < MAX_STAMP_S:
                since = (time - before) % COUNTER_S
                offset = latest + (since if since <= CLOSE_S else 0.0) - time
        if offset != offsets[-1]:
            jumps += 1
            offsets = [*(other for other in offsets if other != offset), offset]
        latest = max(latest, time + offset)
        mended.append(latest)
        before = time
    return MendedTimes(mended, 0.0 - times_s[0], jumps)


def storable_times(times_s: Sequence[float]) -> MendedTimes:
    """Return times (N,) that a ROS stamp holds: as they are, or by the order of the file from 0.

    Times of which most are no times at all stay as they are.
    """
    usual = sorted(times_s)[(len(times_s) - 1) // 2]
    no_times = not -(2.0**33) < usual < 2.0**33
    if no_times or 0.0 <= min(times_s) <= max(times_s) < MAX_STAMP_S:
        return MendedTimes(list(times_s), 0.0, 0)
    return in_order_of_the_file(times_s)


def strictly_increasing(
    times_s: list[float], kinds: list[str], step_s: float
) -> tuple[list[int], list[int], int]:
    """Order records by time and give each a stamp; return (order, stamps ns, repeats mended).

    Records that share a stamp keep the order of the file, and two kinds may share one. Of kinds
    that have a stamp twice, the records of that stamp are spread evenly, in that order, before
    the next stamp and at most `step_s` apart.
    """
    stamps = [round(time * NS_PER_S) for time in times_s]
    order = sorted(range(len(stamps)), key=stamps.__getitem__)
    spread: dict[int, int] = {}
    repeats = 0
    for stamp, group in itertools.groupby(order, key=stamps.__getitem__):
        same = list(group)
        count = Counter(kinds[index] for index in same)
        repeated = [index for index in same if count[kinds[index]] > 1]
        if repeated:
            repeats += len(repeated) - len({kinds[index] for index in repeated})
            following = bisect.bisect_right(order, stamp, key=stamps.__getitem__)
            gap = round(step_s * NS_PER_S)
            if following < len(order):
                gap = max(1, min(gap, (stamps[order[following]] - stamp) // len(repeated)))
            spread.update({index: stamp + k * gap for k, index in enumerate(repeated)})
    order.sort(key=lambda index: spread.get(index, stamps[index]))
    mended: dict[int, int] = {}
    last_of_kind: dict[str, int] = {}
    for index in order:
        # Stamps closer together than the spread needs (nanoseconds) are pushed on.
        stamp = max(spread.get(index, stamps[index]), last_of_kind.get(kinds[index], -1) + 1)
        last_of_kind[kinds[index]] = stamp
        mended[index] = stamp
    order.sort(key=mended.__getitem__)
    return order, [mended[index] for index in order], repeats

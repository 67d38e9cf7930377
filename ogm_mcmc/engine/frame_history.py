"""Where one frame was over time: the entries of tf for one child."""

from __future__ import annotations

from array import array
from bisect import bisect_left, bisect_right
from typing import NamedTuple

import numpy as np

from ogm_mcmc.geometry.rigid_transform import RigidTransform, StampedTransform

__all__ = ['Around', 'FrameHistory']

# Three numbers of a translation, four of a quaternion.
VALUES = 7

# m, or of a quaternion: entries that differ by less say the same.
SAME = 1e-5

# A stamp that is further ahead of the arrival is wrong.
AHEAD_NS = 1_000_000_000


class Around(NamedTuple):
    """The entries at and around a stamp: `later` is `earlier` where nothing is interpolated.

    `apart_ns` is how far apart their stamps are; 0 at the very stamp of an entry and for a
    static frame. `parent` is that of the earlier one.
    """

    parent: str
    earlier: RigidTransform
    later: RigidTransform
    fraction: float
    apart_ns: int

    @property
    def transform(self) -> RigidTransform:
        """The frame in its parent at the stamp."""
        if self.later is self.earlier:
            return self.earlier
        return self.earlier.towards(self.later, self.fraction)


class FrameHistory:
    """Entries of one child frame in order of their stamps, packed: 64 bytes and a name each.

    A static frame holds from its stamp on until the next one, the first of them always.
    """

    def __init__(self, static: bool) -> None:
        self.static = static
        self.stamps = array('q')
        self._values = array('d')
        self._parents: list[str] = []

    def __len__(self) -> int:
        """Return the number of entries."""
        return len(self.stamps)

    def add(self, entry: StampedTransform) -> None:
        """Take an entry in its place; one with a stamp that is there replaces that."""
        values = array('d', (*entry.transform.translation, *entry.transform.quaternion))
        k = bisect_left(self.stamps, entry.stamp_ns)
        there = k < len(self.stamps) and self.stamps[k] == entry.stamp_ns
        end = k + 1 if there else k
        self.stamps[k:end] = array('q', (entry.stamp_ns,))
        self._parents[k:end] = [entry.parent]
        self._values[VALUES * k : VALUES * end] = values

    def add_static(self, entry: StampedTransform, arrival_ns: int | None) -> None:
        """Take a static entry: a correction counts from its own stamp on, or from its arrival.

        The latter where its stamp says nothing, being no later than that of the one before, or is
        of the future.
        """
        if self.stamps:
            newest_ns = self.stamps[-1]
            newest = self.around(newest_ns)
            if (newest.parent, newest.earlier) == (entry.parent, entry.transform):
                return  # the same, sent again
            since_ns = entry.stamp_ns
            if arrival_ns and (since_ns <= newest_ns or since_ns > arrival_ns + AHEAD_NS):
                since_ns = arrival_ns
            entry = entry._replace(stamp_ns=max(since_ns, newest_ns))
        self.add(entry)

    def keep_from(self, stamp_ns: int) -> None:
        """Forget all entries before a stamp."""
        self.drop_first(bisect_left(self.stamps, stamp_ns))

    def drop_first(self, count: int) -> None:
        """Forget the earliest entries."""
        del self.stamps[:count], self._parents[:count], self._values[: VALUES * count]

    def covers(self, stamp_ns: int) -> bool:
        """Return whether a stamp lies between the entries, or the frame is static."""
        return self.static or self.stamps[0] <= stamp_ns <= self.stamps[-1]

    @property
    def constant(self) -> bool:
        """Whether all entries say the same."""
        values = np.frombuffer(self._values).reshape(-1, VALUES)
        same = bool(np.abs(values - values[-1]).max() <= SAME)
        return same and self._parents.count(self._parents[-1]) == len(self._parents)

    def newest(self) -> RigidTransform:
        """Return the newest entry."""
        return self._transform(len(self.stamps) - 1)

    def latest_parent(self) -> str:
        """Return the parent of the newest entry."""
        return self._parents[-1]

    def around(self, stamp_ns: int) -> Around:
        """Return what is known around a stamp that is covered."""
        k = max(bisect_right(self.stamps, stamp_ns) - 1, 0)
        parent, earlier = self._parents[k], self._transform(k)
        if self.static or self.stamps[k] == stamp_ns:
            return Around(parent, earlier, earlier, 0.0, 0)
        start, end = self.stamps[k], self.stamps[k + 1]
        if self._parents[k + 1] != parent:
            # Between two parents nothing can be interpolated; the earlier one still holds (tf2).
            return Around(parent, earlier, earlier, 0.0, end - start)
        fraction = (stamp_ns - start) / (end - start)
        return Around(parent, earlier, self._transform(k + 1), fraction, end - start)

    def _transform(self, k: int) -> RigidTransform:
        x, y, z, qx, qy, qz, qw = self._values[VALUES * k : VALUES * (k + 1)]
        return RigidTransform((x, y, z), (qx, qy, qz, qw))

"""What the kernels of the adaptive map work on: tuples of flat arrays."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ogm_mcmc.arrays import Float32Array, Float64Array, Int64Array, UInt8Array
from ogm_mcmc.mapping.quadtree_kernels import NONE

__all__ = [
    'ActiveLeaves',
    'Int32Array',
    'Leaves',
    'PlacedBeams',
    'QuadtreeArrays',
    'Trail',
    'active_arrays',
    'tree_arrays',
]

Int32Array = npt.NDArray[np.int32]


class QuadtreeArrays(NamedTuple):
    """A node is a row; the four children of a node are neighbours, lower left first, row by row.

    `first_child` -1: a leaf; `parent` -1: a root, -2: not in use; `level`: side 2**level cells;
    `log_odds` nats, nan where never measured; `hits`, `misses`: beams, weighted by pose samples,
    since the leaf was made; `slot`: place among the active leaves while a scan is added, or -1.
    """

    first_child: Int32Array
    parent: Int32Array
    slot: Int32Array
    level: UInt8Array
    log_odds: Float32Array
    hits: Float32Array
    misses: Float32Array


class ActiveLeaves(NamedTuple):
    """Leaves that one scan touches: row in the tree, lower left cell, and this scan's counts.

    `evidence`: nats, weighted by pose samples; `stamp`: which sample came last, see the kernel.
    """

    node: Int32Array
    column: Int64Array
    row: Int64Array
    hits: Float64Array
    misses: Float64Array
    unknowns: Float64Array
    evidence: Float64Array
    stamp: Int64Array


class Leaves(NamedTuple):
    """All leaves of a tree: level, lower left cell on the lattice, and what each holds."""

    level: UInt8Array
    column: Int64Array
    row: Int64Array
    log_odds: Float32Array
    hits: Float32Array
    misses: Float32Array


class Trail(NamedTuple):
    """Which active leaves each beam met that may still split, so that few beams are walked twice.

    Beam n met `slots[first[n]:last[n]]`; `used` (1,): slots taken in all; `again`: whether the
    beam is to be walked in this round.
    """

    slots: Int32Array
    first: Int64Array
    last: Int64Array
    again: UInt8Array
    used: Int64Array

    @classmethod
    def of(cls, walked: UInt8Array, size: int) -> Trail:
        """Return one for beams of which those marked are walked in the first round."""
        n = walked.size
        slots, ends = np.zeros(size, np.int32), np.zeros((2, n), np.int64)
        return cls(slots, ends[0], ends[1], walked.copy(), np.zeros(1, np.int64))

    def roomier(self, room: int) -> Trail:
        """Return this one with space for `room` more slots."""
        needed = int(self.used[0]) + room
        if needed <= self.slots.size:
            return self
        slots = np.zeros(2 * needed, np.int32)
        slots[: self.slots.size] = self.slots
        return self._replace(slots=slots)


class PlacedBeams(NamedTuple):
    """The beams of a scan from every pose sample, in cells relative to each sensor's own cell.

    `column`, `row`: that cell, relative to the tree's; `x`, `y`: the sensor in it; `end_x`,
    `end_y`: where the reading ends; `last_x`, `last_y`: how far behind it cells are unknown;
    `hit`: whether something was hit; `sample`, `weight`: of the pose.
    """

    column: Int64Array
    row: Int64Array
    x: Float64Array
    y: Float64Array
    end_x: Float64Array
    end_y: Float64Array
    last_x: Float64Array
    last_y: Float64Array
    hit: UInt8Array
    sample: Int64Array
    weight: Float64Array


def tree_arrays(n: int) -> QuadtreeArrays:
    """Return n untouched leaves that belong to nothing."""
    return QuadtreeArrays(
        first_child=np.full(n, NONE, np.int32),
        parent=np.full(n, NONE, np.int32),
        slot=np.full(n, NONE, np.int32),
        level=np.zeros(n, np.uint8),
        log_odds=np.zeros(n, np.float32),
        hits=np.zeros(n, np.float32),
        misses=np.zeros(n, np.float32),
    )


def active_arrays(n: int) -> ActiveLeaves:
    """Return room for n active leaves."""
    return ActiveLeaves(
        node=np.zeros(n, np.int32),
        column=np.zeros(n, np.int64),
        row=np.zeros(n, np.int64),
        hits=np.zeros(n),
        misses=np.zeros(n),
        unknowns=np.zeros(n),
        evidence=np.zeros(n),
        stamp=np.zeros(n, np.int64),
    )

"""Kernels of the adaptive map ([pose] section VI): split, update, merge.

tree    `QuadtreeArrays`: a node is a row; a leaf has no children
active  `ActiveLeaves`: the leaves a scan touches; a leaf's row says its slot in here

Nothing is checked: there must be room for the rows that a kernel adds.
"""

import math

import numpy as np
from numba import njit

NONE, FREED = -1, -2

# Places in the `counters` of a tree.
ROWS, FREE, ACTIVE = range(3)


@njit(cache=True, nogil=True, inline='always')
def clear_row(tree, node, parent, level, log_odds):
    """Make a row an untouched leaf."""
    tree.first_child[node] = NONE
    tree.parent[node] = parent
    tree.slot[node] = NONE
    tree.level[node] = level
    tree.log_odds[node] = log_odds
    tree.hits[node] = 0.0
    tree.misses[node] = 0.0


@njit(cache=True, nogil=True, inline='always')
def deviation(most, other, unknown, noise, unknowns):
    """Chi-square of counts against a leaf that is all of one kind.

    Of n beams a share 1 - noise should agree with the leaf; the rest is spread evenly over the
    other kinds, of which there are two if unknowns count ([pose] section VI-A).
    Deviation: only contradictions beyond the expected ones count. To the test as it stands, no
    contradiction among 300 beams would be as suspicious as too many.
    """
    n = most + other + (unknown if unknowns else 0.0)
    right = n * (1.0 - noise)
    wrong = n * noise / (2.0 if unknowns else 1.0)
    chi_square = max(0.0, right - most) ** 2 / right + max(0.0, other - wrong) ** 2 / wrong
    if unknowns:
        chi_square += max(0.0, unknown - wrong) ** 2 / wrong
    return chi_square


@njit(cache=True, nogil=True)
def give_children(tree, counters, node):
    """Make a leaf a parent of four leaves that inherit its log-odds; return the first of them.

    Their counts start at nothing, because which child the old ones belong to is not known.
    """
    level = np.int64(tree.level[node])
    first = counters[FREE]
    if first >= 0:
        counters[FREE] = tree.first_child[first]
    else:
        first = counters[ROWS]
        counters[ROWS] += 4
    for child in range(first, first + 4):
        clear_row(tree, child, node, level - 1, tree.log_odds[node])
    tree.first_child[node] = first
    tree.slot[node] = NONE
    tree.hits[node] = tree.misses[node] = 0.0
    return first


@njit(cache=True, nogil=True)
def split_leaves(tree, counters, active, finest, fresh, critical, noise, unknowns):
    """Split the active leaves from slot `fresh` on whose counts fit neither kind of leaf.

    Children inherit the log-odds from before this scan. Needs room for four rows per leaf.
    Returns how many were split; their slots are vacant then (node -1).
    """
    split = 0
    for slot in range(fresh, counters[ACTIVE]):
        node = active.node[slot]
        level = np.int64(tree.level[node])
        if level <= finest:
            continue
        hits = tree.hits[node] + active.hits[slot]
        misses = tree.misses[node] + active.misses[slot]
        unknown = active.unknowns[slot]
        free = deviation(misses, hits, unknown, noise, unknowns)
        occupied = deviation(hits, misses, unknown, noise, unknowns)
        if min(free, occupied) < critical:
            continue
        give_children(tree, counters, node)
        active.node[slot] = NONE
        split += 1
    return split


@njit(cache=True, nogil=True)
def apply_evidence(tree, counters, active, prior, limit, count_limit, extent):
    """Give every active leaf its log-odds and counts; widen `extent` to what changed.

    l <- l + sum over samples of weight * l(m | z) - l(m) ([pose] Eq. 3 and 9)
    count_limit  hits and misses shrink together to this many beams
    extent  (4,) int64: first column, first row, one past the last column and row
    """
    for slot in range(counters[ACTIVE]):
        node = active.node[slot]
        if node < 0:
            continue
        old = tree.log_odds[node]
        before = prior if old != old else old
        change = np.float32(active.evidence[slot])
        tree.log_odds[node] = min(max(before + change, -limit), limit)
        hits = np.float64(tree.hits[node]) + active.hits[slot]
        misses = np.float64(tree.misses[node]) + active.misses[slot]
        share = min(1.0, count_limit / (hits + misses)) if hits + misses > 0.0 else 1.0
        tree.hits[node] = np.float32(share * hits)
        tree.misses[node] = np.float32(share * misses)
        tree.slot[node] = NONE
        side = np.int64(1) << np.int64(tree.level[node])
        extent[0] = min(extent[0], active.column[slot])
        extent[1] = min(extent[1], active.row[slot])
        extent[2] = max(extent[2], active.column[slot] + side)
        extent[3] = max(extent[3], active.row[slot] + side)


@njit(cache=True, nogil=True, inline='always')
def may_merge(tree, first, below, above, spread, margin, critical, noise):
    """Whether four leaves hold nothing that one would not ([pose] section VI-B).

    Deviation: their counts together must pass the test for splitting, too. Otherwise the next
    scan would split the leaf again, and each hit on a new thing in an area long known to be free
    would be spread over that area before the next one comes.
    """
    total = squares = 0.0
    hits = misses = 0.0
    smallest, largest = 2.0, -1.0
    unseen = 0
    for child in range(first, first + 4):
        if tree.first_child[child] >= 0:
            return False
        hits += tree.hits[child]
        misses += tree.misses[child]
        if tree.log_odds[child] != tree.log_odds[child]:
            unseen += 1
            continue
        p = 1.0 / (1.0 + math.exp(-np.float64(tree.log_odds[child])))
        total += p
        squares += p * p
        smallest, largest = min(smallest, p), max(largest, p)
    if unseen > 0:
        return unseen == 4
    if hits + misses > 0.0:
        free = deviation(misses, hits, 0.0, noise, False)
        occupied = deviation(hits, misses, 0.0, noise, False)
        if min(free, occupied) >= critical:
            return False
    mean = total / 4.0
    width = math.sqrt(max(0.0, squares / 4.0 - mean * mean))
    certain = mean <= margin or mean >= 1.0 - margin
    return (width < spread and certain) or smallest > above or largest < below


@njit(cache=True, nogil=True)
def merge_leaves(tree, counters, active, below, above, spread, margin, critical, noise, extent):
    """Merge siblings of touched leaves, as far up as they allow; return how many groups were.

    The new leaf has the mean of the log-odds and the sum of the counts; `extent` as before.
    critical  upper point of chi-square with one degree of freedom: unknowns are forgotten by now
    """
    merged = 0
    for slot in range(counters[ACTIVE]):
        node = active.node[slot]
        if node < 0 or tree.parent[node] == FREED:
            continue
        parent = tree.parent[node]
        while parent >= 0:
            first = tree.first_child[parent]
            if not may_merge(tree, first, below, above, spread, margin, critical, noise):
                break
            total = 0.0
            for child in range(first, first + 4):
                total += np.float64(tree.log_odds[child])
                tree.hits[parent] += tree.hits[child]
                tree.misses[parent] += tree.misses[child]
                tree.parent[child] = FREED
            tree.log_odds[parent] = np.float32(total / 4.0)
            tree.first_child[parent] = NONE
            tree.first_child[first] = counters[FREE]
            counters[FREE] = first
            merged += 1
            level = np.int64(tree.level[parent])
            column, row = active.column[slot] >> level << level, active.row[slot] >> level << level
            extent[0] = min(extent[0], column)
            extent[1] = min(extent[1], row)
            extent[2] = max(extent[2], column + (np.int64(1) << level))
            extent[3] = max(extent[3], row + (np.int64(1) << level))
            parent = tree.parent[parent]
    return merged


@njit(cache=True, nogil=True)
def plant(tree, counters, table, coarsest, leaves, start):
    """Put leaves where they belong in a tree, from `start` on; return how far that went.

    leaves  `Leaves`, cells relative to the tree's; stops at one that overlaps another, and where
            fewer than 50 rows are left
    """
    for k in range(start, leaves.level.size):
        if tree.level.size - counters[ROWS] < 50:
            return k
        column, row, level = leaves.column[k], leaves.row[k], np.int64(leaves.level[k])
        node = np.int64(table[row >> coarsest, column >> coarsest])
        if node < 0:
            node = counters[ROWS]
            counters[ROWS] += 1
            clear_row(tree, node, NONE, coarsest, math.nan)
            tree.slot[node] = k  # taken by this leaf and its siblings to be
            table[row >> coarsest, column >> coarsest] = node
        here = coarsest
        while here > level:
            first = np.int64(tree.first_child[node])
            if first < 0:
                if tree.slot[node] == NONE:
                    return k
                first = np.int64(give_children(tree, counters, node))
                for child in range(first, first + 4):
                    tree.slot[child] = k
            here -= 1
            node = first + 2 * ((row >> here) & 1) + ((column >> here) & 1)
        if tree.first_child[node] >= 0 or tree.slot[node] == NONE:
            return k
        tree.slot[node] = NONE
        tree.log_odds[node] = leaves.log_odds[k]
        tree.hits[node] = leaves.hits[k]
        tree.misses[node] = leaves.misses[k]
    return leaves.level.size

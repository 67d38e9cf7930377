"""Kernels of the adaptive map ([pose] section VI): count, split, update, merge, read.

tree    `QuadtreeArrays`: a node is a row; a leaf has no children
active  `ActiveLeaves`: the leaves a scan touches; a leaf's row says its slot in here
table   (rows, columns) int32: the root of each tile, -1 where none is yet; tile (0, 0) has cell
        (0, 0), and all cells here are relative to that one
beams   `PlacedBeams`: one scan from every pose sample
trail   `Trail`: which leaves each beam met that may still split

Nothing is checked: beams must lie inside the table.
"""

import math

import numpy as np
from numba import njit

from ogm_mcmc.geometry.traversal_kernels import trace_ray

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
def find_leaf(first_child, table, coarsest, column, row):
    """Return the leaf that holds a cell and its level; -1 and the coarsest if there is none."""
    node = np.int64(table[row >> coarsest, column >> coarsest])
    level = coarsest
    if node >= 0:
        child = np.int64(first_child[node])
        while child >= 0:
            level -= 1
            node = child + 2 * ((row >> level) & 1) + ((column >> level) & 1)
            child = np.int64(first_child[node])
    return node, level


@njit(cache=True, nogil=True)
def activate(tree, counters, active, table, coarsest, node, level, column, row):
    """Give a leaf a slot among the active ones, and a tile without any its root; return it."""
    if node < 0:
        node = counters[ROWS]
        counters[ROWS] += 1
        clear_row(tree, node, NONE, coarsest, math.nan)
        table[row >> coarsest, column >> coarsest] = node
    slot = counters[ACTIVE]
    counters[ACTIVE] += 1
    tree.slot[node] = slot
    active.node[slot] = node
    active.column[slot] = column >> level << level
    active.row[slot] = row >> level << level
    active.hits[slot] = active.misses[slot] = active.unknowns[slot] = 0.0
    active.evidence[slot] = 0.0
    active.stamp[slot] = -1
    return node


@njit(cache=True, nogil=True)
def count_hit(active, slot, sample, weight, way, l_free, l_occ, per_scan):
    """Note a beam that ended in a leaf after crossing a share `way` of its side."""
    active.hits[slot] += weight
    active.misses[slot] += weight * way
    if not per_scan:
        active.evidence[slot] += weight * l_occ
    elif active.stamp[slot] <= 2 * sample:
        # A hit beats the miss of another beam of the same scan.
        missed = active.stamp[slot] == 2 * sample
        active.evidence[slot] += weight * (l_occ - l_free if missed else l_occ)
        active.stamp[slot] = 2 * sample + 1


@njit(cache=True, nogil=True)
def count_seen(
    tree,
    counters,
    active,
    trail,
    table,
    coarsest,
    finest,
    beams,
    start,
    fresh,
    l_free,
    l_occ,
    per_scan,
    way_to_hit,
):
    """Count hits and misses of the beams from `start` on; return the first that has no room.

    fresh  slots below are left alone: their leaves were counted before
    The stamp of a slot is 2 j after a miss and 2 j + 1 after a hit by pose sample j, so that a
    leaf takes each sample's scan once (`per_scan`).
    """
    # Taken out of their tuples once: inside the loops each access would count a reference.
    first_child, slots, met_slots = tree.first_child, tree.slot, trail.slots
    misses, evidence, stamp = active.misses, active.evidence, active.stamp
    columns, rows = np.empty(0, np.int64), np.empty(0, np.int64)
    for beam in range(start, beams.end_x.size):
        if not trail.again[beam]:
            continue
        x0, y0, x1, y1 = beams.x[beam], beams.y[beam], beams.end_x[beam], beams.end_y[beam]
        longest = np.int64(abs(x1 - x0) + abs(y1 - y0)) + 5
        room = min(active.node.size - counters[ACTIVE], tree.level.size - counters[ROWS])
        if min(room, met_slots.size - trail.used[0]) < longest:
            return beam
        if columns.size < longest:
            columns, rows = np.empty(2 * longest, np.int64), np.empty(2 * longest, np.int64)
        cells = trace_ray(beams.column[beam], beams.row[beam], x0, y0, x1, y1, columns, rows)
        sample, weight = beams.sample[beam], beams.weight[beam]
        met = trail.first[beam] = trail.used[0]

        hit_leaf, hit_level = np.int64(NONE), np.int64(0)
        end_column, end_row = np.int64(NONE), np.int64(NONE)
        if beams.hit[beam]:
            end_column = beams.column[beam] + math.floor(x1)
            end_row = beams.row[beam] + math.floor(y1)
            hit_leaf, hit_level = find_leaf(first_child, table, coarsest, end_column, end_row)
            if hit_leaf < 0 or slots[hit_leaf] == NONE:
                hit_leaf = activate(
                    tree,
                    counters,
                    active,
                    table,
                    coarsest,
                    hit_leaf,
                    hit_level,
                    end_column,
                    end_row,
                )
        leaf, level = np.int64(NONE), np.int64(0)
        corner_column, corner_row = np.int64(NONE), np.int64(NONE)
        crossed = 0  # cells of the leaf the beam ends in, before its last
        for k in range(cells):
            column, row = columns[k], rows[k]
            if column >> level == corner_column and row >> level == corner_row:
                crossed += leaf == hit_leaf and not (column == end_column and row == end_row)
                continue
            if column == end_column and row == end_row:
                continue
            leaf, level = find_leaf(first_child, table, coarsest, column, row)
            corner_column, corner_row = column >> level, row >> level
            crossed += leaf == hit_leaf
            if leaf < 0 or slots[leaf] == NONE:
                leaf = activate(tree, counters, active, table, coarsest, leaf, level, column, row)
            slot = np.int64(slots[leaf])
            if leaf != hit_leaf and slot >= fresh:
                misses[slot] += weight
                if not per_scan:
                    evidence[slot] += weight * l_free
                elif stamp[slot] < 2 * sample:
                    evidence[slot] += weight * l_free
                    stamp[slot] = 2 * sample
                if level > finest:
                    met_slots[met] = slot
                    met += 1
        if hit_leaf >= 0 and slots[hit_leaf] >= fresh:
            way = min(1.0, crossed / (np.int64(1) << hit_level)) if way_to_hit else 0.0
            slot = np.int64(slots[hit_leaf])
            count_hit(active, slot, sample, weight, way, l_free, l_occ, per_scan)
            if hit_level > finest:
                met_slots[met] = slot
                met += 1
        trail.last[beam] = trail.used[0] = met
    return beams.end_x.size


@njit(cache=True, nogil=True)
def count_unknowns(tree, active, trail, table, coarsest, finest, beams, start, fresh):
    """Count, for each active leaf, the beams that ended before they reached it.

    A beam is followed behind its end to `beams.last_x`, `last_y`; leaves that nothing reached
    are not asked: no count of theirs deviates from "unknown". `start` and result as before.
    """
    first_child, slots, met_slots = tree.first_child, tree.slot, trail.slots
    unknowns = active.unknowns
    columns, rows = np.empty(0, np.int64), np.empty(0, np.int64)
    for beam in range(start, beams.end_x.size):
        if not trail.again[beam]:
            continue
        x0, y0 = beams.end_x[beam], beams.end_y[beam]
        x1, y1 = beams.last_x[beam], beams.last_y[beam]
        longest = np.int64(abs(x1 - x0) + abs(y1 - y0)) + 5
        if met_slots.size - trail.used[0] < longest:
            return beam
        if columns.size < longest:
            columns, rows = np.empty(2 * longest, np.int64), np.empty(2 * longest, np.int64)
        cells = trace_ray(beams.column[beam], beams.row[beam], x0, y0, x1, y1, columns, rows)
        column = beams.column[beam] + math.floor(x0)
        row = beams.row[beam] + math.floor(y0)
        hit_leaf, level = find_leaf(first_child, table, coarsest, column, row)
        corner_column, corner_row = column >> level, row >> level
        weight = beams.weight[beam]
        met = trail.first[beam] = trail.used[0]
        if level > finest and slots[hit_leaf] >= fresh:
            # Once it is split, what lies behind the end may be another leaf.
            met_slots[met] = slots[hit_leaf]
            met += 1
        for k in range(cells):
            column, row = columns[k], rows[k]
            if column >> level == corner_column and row >> level == corner_row:
                continue
            leaf, level = find_leaf(first_child, table, coarsest, column, row)
            corner_column, corner_row = column >> level, row >> level
            if leaf >= 0 and leaf != hit_leaf and slots[leaf] >= fresh:
                slot = np.int64(slots[leaf])
                unknowns[slot] += weight
                if level > finest:
                    met_slots[met] = slot
                    met += 1
        trail.last[beam] = trail.used[0] = met
    return beams.end_x.size


@njit(cache=True, nogil=True)
def mark_again(active, trail):
    """Keep for the next round the beams that met a leaf which was split since."""
    trail.used[0] = 0
    for beam in range(trail.again.size):
        if not trail.again[beam]:
            continue
        trail.again[beam] = 0
        for k in range(trail.first[beam], trail.last[beam]):
            if active.node[trail.slots[k]] < 0:
                trail.again[beam] = 1
                break


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

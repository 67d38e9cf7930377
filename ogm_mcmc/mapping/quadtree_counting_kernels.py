"""Kernels of the adaptive map ([pose] section VI): which beams hit, cross and miss which leaves.

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
from ogm_mcmc.mapping.quadtree_kernels import ACTIVE, NONE, ROWS, clear_row


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

"""Kernels that read a quadtree; `tree`, `table` and cells as in `quadtree_kernels`."""

import math

import numpy as np
from numba import njit

# Levels are at most 12, and three siblings of each may be waiting.
STACK = 40


@njit(cache=True, nogil=True)
def mean_below(tree, node):
    """Mean log-odds of the measured area of a node, nan where nothing was ever measured."""
    if tree.first_child[node] < 0:
        return tree.log_odds[node]
    waiting = np.empty(STACK, np.int32)
    waiting[0] = node
    count = 1
    total = area = 0.0
    while count > 0:
        count -= 1
        here = waiting[count]
        first = tree.first_child[here]
        if first >= 0:
            for child in range(first, first + 4):
                waiting[count] = child
                count += 1
        elif tree.log_odds[here] == tree.log_odds[here]:
            share = np.float64(np.int64(1) << (2 * np.int64(tree.level[here])))
            total += share * np.float64(tree.log_odds[here])
            area += share
    return np.float32(total / area) if area > 0.0 else np.float32(math.nan)


@njit(cache=True, nogil=True)
def fill_log_odds(tree, table, coarsest, output_level, column0, row0, out):
    """Write log-odds into a window of output cells, each 2**output_level cells wide.

    column0, row0  output cell of `out[0, 0]`, relative to that of cell (0, 0)
    out            (height, width) float32, output; nan where never measured
    Cost: one visit per node down to the output level, then one write per output cell.
    """
    height, width = out.shape
    shift = coarsest - output_level
    nodes, columns, rows = (
        np.empty(STACK, np.int32),
        np.empty(STACK, np.int64),
        np.empty(STACK, np.int64),
    )
    for tile_row in range(row0 >> shift, ((row0 + height - 1) >> shift) + 1):
        for tile_column in range(column0 >> shift, ((column0 + width - 1) >> shift) + 1):
            nodes[0] = table[tile_row, tile_column]
            columns[0], rows[0] = tile_column << shift, tile_row << shift
            count = 1 if nodes[0] >= 0 else 0
            while count > 0:
                count -= 1
                node, column, row = nodes[count], columns[count], rows[count]
                # Of a leaf below the output level only its ancestor is ever on the stack.
                level = np.int64(tree.level[node]) - output_level
                side = np.int64(1) << level
                left, right = max(column, column0), min(column + side, column0 + width)
                bottom, top = max(row, row0), min(row + side, row0 + height)
                if left >= right or bottom >= top:
                    continue
                if level > 0 and tree.first_child[node] >= 0:
                    half = side >> 1
                    for child in range(4):
                        nodes[count] = tree.first_child[node] + child
                        columns[count] = column + half * (child & 1)
                        rows[count] = row + half * (child >> 1)
                        count += 1
                    continue
                value = mean_below(tree, node)
                for r in range(bottom - row0, top - row0):
                    for c in range(left - column0, right - column0):
                        out[r, c] = value

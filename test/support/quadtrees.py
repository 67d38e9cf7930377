"""Steps, settings and a plain walk for tests of the adaptive map."""

import numpy as np

from ogm_mcmc.config import StepModelConfig

__all__ = ['L_FREE', 'L_OCC', 'NO_MERGING', 'STEP', 'leaves_of']

L_FREE, L_OCC = -0.75, 2.0  # exact in float32, and of different size
STEP = StepModelConfig(l_free=L_FREE, l_occ=L_OCC)
NO_MERGING = {'merge_free': 0.0, 'merge_occupied': 1.0, 'merge_spread': 0.0}


def leaves_of(method):
    """Every leaf in use as (level, column, row): (log-odds, hits, misses), by a plain walk."""
    tree, found = method.tree, {}

    def visit(node, level, column, row):
        first = int(tree.tree.first_child[node])
        assert tree.tree.level[node] == level
        if first < 0:
            row_of = tree.tree
            found[level, column, row] = (
                float(row_of.log_odds[node]),
                float(row_of.hits[node]),
                float(row_of.misses[node]),
            )
            return
        for child in range(4):
            assert tree.tree.parent[first + child] == node
            visit(first + child, level - 1, 2 * column + child % 2, 2 * row + child // 2)

    for (row, column), node in np.ndenumerate(tree.table):
        if node >= 0:
            assert tree.tree.parent[node] == -1
            visit(node, tree.coarsest, tree.tile_column0 + column, tree.tile_row0 + row)
    return found

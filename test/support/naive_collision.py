"""Collisions by plain geometry, one sample, one cell and one piece of way at a time."""

import math
from itertools import pairwise

__all__ = ['met', 'risk_by_cells']


def _to_square(x, y, column, row):
    return math.hypot(max(column - x, x - column - 1, 0), max(row - y, y - row - 1, 0))


def _to_segment(x, y, a, b):
    length2 = (b[0] - a[0]) ** 2 + (b[1] - a[1]) ** 2
    part = 0.0
    if length2 > 0.0:
        part = ((x - a[0]) * (b[0] - a[0]) + (y - a[1]) * (b[1] - a[1])) / length2
    part = min(max(part, 0.0), 1.0)
    return math.hypot(a[0] + part * (b[0] - a[0]) - x, a[1] + part * (b[1] - a[1]) - y)


def _crosses(a, b, column, row):
    """Whether the segment has a point in the square: its part between all four sides is left."""
    first, last = 0.0, 1.0
    for start, end, low in ((a[0], b[0], column), (a[1], b[1], row)):
        step = end - start
        if step == 0.0:
            if not low <= start <= low + 1:
                return False
            continue
        parts = sorted(((low - start) / step, (low + 1 - start) / step))
        first, last = max(first, parts[0]), min(last, parts[1])
    return first <= last


def _distance(a, b, column, row):
    """From the segment a-b to a square cell: at a corner or an end, unless one crosses."""
    if _crosses(a, b, column, row):
        return 0.0
    corners = [(column + i, row + j) for i in (0, 1) for j in (0, 1)]
    ends = [_to_square(*a, column, row), _to_square(*b, column, row)]
    return min(ends + [_to_segment(*corner, a, b) for corner in corners])


def met(a, b, radius, shape, around=12):
    """Cells (row, column) that a disc meets from a to b, also outside of the map."""
    rows, columns = range(-around, shape[0] + around), range(-around, shape[1] + around)
    return [(j, i) for j in rows for i in columns if _distance(a, b, i, j) <= radius]


def risk_by_cells(maps, known, places, radius, p_unknown, p_behind, lump):
    """Probability of a collision at each place and on the way; lengths and areas in cells.

    Each `lump` unknown cells are a chance of p_unknown, on a way those that come new with a piece;
    so is an unknown disc, if that is smaller. At a place it is p_behind in maps that block the way
    before it.
    """

    def sampled(cells):
        inside = [(j, i) for j, i in cells if 0 <= j < known.shape[0] and 0 <= i < known.shape[1]]
        return [cell for cell in inside if known[cell]]

    def unknown(cells):
        return len(cells) - len(sampled(cells))

    def one(cells, before, chances):
        here, behind = sampled(cells), sampled(before)
        met_in = [
            1.0
            if any(m[c] for c in here)
            else 1.0 - (1.0 - (p_behind if any(m[c] for c in behind) else p_unknown)) ** chances
            for m in maps
        ]
        return sum(met_in) / len(maps)

    points = [met(place, place, radius, known.shape) for place in places]
    pieces = [met(a, b, radius, known.shape) for a, b in pairwise(places)]
    gone = [points[:i] + pieces[:i] for i in range(len(points))]
    before = [[cell for cells in some for cell in cells] for some in gone]
    way = sorted({cell for cells in points + pieces for cell in cells})
    new = [unknown(piece) - unknown(at) for at, piece in zip(points, pieces, strict=False)]
    chances = [unknown(cells) / min(lump, len(cells)) for cells in points]
    whole = max(*chances, (unknown(points[0]) + sum(new)) / lump)
    at = [one(*asked) for asked in zip(points, before, chances, strict=True)]
    return [*at, one(way, [], whole)]

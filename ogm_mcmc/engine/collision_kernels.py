"""Which map samples have an occupied cell within a radius of a straight piece of way."""

import math

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def reach(ax, ay, bx, by, radius, low, high, span):
    """Least and largest x of a capsule between y = low and y = high, into span (2,) float64.

    The capsule is what a disc covers that moves from a to b; inf, -inf where it is not there.
    It is convex, so that the cells it touches in a row are all those between the two.
    """
    span[0], span[1] = math.inf, -math.inf
    for end in range(2):
        x, y = (ax, ay) if end == 0 else (bx, by)
        gap = max(low - y, y - high, 0.0)
        if gap <= radius:
            half = math.sqrt(radius * radius - gap * gap)
            span[0], span[1] = min(span[0], x - half), max(span[1], x + half)
    length = math.hypot(bx - ax, by - ay)
    if length == 0.0:
        return
    for side in range(-1, 2, 2):
        shift_x, shift_y = -side * radius * (by - ay) / length, side * radius * (bx - ax) / length
        x0, y0, x1, y1 = ax + shift_x, ay + shift_y, bx + shift_x, by + shift_y
        if y0 > y1:
            x0, y0, x1, y1 = x1, y1, x0, y0
        if y1 < low or y0 > high:
            continue
        first, last = 0.0, 1.0
        if y1 > y0:
            first, last = max(0.0, (low - y0) / (y1 - y0)), min(1.0, (high - y0) / (y1 - y0))
        for part in (first, last):
            x = x0 + part * (x1 - x0)
            span[0], span[1] = min(span[0], x), max(span[1], x)


@njit(cache=True, nogil=True)
def add_blocked(words, known, ax, ay, bx, by, radius, blocked):
    """Set the bits of the samples that block the way from a to b; return if it is not all known.

    words    (height, width, L) uint64, bit s % 64 of word s // 64: occupied in sample s
    known    (height, width) bool; every cell outside is unknown
    ax..by   both ends, in cells from the lower left corner of the map; radius, cells
    blocked  (L,) uint64, output: bits are added
    """
    height, width, n_words = words.shape
    span = np.empty(2)
    unknown = False
    bottom = math.floor(min(ay, by) - radius)
    top = math.floor(max(ay, by) + radius)
    if bottom < 0 or top >= height:
        unknown = True
        bottom, top = max(bottom, 0), min(top, height - 1)
    for row in range(bottom, top + 1):
        reach(ax, ay, bx, by, radius, float(row), row + 1.0, span)
        if span[0] > span[1]:
            continue
        first, last = math.floor(span[0]), math.floor(span[1])
        if first < 0 or last >= width:
            unknown = True
            first, last = max(first, 0), min(last, width - 1)
        for column in range(first, last + 1):
            if known[row, column]:
                for k in range(n_words):
                    blocked[k] |= words[row, column, k]
            else:
                unknown = True
    return unknown


@njit(cache=True, nogil=True)
def share_blocked(blocked, count, unknown, p_unknown):
    """Return the share of `count` samples that are blocked; others with p_unknown if `unknown`."""
    hits = 0
    for word in blocked:
        while word != np.uint64(0):
            word &= word - np.uint64(1)
            hits += 1
    share = hits / count
    if unknown:
        share += p_unknown * (1.0 - share)
    return share


@njit(cache=True, nogil=True)
def way_risk(words, known, count, places, radius, p_unknown, risk):
    """Probability of a collision at each place and, last, on the whole way through them.

    words, known, radius  as for `add_blocked`; count: how many samples there are
    places  (N, 2) float64, in cells from the lower left corner of the map
    risk    (N + 1,) float64, output
    """
    n = places.shape[0]
    whole = np.zeros(words.shape[2], np.uint64)
    at = np.empty(words.shape[2], np.uint64)
    somewhere_unknown = False
    for i in range(n):
        x, y = places[i, 0], places[i, 1]
        at[:] = np.uint64(0)
        unknown = add_blocked(words, known, x, y, x, y, radius, at)
        risk[i] = share_blocked(at, count, unknown, p_unknown)
        whole |= at
        if i > 0:
            x0, y0 = places[i - 1, 0], places[i - 1, 1]
            unknown |= add_blocked(words, known, x0, y0, x, y, radius, whole)
        somewhere_unknown |= unknown
    risk[n] = share_blocked(whole, count, somewhere_unknown, p_unknown)

"""Which map samples have an occupied cell within a radius of a straight piece of way."""

import math

import numpy as np
from numba import njit

# Rows beyond the map that are looked at; their unknown cells are more than enough.
FAR = 2000


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
    """Set the bits of samples that block the way from a to b; return its unknown cells and all.

    words    (height, width, L) uint64, bit s % 64 of word s // 64: occupied in sample s
    known    (height, width) bool; every cell outside is unknown
    ax..by   both ends, in cells from the lower left corner of the map; radius, cells: numbers that
             fit an integer of 64 bits
    blocked  (L,) uint64, output: bits are added
    Far outside of the map no more than FAR rows are counted: a way cannot take forever.
    """
    height, width, n_words = words.shape
    span = np.empty(2)
    unknown, total = 0.0, 0.0
    bottom = math.floor(min(ay, by) - radius)
    top = math.floor(max(ay, by) + radius)
    bottom, top = max(bottom, min(top, 0) - FAR), min(top, max(bottom, height - 1) + FAR)
    for row in range(bottom, top + 1):
        reach(ax, ay, bx, by, radius, float(row), row + 1.0, span)
        if span[0] > span[1]:
            continue
        first, last = math.floor(span[0]), math.floor(span[1])
        total += last - first + 1.0
        unknown += last - first + 1.0
        if row < 0 or row >= height:
            continue
        for column in range(max(first, 0), min(last, width - 1) + 1):
            if known[row, column]:
                unknown -= 1.0
                for k in range(n_words):
                    blocked[k] |= words[row, column, k]
    return unknown, total


@njit(cache=True, nogil=True)
def bits_in(words):
    """How many bits are set."""
    count = 0
    for word in words:
        while word != np.uint64(0):
            word &= word - np.uint64(1)
            count += 1
    return count


@njit(cache=True, nogil=True)
def built_up(words, known, side):
    """Tiles of side x side cells with something occupied, a mean over samples, and all tiles.

    Tiles that are known for the most part count, by their known cells: words and known as for
    `add_blocked`. The first is a sum over samples, not yet divided by their number.
    """
    height, width, n_words = words.shape
    there = np.empty(n_words, np.uint64)
    occupied, tiles = 0, 0
    for bottom in range(0, height, side):
        for left in range(0, width, side):
            there[:] = np.uint64(0)
            seen = 0
            for row in range(bottom, min(bottom + side, height)):
                for column in range(left, min(left + side, width)):
                    if known[row, column]:
                        seen += 1
                        for k in range(n_words):
                            there[k] |= words[row, column, k]
            if 2 * seen > side * side:
                tiles += 1
                occupied += bits_in(there)
    return occupied, tiles


@njit(cache=True, nogil=True)
def share_blocked(blocked, before, count, p_unknown, p_behind, chances):
    """How likely it is blocked: in a share of `count` samples, or by chances of p_unknown each.

    In samples that were blocked `before` these are chances of p_behind.
    """
    clear = 1.0 - bits_in(blocked) / count
    if chances > 0.0:
        behind = bits_in(before & ~blocked) / count
        clear = (clear - behind) * (1.0 - p_unknown) ** chances + behind * (
            1.0 - p_behind
        ) ** chances
    return 1.0 - clear


@njit(cache=True, nogil=True)
def way_risk(words, known, count, places, radius, p_unknown, p_behind, lump, risk):
    """Probability of a collision at each place and, last, on the whole way through them.

    words, known, radius  as for `add_blocked`; count: how many samples there are
    places    (N, 2) float64, in cells from the lower left corner of the map
    p_behind  as p_unknown, in samples that block the way to a place before it
    lump      so many unknown cells are one chance of p_unknown; so is an unknown disc, if smaller
    risk      (N + 1,) float64, output
    Unknown cells of a piece of way that the disc covers where the piece begins were counted
    before it; those that a way comes back to later count again.
    """
    n = places.shape[0]
    whole = np.zeros(words.shape[2], np.uint64)
    at = np.empty(words.shape[2], np.uint64)
    unknown, disc_before, most = 0.0, 0.0, 0.0
    for i in range(n):
        x, y = places[i, 0], places[i, 1]
        if i > 0:
            x0, y0 = places[i - 1, 0], places[i - 1, 1]
            unknown += add_blocked(words, known, x0, y0, x, y, radius, whole)[0] - disc_before
        at[:] = np.uint64(0)
        here, disc = add_blocked(words, known, x, y, x, y, radius, at)
        if i == 0:
            unknown = here
        chances = here / min(lump, max(disc, 1.0))
        most = max(most, chances)
        risk[i] = share_blocked(at, whole, count, p_unknown, p_behind, chances)
        whole |= at
        disc_before = here
    chances = max(most, unknown / lump)
    risk[n] = share_blocked(whole, whole, count, p_unknown, p_behind, chances)

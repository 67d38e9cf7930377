"""Beams, seen cells and ways through a grid of occupied cells; coordinates in cells."""

import math

import numpy as np
from numba import njit

from ogm_mcmc.geometry.walk_kernels import begin_walk, next_cell

UNKNOWN, FREE, OCCUPIED = 0, 1, 2


@njit(cache=True, nogil=True)
def first_occupied(occupied, x, y, directions, reach, entered, left):
    """Find the first occupied cell along every ray; returns the number of cells walked through.

    occupied    (height, width) uint8; the sensor at (x, y) lies inside
    directions  (2, B) unit vectors; cells entered beyond `reach` are not looked at
    entered, left  (B,) float64, output: where the ray enters and leaves that cell; inf if none
    """
    height, width = occupied.shape
    walked = 0
    for ray in range(directions.shape[1]):
        next_x, next_y, inverse_x, inverse_y, step_x, step_y = begin_walk(
            x, y, directions[0, ray], directions[1, ray]
        )
        at_x, at_y = (next_x - x) * inverse_x, (next_y - y) * inverse_y
        column, row = math.floor(x), math.floor(y)
        here = 0.0
        entered[ray] = math.inf
        left[ray] = math.inf
        while here <= reach and 0 <= column < width and 0 <= row < height:
            walked += 1
            if occupied[row, column]:
                entered[ray] = here
                left[ray] = min(at_x, at_y)
                break
            here = min(at_x, at_y)
            column, row, next_x, next_y, at_x, at_y = next_cell(
                x, y, inverse_x, inverse_y, step_x, step_y, column, row, next_x, next_y, at_x, at_y
            )
    return walked


@njit(cache=True, nogil=True)
def look_around(occupied, x, y, directions, reach, known):
    """Mark what an ideal sensor sees; returns the number of cells it had not known before.

    known  (height, width) uint8, updated: UNKNOWN, FREE or OCCUPIED
    """
    height, width = occupied.shape
    discovered = 0
    for ray in range(directions.shape[1]):
        next_x, next_y, inverse_x, inverse_y, step_x, step_y = begin_walk(
            x, y, directions[0, ray], directions[1, ray]
        )
        at_x, at_y = (next_x - x) * inverse_x, (next_y - y) * inverse_y
        column, row = math.floor(x), math.floor(y)
        here = 0.0
        while here <= reach and 0 <= column < width and 0 <= row < height:
            if known[row, column] == UNKNOWN:
                discovered += 1
                known[row, column] = OCCUPIED if occupied[row, column] else FREE
            if occupied[row, column]:
                break
            here = min(at_x, at_y)
            column, row, next_x, next_y, at_x, at_y = next_cell(
                x, y, inverse_x, inverse_y, step_x, step_y, column, row, next_x, next_y, at_x, at_y
            )
    return discovered


@njit(cache=True, nogil=True)
def keep_clear(occupied, radius, blocked):
    """Mark the cells whose centres are within `radius` cells of an occupied one's, or occupied.

    occupied, blocked  (height, width) uint8; blocked is output
    """
    height, width = occupied.shape
    whole = math.floor(radius)
    for row in range(height):
        for column in range(width):
            blocked[row, column] = occupied[row, column]
    for row in range(height):
        for column in range(width):
            # Only the rim of what is occupied can reach further than itself.
            if not occupied[row, column] or (
                0 < row < height - 1
                and 0 < column < width - 1
                and occupied[row - 1, column]
                and occupied[row + 1, column]
                and occupied[row, column - 1]
                and occupied[row, column + 1]
            ):
                continue
            for j in range(max(0, row - whole), min(height, row + whole + 1)):
                for i in range(max(0, column - whole), min(width, column + whole + 1)):
                    if (i - column) ** 2 + (j - row) ** 2 <= radius * radius:
                        blocked[j, i] = 1


@njit(cache=True, nogil=True)
def walk_distances(passable, column, row, distances, queue):
    """Steps from a cell to every other over passable cells, side by side; -1: no way.

    passable   (height, width) bool or uint8; the first cell need not be passable
    distances  (height, width) int32, output
    queue      (height * width,) int32, scratch
    Returns the number of cells reached.
    """
    height, width = passable.shape
    distances[:] = -1
    distances[row, column] = 0
    queue[0] = row * width + column
    first, last = 0, 1
    while first < last:
        cell = queue[first]
        first += 1
        j, i = cell // width, cell % width
        further = distances[j, i] + 1
        for k in range(4):
            b = j + (k == 0) - (k == 1)
            a = i + (k == 2) - (k == 3)
            if 0 <= a < width and 0 <= b < height and distances[b, a] < 0 and passable[b, a]:
                distances[b, a] = further
                queue[last] = b * width + a
                last += 1
    return last


@njit(cache=True, nogil=True)
def find_frontiers(known, given_up, frontier):
    """Mark free cells beside an unknown one that were not given up; returns their number."""
    height, width = known.shape
    count = 0
    for row in range(height):
        for column in range(width):
            edge = False
            if known[row, column] == FREE and not given_up[row, column]:
                edge = (
                    (row > 0 and known[row - 1, column] == UNKNOWN)
                    or (row + 1 < height and known[row + 1, column] == UNKNOWN)
                    or (column > 0 and known[row, column - 1] == UNKNOWN)
                    or (column + 1 < width and known[row, column + 1] == UNKNOWN)
                )
            frontier[row, column] = edge
            count += edge
    return count


@njit(cache=True, nogil=True)
def reach_out(known, distances, furthest, origins, queue):
    """Find from which reached cell each free one is near, without a wall between.

    distances  (height, width) int32, -1 where the robot cannot stand
    origins    (height, width) int32, output: flat index of the reached cell that is at most
               `furthest` steps over free cells away, -1 if there is none
    queue      (height * width,) int32, scratch
    """
    height, width = known.shape
    last = 0
    for row in range(height):
        for column in range(width):
            origins[row, column] = -1
            if distances[row, column] >= 0:
                origins[row, column] = row * width + column
                queue[last] = row * width + column
                last += 1
    first = 0
    for _ in range(furthest):
        level = last
        while first < level:
            j, i = queue[first] // width, queue[first] % width
            first += 1
            for k in range(4):
                b = j + (k == 0) - (k == 1)
                a = i + (k == 2) - (k == 3)
                inside = 0 <= a < width and 0 <= b < height
                if inside and origins[b, a] < 0 and known[b, a] == FREE:
                    origins[b, a] = origins[j, i]
                    queue[last] = b * width + a
                    last += 1


@njit(cache=True, nogil=True)
def best_frontier(frontier, distances, origins, smallest, patience, labels, queue, best):
    """Choose the group of frontier cells most worth going to; returns its label, 0 if none.

    Groups are connected side by side or corner to corner. The worth of a group is its size over
    `patience` plus the steps to the nearest of the cells it can be looked at from.
    frontier   (height, width) uint8; distances (height, width) int32, -1 where not reached
    origins    (height, width) int32, see `reach_out`
    labels     (height, width) int32, output: the group of each frontier cell, from 1 on
    queue      (height * width,) int32, scratch
    best       (2,) int64, output: column and row to go to
    """
    height, width = frontier.shape
    labels[:] = 0
    label, chosen, highest = 0, 0, -1.0
    for row in range(height):
        for column in range(width):
            if not frontier[row, column] or labels[row, column]:
                continue
            label += 1
            labels[row, column] = label
            queue[0] = row * width + column
            first, last = 0, 1
            while first < last:
                j, i = queue[first] // width, queue[first] % width
                first += 1
                for b in range(max(0, j - 1), min(height, j + 2)):
                    for a in range(max(0, i - 1), min(width, i + 2)):
                        if frontier[b, a] and not labels[b, a]:
                            labels[b, a] = label
                            queue[last] = b * width + a
                            last += 1
            if last < smallest:
                continue
            nearest, at_column, at_row = np.int32(2**30), 0, 0
            for k in range(last):
                origin = origins[queue[k] // width, queue[k] % width]
                if origin >= 0 and distances[origin // width, origin % width] < nearest:
                    at_column, at_row = origin % width, origin // width
                    nearest = distances[at_row, at_column]
            if nearest == 2**30:
                continue
            worth = last / (patience + nearest)
            if worth > highest:
                highest, chosen = worth, label
                best[0] = at_column
                best[1] = at_row
    return chosen


@njit(cache=True, nogil=True)
def walk_back(distances, column, row, columns, rows):
    """List the cells of a shortest way from the start to a reached cell; returns their number."""
    height, width = distances.shape
    count = distances[row, column] + 1
    for k in range(count - 1, -1, -1):
        columns[k] = column
        rows[k] = row
        for direction in range(4):
            b = row + (direction == 0) - (direction == 1)
            a = column + (direction == 2) - (direction == 3)
            if 0 <= a < width and 0 <= b < height and distances[b, a] == k - 1 and k > 0:
                column, row = a, b
                break
    return count

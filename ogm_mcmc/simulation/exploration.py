"""A robot that explores until everything is covered and scans only when it stands.

"A simple exploration algorithm was used to ensure coverage for each of the datasets. The robot
only mapped the environment when stopped" ([gibbs] section IV-B). It goes to where known free
cells border on unknown ones (a frontier): of the connected groups of such cells to the one with
most cells for the way there. It knows what an ideal sensor of the same reach, with a beam
for every cell at that distance, sees from its stops; the lidar that measures may be sparser.
What is within its own radius it notices by touch: its ways keep clear of walls it has not seen.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import AnyArray, BoolArray, Float64Array
from ogm_mcmc.errors import ConfigError, require
from ogm_mcmc.geometry import Pose2D
from ogm_mcmc.simulation.grid_world import GridWorld
from ogm_mcmc.simulation.raster_kernels import (
    FREE,
    UNKNOWN,
    best_frontier,
    find_frontiers,
    keep_clear,
    look_around,
    reach_out,
    walk_back,
    walk_distances,
)

__all__ = ['Choice', 'Exploration', 'Stop', 'explore']

# Cells, beside twice the robot's radius.
GIVEN_UP_AROUND = 8


@dataclass(frozen=True)
class Exploration:
    """How a robot explores; lengths in cells.

    `smallest` groups of frontier cells are not worth a stop; `patience` is how many steps of way
    a group of its size is worth; the robot stops after `max_stops`, and if everything was covered
    before `min_stops` it goes on from one place to another at random.
    """

    reach: float = 75.0
    radius: float = 2.5
    smallest: int = 12
    patience: float = 20.0
    min_stops: int = 0
    max_stops: int = 1000

    def __post_init__(self) -> None:
        """Refuse what no robot can do."""
        require(1.0 <= self.reach < 1e5, 'reach', self.reach, 'expected 1 to 100000 cells')
        require(0.0 <= self.radius <= 100.0, 'radius', self.radius, 'expected 0 to 100 cells')
        require(self.smallest >= 1, 'smallest', self.smallest, 'expected at least 1 cell')
        require(self.patience > 0.0, 'patience', self.patience, 'must be positive')
        require(self.min_stops >= 0, 'min_stops', self.min_stops, 'expected 0 or more')
        valid = self.max_stops >= max(1, self.min_stops)
        require(valid, 'max_stops', self.max_stops, 'expected at least 1 and min_stops')


class Stop(NamedTuple):
    """A pose to scan from and the cells (n, 2), column and row, of the way there."""

    pose: Pose2D
    way: AnyArray


Choice = Callable[[AnyArray], tuple[int, int] | None]
"""Where to go, given the steps (height, width) to each cell, -1: out of reach; None: nowhere."""


class _Knowledge:
    """What the robot knows of a world, and scratch memory for its plans."""

    def __init__(self, world: GridWorld, settings: Exploration) -> None:
        shape = world.occupied.shape
        self.world, self.settings = world, settings
        self.known = np.full(shape, UNKNOWN, np.uint8)
        self.blocked = np.empty(shape, np.uint8)
        keep_clear(world.occupied, settings.radius, self.blocked)
        self.given_up = np.zeros(shape, np.bool_)
        self.distances = np.empty(shape, np.int32)
        self._frontier = np.empty(shape, np.uint8)
        self._origins = np.empty(shape, np.int32)
        self._labels = np.empty(shape, np.int32)
        self._queue = np.empty(world.occupied.size, np.int32)
        beams = math.ceil(2.0 * math.pi * settings.reach * 1.5)
        angles = np.arange(beams) * (2.0 * math.pi / beams)
        self._directions: Float64Array = np.stack((np.cos(angles), np.sin(angles)))

    def look(self, x: float, y: float) -> int:
        """See what can be seen from a place, cells; return how many cells were new."""
        return int(
            look_around(
                self.world.occupied, x, y, self._directions, self.settings.reach, self.known
            )
        )

    def find_ways(self, column: int, row: int) -> None:
        """Find the way to every cell that is in reach from here."""
        room = (self.known == FREE) & (self.blocked == 0)
        walk_distances(room, column, row, self.distances, self._queue)

    def next_goal(self, column: int, row: int) -> tuple[int, int] | None:
        """Return the cell to go to from here, None when nothing is left.

        The frontier around it is given up: what cannot be seen from there never will be, as
        slits between furniture. So every stop comes nearer to an end.
        """
        self.find_ways(column, row)
        nearby = 2 * math.ceil(self.settings.radius) + 2
        reach_out(self.known, self.distances, nearby, self._origins, self._queue)
        find_frontiers(self.known, self.given_up, self._frontier)
        best = np.zeros(2, np.int64)
        label = best_frontier(
            self._frontier,
            self.distances,
            self._origins,
            self.settings.smallest,
            self.settings.patience,
            self._labels,
            self._queue,
            best,
        )
        if label == 0:
            return None
        around = nearby + GIVEN_UP_AROUND
        rows = slice(max(0, int(best[1]) - around), int(best[1]) + around + 1)
        columns = slice(max(0, int(best[0]) - around), int(best[0]) + around + 1)
        self.given_up[rows, columns] |= self._labels[rows, columns] == label
        return int(best[0]), int(best[1])

    def somewhere(self, column: int, row: int, rng: np.random.Generator) -> tuple[int, int]:
        """Return a reachable cell at random."""
        self.find_ways(column, row)
        reached = np.flatnonzero(self.distances >= 0)
        chosen = int(rng.choice(reached))
        row_of, column_of = divmod(chosen, self.world.spec.width)
        return column_of, row_of

    def way_to(self, goal: tuple[int, int]) -> AnyArray:
        """Return the cells (n, 2) of a shortest way to a goal chosen just before."""
        steps = int(self.distances[goal[1], goal[0]]) + 1
        columns, rows = np.empty(steps, np.int64), np.empty(steps, np.int64)
        walk_back(self.distances, goal[0], goal[1], columns, rows)
        return np.stack((columns, rows), axis=1)


def explore(
    world: GridWorld,
    settings: Exploration,
    rng: np.random.Generator,
    start: tuple[int, int] | None = None,
    choose: Choice | None = None,
) -> Iterator[Stop]:
    """Yield stop after stop, each at a random point of its cell and with a random heading.

    Starts at a cell (column, row) or at a random one with room for the robot. Raises ConfigError
    where there is none. `choose` takes the place of frontiers: it is asked for a cell in reach
    when the next stop is wanted, so whoever takes the stops can map what was seen from them.
    """
    knowledge = _Knowledge(world, settings)
    column, row = start if start is not None else _random_start(world, settings.radius, rng)
    inside = 0 <= column < world.spec.width and 0 <= row < world.spec.height
    require(inside, 'start', (column, row), 'expected a cell of the world')
    require(not world.occupied[row, column], 'start', (column, row), 'expected a free cell')
    way = np.array([[column, row]])
    for stop in range(settings.max_stops):
        x, y = column + rng.uniform(0.05, 0.95), row + rng.uniform(0.05, 0.95)
        knowledge.look(x, y)
        yield Stop(_pose_at(world, x, y, float(rng.uniform(-math.pi, math.pi))), way)
        if choose is None:
            goal = knowledge.next_goal(column, row)
        else:
            knowledge.find_ways(column, row)
            goal = choose(knowledge.distances)
        if goal is None:
            if stop + 1 >= settings.min_stops:
                return
            goal = knowledge.somewhere(column, row, rng)
        way = knowledge.way_to(goal)
        column, row = goal


def seen_from(world: GridWorld, settings: Exploration, places: Float64Array) -> BoolArray:
    """Return which free cells (height, width) can be seen from places (N, 2): x, y in cells."""
    knowledge = _Knowledge(world, settings)
    for x, y in places:
        knowledge.look(x, y)
    seen: BoolArray = knowledge.known == FREE
    return seen


def _pose_at(world: GridWorld, x: float, y: float, yaw: float) -> Pose2D:
    spec = world.spec
    return Pose2D(
        spec.origin_x_m + x * spec.resolution_m, spec.origin_y_m + y * spec.resolution_m, yaw
    )


def _random_start(world: GridWorld, radius: float, rng: np.random.Generator) -> tuple[int, int]:
    """Return a cell with room for the robot, in the largest space a robot can move in."""
    blocked = np.empty(world.occupied.shape, np.uint8)
    keep_clear(world.occupied, radius, blocked)
    roomy = np.flatnonzero(blocked == 0)
    if roomy.size == 0:
        raise ConfigError(
            f'world of {world.spec.width} x {world.spec.height} cells: expected a free place '
            f'with {radius * world.spec.resolution_m:g} m of room for the robot'
        )
    distances = np.empty(world.occupied.shape, np.int32)
    queue = np.empty(world.occupied.size, np.int32)
    best, most = 0, 0
    # A few tries find the largest space almost surely, and any space will do.
    for cell in rng.choice(roomy, 5):
        column, row = int(cell) % world.spec.width, int(cell) // world.spec.width
        reached = walk_distances(blocked == 0, column, row, distances, queue)
        if reached > most:
            best, most = int(cell), reached
    return best % world.spec.width, best // world.spec.width

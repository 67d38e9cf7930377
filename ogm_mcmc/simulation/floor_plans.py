"""Ten generated buildings of 500 x 500 cells, from cluttered offices to sparse halls.

A floor is a convex outline that is cut in two again and again, at angles that are rarely quite
straight, until rooms are small enough; every cut is a wall of its own thickness with doors in
it. Some rooms are locked. Then come pillars and furniture, at any angle. Whatever cannot be
reached from the largest open space is solid, as is everything outside: a robot cannot know
otherwise.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import BoolArray, Float64Array, UInt8Array
from ogm_mcmc.errors import require
from ogm_mcmc.geometry import GridSpec
from ogm_mcmc.simulation.drawing import Canvas
from ogm_mcmc.simulation.grid_world import GridWorld
from ogm_mcmc.simulation.raster_kernels import keep_clear, walk_distances

__all__ = ['FLOOR_PLANS', 'FloorPlan', 'generate_floor']

SIDE = 500
RESOLUTION_M = 0.1
MARGIN = 8.0
DOOR_CLEARANCE = 5.0
DOORWAY_AREA = 400
ROBOT_RADIUS = 3.0


class FloorPlan(NamedTuple):
    """How a building is made; lengths in cells, `clutter` in pieces per 1000 free cells.

    `locked` is the share of rooms that nobody gets into.
    """

    room_area: float
    clutter: float
    locked: float
    pillar_spacing: float
    walls: tuple[float, float]
    doors: tuple[float, float]
    tilt_rad: float
    cut_corner: float


# From cluttered offices to sparse halls.
FLOOR_PLANS: tuple[FloorPlan, ...] = (
    FloorPlan(4_000, 3.0, 0.2, 0.0, (2.0, 4.0), (9.0, 12.0), 0.05, 0.0),
    FloorPlan(5_500, 2.6, 0.2, 0.0, (2.0, 5.0), (9.0, 14.0), 0.12, 90.0),
    FloorPlan(7_000, 2.3, 0.2, 0.0, (2.0, 4.0), (10.0, 14.0), 0.20, 0.0),
    FloorPlan(9_000, 2.0, 0.2, 60.0, (3.0, 6.0), (10.0, 16.0), 0.08, 130.0),
    FloorPlan(12_000, 1.8, 0.15, 0.0, (2.0, 6.0), (12.0, 18.0), 0.30, 0.0),
    FloorPlan(16_000, 1.5, 0.15, 50.0, (3.0, 6.0), (12.0, 20.0), 0.15, 160.0),
    FloorPlan(24_000, 1.2, 0.15, 55.0, (3.0, 7.0), (14.0, 24.0), 0.10, 0.0),
    FloorPlan(40_000, 0.8, 0.1, 60.0, (4.0, 8.0), (16.0, 28.0), 0.25, 120.0),
    FloorPlan(70_000, 0.5, 0.0, 70.0, (4.0, 8.0), (20.0, 36.0), 0.10, 180.0),
    FloorPlan(130_000, 0.3, 0.0, 75.0, (5.0, 9.0), (24.0, 40.0), 0.35, 60.0),
)


def generate_floor(number: int, seed: int = 0) -> GridWorld:
    """Return building 1 to 10; another seed gives another building of the same kind."""
    count = len(FLOOR_PLANS)
    require(1 <= number <= count, 'building', number, f'expected 1 to {count}')
    plan = FLOOR_PLANS[number - 1]
    rng = np.random.default_rng((seed, number))
    outline = _outline(plan, rng)
    walls, doorways = Canvas(SIDE, SIDE), Canvas(SIDE, SIDE)
    rooms = _cut(outline, plan, rng, walls, doorways)
    thickness = rng.uniform(*plan.walls)
    for start, end in zip(outline, np.roll(outline, -1, axis=0), strict=True):
        walls.stroke(start, end, 2.0 * thickness)
    inside = Canvas(SIDE, SIDE).polygon(outline).cells
    solid = (walls.cells & ~doorways.cells) | ~inside
    solid = _with_locked_rooms(rooms, plan.locked, rng, solid)
    kept_clear = doorways.grown(DOOR_CLEARANCE)
    for room in rooms:
        solid |= _furnished(room, plan, rng, solid, kept_clear)
    return GridWorld.checked(GridSpec(RESOLUTION_M, SIDE, SIDE), _reachable_only(solid))


def _outline(plan: FloorPlan, rng: np.random.Generator) -> Float64Array:
    """Corners (V, 2) counter-clockwise: a quadrangle, not quite straight, corners cut off."""
    low, high = MARGIN, SIDE - MARGIN
    corners = np.array([(low, low), (high, low), (high, high), (low, high)])
    pull = rng.uniform(0.0, 25.0, (4, 2)) * np.where(corners > SIDE / 2, -1.0, 1.0)
    corners = corners + pull
    if plan.cut_corner > 0.0:
        which = int(rng.integers(4))
        corner = corners[which]
        ways = [corners[(which + turn) % 4] - corner for turn in (-1, 1)]
        cut = [corner + plan.cut_corner * way / math.hypot(*way) for way in ways]
        corners = np.concatenate((corners[:which], np.array(cut), corners[which + 1 :]))
    return np.asarray(corners, np.float64)


def _area(polygon: Float64Array) -> float:
    x, y = polygon.T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


def _cut(
    polygon: Float64Array,
    plan: FloorPlan,
    rng: np.random.Generator,
    walls: Canvas,
    doorways: Canvas,
) -> list[Float64Array]:
    """Draw the walls inside a convex polygon; return the rooms between them."""
    if _area(polygon) < plan.room_area * rng.uniform(0.8, 1.6):
        return [polygon]
    extent = np.ptp(polygon, axis=0)
    across_x = extent[0] * rng.uniform(0.8, 1.25) > extent[1]
    angle = (math.pi / 2.0 if across_x else 0.0) + plan.tilt_rad * rng.standard_normal()
    share = rng.uniform(0.35, 0.65)
    middle = polygon.min(axis=0) + extent * (
        share if across_x else 0.5,
        0.5 if across_x else share,
    )
    normal = np.array([-math.sin(angle), math.cos(angle)])
    offsets = (polygon - middle) @ normal
    crossing: list[Float64Array] = []
    parts: tuple[list[Float64Array], list[Float64Array]] = ([], [])
    for index, corner in enumerate(polygon):
        following = (index + 1) % len(polygon)
        here, there = offsets[index], offsets[following]
        parts[int(here > 0.0)].append(corner)
        if (here > 0.0) != (there > 0.0):
            point = corner + here / (here - there) * (polygon[following] - corner)
            crossing.append(point)
            parts[0].append(point)
            parts[1].append(point)
    length = math.dist(*crossing)
    door = rng.uniform(*plan.doors)
    # A wall without room for a door would close a room for ever.
    if length < 2.0 * door + 10.0:
        return [polygon]
    thickness = rng.uniform(*plan.walls)
    walls.stroke(crossing[0], crossing[1], thickness)
    way = (crossing[1] - crossing[0]) / length
    for _ in range(1 + int(rng.random() < length / 400.0)):
        at = crossing[0] + way * rng.uniform(door, length - door)
        doorways.stroke(at - 0.5 * door * way, at + 0.5 * door * way, thickness + 6.0)
    rooms = []
    for part in parts:
        rooms.extend(_cut(np.array(part), plan, rng, walls, doorways))
    return rooms


def _furnished(
    room: Float64Array,
    plan: FloorPlan,
    rng: np.random.Generator,
    solid: BoolArray,
    kept_clear: BoolArray,
) -> BoolArray:
    """Return pillars and furniture of a room, never in front of a door nor nearly touching."""
    furniture = Canvas(SIDE, SIDE)
    low, high = room.min(axis=0), room.max(axis=0)
    if plan.pillar_spacing > 0.0:
        for x in np.arange(low[0] + plan.pillar_spacing / 2.0, high[0], plan.pillar_spacing):
            for y in np.arange(low[1] + plan.pillar_spacing / 2.0, high[1], plan.pillar_spacing):
                piece = Canvas(SIDE, SIDE).disc((x, y), rng.uniform(2.0, 5.0))
                _place(piece, furniture, solid, kept_clear)
    wanted = rng.poisson(plan.clutter * _area(room) / 1000.0)
    for _ in range(wanted):
        centre = (float(rng.uniform(low[0], high[0])), float(rng.uniform(low[1], high[1])))
        piece = Canvas(SIDE, SIDE)
        if rng.random() < 0.4:
            piece.disc(centre, rng.uniform(1.0, 3.0))
        else:
            sides = (float(rng.uniform(3.0, 18.0)), float(rng.uniform(2.0, 8.0)))
            turn = rng.choice((0.0, math.pi / 2.0)) + rng.normal(0.0, 0.25)
            piece.box(centre, sides, float(turn))
        _place(piece, furniture, solid, kept_clear)
    return furniture.cells


def _place(piece: Canvas, furniture: Canvas, solid: BoolArray, kept_clear: BoolArray) -> None:
    area = piece.touched
    beside = piece.around(4)
    if (piece.cells[area] & kept_clear[area]).any():
        return
    if (piece.cells[area] & solid[area]).any() or furniture.cells[beside].any():
        return
    furniture.cells[area] |= piece.cells[area]


def _with_locked_rooms(
    rooms: list[Float64Array], share: float, rng: np.random.Generator, solid: BoolArray
) -> BoolArray:
    """Fill a share of the rooms, but none that others can only be reached through."""
    largest = max(rooms, key=_area)
    for room in rooms:
        if rng.random() >= share or room is largest:
            continue
        inside = Canvas(SIDE, SIDE).polygon(room).cells
        lost = _accessible(solid) & ~_accessible(solid | inside)
        # Only what is in the room itself may be lost, give or take the way through its doors.
        if (lost & ~inside).sum() < DOORWAY_AREA:
            solid = solid | inside
    return solid


def _accessible(solid: BoolArray) -> BoolArray:
    """Return the largest space in which a robot of a usual size can move."""
    blocked = np.empty(solid.shape, np.uint8)
    keep_clear(solid.astype(np.uint8), ROBOT_RADIUS, blocked)
    return _largest_space(blocked == 0)


def _reachable_only(solid: BoolArray) -> UInt8Array:
    """Fill every open space but the largest."""
    return np.asarray(~_largest_space(~solid), np.uint8)


def _largest_space(open_cells: BoolArray) -> BoolArray:
    """Return the largest group of cells that are connected side by side."""
    distances = np.empty(open_cells.shape, np.int32)
    queue = np.empty(open_cells.size, np.int32)
    left, largest, kept = open_cells.copy(), 0, np.zeros_like(open_cells)
    while left.any() and left.sum() > largest:
        row, column = (int(index) for index in np.argwhere(left)[0])
        size = walk_distances(open_cells, column, row, distances, queue)
        reached = distances >= 0
        if size > largest:
            largest, kept = size, reached
        left &= ~reached
    return kept

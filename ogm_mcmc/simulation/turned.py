"""A world of cells that lies askew in the map, so that no wall follows the lattice.

Design note: what is true of a cell
-----------------------------------
Context. A map image mapped on its own lattice is an easy world: every cell is solid or free, and
readings end in the middle of cells. Buildings do not lie like that.

Decision. Rays are traced in the world as it is, by its own cells; only the poses are turned, about
its middle. A cell of the turned truth is occupied where half of its area or more is solid, free
where nothing of it is, and unknown, so that nobody is judged by it, in between and beyond the
world. Areas are sampled at points, two or more to a cell of the world along each axis.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np

from ogm_mcmc.geometry import GridMap, GridSpec, PlacedScan, Pose2D
from ogm_mcmc.simulation.grid_world import GridWorld

__all__ = ['Turned']

# A cell is looked at in so many points along each axis, at least.
LEAST_POINTS = 5


class Turned(NamedTuple):
    """A world, and where its own frame lies in the map's."""

    world: GridWorld
    frame: Pose2D

    @classmethod
    def about_middle(cls, world: GridWorld, turn_rad: float) -> Turned:
        """Turn a world counter-clockwise about its middle, which stays where it is."""
        spec = world.spec
        x = spec.origin_x_m + 0.5 * spec.width * spec.resolution_m
        y = spec.origin_y_m + 0.5 * spec.height * spec.resolution_m
        return cls(world, Pose2D(x, y, turn_rad).compose(Pose2D(-x, -y)))

    def pose(self, in_world: Pose2D) -> Pose2D:
        """Return a pose in the world as one in the map."""
        return self.frame.compose(in_world)

    def placed(self, scans: Iterable[PlacedScan]) -> Iterator[PlacedScan]:
        """Yield scans at known poses in the world with their poses in the map."""
        for scan, belief in scans:
            yield PlacedScan.at(scan, self.pose(belief.mean))

    def truth(self, spec: GridSpec) -> GridMap:
        """Return the true map of the world as it lies, on given cells, nan where neither."""
        world, own, resolution_m = self.world, self.world.spec, spec.resolution_m
        points = max(LEAST_POINTS, math.ceil(2.0 * resolution_m / own.resolution_m))
        solid = np.zeros((spec.height, spec.width), np.int32)
        outside = np.zeros(solid.shape, np.bool_)
        back = self.frame.inverse()
        cosine, sine = math.cos(back.yaw_rad), math.sin(back.yaw_rad)
        for k in range(points**2):
            down, across = ((one + 0.5) / points for one in divmod(k, points))
            x = spec.origin_x_m + resolution_m * (np.arange(spec.width) + across)
            y = (spec.origin_y_m + resolution_m * (np.arange(spec.height) + down))[:, None]
            there_x = back.x_m + cosine * x - sine * y - own.origin_x_m
            there_y = back.y_m + sine * x + cosine * y - own.origin_y_m
            column = np.floor(there_x / own.resolution_m).astype(np.int32)
            row = np.floor(there_y / own.resolution_m).astype(np.int32)
            inside = (column >= 0) & (column < own.width) & (row >= 0) & (row < own.height)
            outside |= ~inside
            solid += world.occupied[np.where(inside, row, 0), np.where(inside, column, 0)] & inside
        truth = np.full(solid.shape, np.nan, np.float32)
        truth[solid == 0] = 0.0
        truth[2 * solid >= points**2] = 1.0
        truth[outside] = np.nan
        return GridMap(spec, truth)

    def spec(self, resolution_m: float) -> GridSpec:
        """Return the cells of the map's lattice around the whole world; raises ConfigError."""
        own = self.world.spec
        corners = [
            self.pose(
                Pose2D(
                    own.origin_x_m + across * own.width * own.resolution_m,
                    own.origin_y_m + up * own.height * own.resolution_m,
                )
            )
            for across in (0, 1)
            for up in (0, 1)
        ]
        x, y = ([getattr(one, axis) / resolution_m for one in corners] for axis in ('x_m', 'y_m'))
        column0, row0 = math.floor(min(x)), math.floor(min(y))
        width, height = math.ceil(max(x)) - column0, math.ceil(max(y)) - row0
        return GridSpec(resolution_m, width, height, column0, row0)

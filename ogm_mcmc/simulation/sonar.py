"""A ring of sonars: each returns the nearest wall anywhere in its cone.

Left out are echoes that a smooth wall throws away from the sonar, those that come by way of a
second wall, and sonars that hear each other: what they do to a reading, `clutter` stands for.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ogm_mcmc.arrays import Float64Array
from ogm_mcmc.errors import require
from ogm_mcmc.geometry import PlacedScan, Pose2D, Scan
from ogm_mcmc.simulation.cone_kernels import nearest_cell, nearest_wall
from ogm_mcmc.simulation.grid_world import GridWorld
from ogm_mcmc.simulation.lidar import check_errors, observed, true_ranges
from ogm_mcmc.simulation.worlds import Building

__all__ = ['SonarRing']


@dataclass(frozen=True)
class SonarRing:
    """Sonars at equal angles on a circle around the robot, looking outwards.

    The first looks ahead, the others follow counter-clockwise. `field_of_view_rad` is the full
    angle of each cone; `noise_m`, `dropout` and `clutter` are those of `Lidar`.
    """

    sonars: int = 16
    radius_m: float = 0.2
    field_of_view_rad: float = 0.4
    range_min_m: float = 0.05
    range_max_m: float = 4.0
    noise_m: float = 0.02
    dropout: float = 0.002
    clutter: float = 0.0

    def __post_init__(self) -> None:
        """Refuse what is no ring of sonars."""
        require(0 < self.sonars <= 1000, 'sonars', self.sonars, 'expected 1 to 1000')
        require(0.0 <= self.radius_m <= 10.0, 'ring_radius', self.radius_m, 'expected 0 to 10 m')
        cone = 0.0 < self.field_of_view_rad < math.pi
        require(cone, 'field_of_view', self.field_of_view_rad, 'expected 0 to pi')
        valid = 0.0 <= self.range_min_m < self.range_max_m < math.inf
        require(valid, 'range_max', self.range_max_m, 'must be above range_min, and finite')
        check_errors(self.noise_m, self.dropout, self.clutter)

    def turns(self) -> Float64Array:
        """Return the heading (S,) of each sonar on the robot, rad."""
        turns = np.arange(self.sonars, dtype=np.float64) * (2.0 * math.pi / self.sonars)
        return np.asarray(turns, np.float64)

    def mounts(self) -> dict[str, Pose2D]:
        """Return where each sonar sits on the robot, by frame."""
        return {
            f'sonar_{k}': Pose2D(
                self.radius_m * math.cos(turn), self.radius_m * math.sin(turn), float(turn)
            )
            for k, turn in enumerate(self.turns())
        }

    def mounts_setting(self) -> str:
        """Return the mounts as the parameter `mount.frames` takes them."""
        return '; '.join(
            f'{frame} {pose.x_m:.6f} {pose.y_m:.6f} {pose.yaw_rad:.6f}'
            for frame, pose in self.mounts().items()
        )

    def exact_ranges(
        self, world: Building | GridWorld, robot: Pose2D, depth: float = 0.5
    ) -> Float64Array:
        """Distance (S,) to the nearest wall in each cone, m; inf where none is in reach.

        `depth`: where the nearest occupied cell of a `GridWorld` reflects, see `grid_world`.
        A sonar that a wall parts from the robot's middle is pressed into it, and reads 0.
        """
        require(0.0 <= depth <= 1.0, 'depth', depth, 'expected 0 to 1')
        sonars = [robot.compose(mount) for mount in self.mounts().values()]
        if isinstance(world, Building):
            behind = true_ranges(world.walls, robot, self.turns()) <= self.radius_m
            exact = [self._nearest_wall(world, sonar) for sonar in sonars]
        else:
            behind = world.ranges(robot, self.turns(), self.radius_m, 0.0) <= self.radius_m
            exact = [self._nearest_cell(world, sonar, depth) for sonar in sonars]
        return np.where(behind, 0.0, exact)

    def _nearest_wall(self, world: Building, sonar: Pose2D) -> float:
        walls = np.ascontiguousarray(world.walls, np.float64)
        return float(nearest_wall(walls, sonar.x_m, sonar.y_m, *self._cone(sonar)))

    def _nearest_cell(self, world: GridWorld, sonar: Pose2D, depth: float) -> float:
        spec, metres = world.spec, world.spec.resolution_m
        x, y = (sonar.x_m - spec.origin_x_m) / metres, (sonar.y_m - spec.origin_y_m) / metres
        reach = self.range_max_m / metres
        cone = self._cone(sonar)
        return metres * float(nearest_cell(world.occupied, x, y, *cone, reach, float(depth)))

    def _cone(self, sonar: Pose2D) -> tuple[float, float, float, float]:
        """Return cosine and sine of the axis and of half the opening angle."""
        half, heading = 0.5 * self.field_of_view_rad, sonar.yaw_rad
        return math.cos(heading), math.sin(heading), math.cos(half), math.sin(half)

    def measure(
        self,
        world: Building | GridWorld,
        robot: Pose2D,
        rng: np.random.Generator,
        stamp_ns: int = 0,
        *,
        depth: float = 0.5,
    ) -> Iterator[PlacedScan]:
        """Yield a reading of every sonar, a scan of one cone from where the sonar truly was.

        Ranges are as REP 117 has them: see `lidar.observed`.
        """
        ranges = observed(
            self.exact_ranges(world, robot, depth),
            rng,
            limits_m=(self.range_min_m, self.range_max_m),
            noise_m=self.noise_m,
            dropout=self.dropout,
            clutter=self.clutter,
        )
        for reading, (frame, mount) in zip(ranges, self.mounts().items(), strict=True):
            scan = Scan.checked(
                np.array([reading]),
                angle_min_rad=0.0,
                angle_increment_rad=0.0,
                range_min_m=self.range_min_m,
                range_max_m=self.range_max_m,
                stamp_ns=stamp_ns,
                frame_id=frame,
                beam_width_rad=self.field_of_view_rad,
            )
            yield PlacedScan.at(scan, robot.compose(mount))

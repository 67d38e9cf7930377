"""A robot that does not know where it is: odometry, a particle filter, real particle beliefs.

Particles move with the noise of the odometry and are weighted by how well a scan fits at each of
them (`ScanFit`). The filter of `record_localized` knows the true map (`WorldFit`), for [pose]
assumes that "a SLAM system is in place and outputs at every time step a distribution describing
the robot's estimated pose"; `evaluation.scan_fit` has what reads a map that was made.

Beams of one scan are no independent witnesses (they share the errors of map and pose), so only
some are used and their log-likelihood counts by a power below 1. With 0.1 of 60 beams the beliefs
are honest, if a little shy: errors of 2 to 3 cm where they claim 3 to 4, normalised squared errors
of 1 on average where 3 would be exact (buildings 2 and 8, range noise 3 and 30 cm). With 0.3 they
are smaller, but now and then one particle is left and all wrong: 4 to 19 on average.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

import numpy as np

from ogm_mcmc.arrays import Float64Array
from ogm_mcmc.errors import require
from ogm_mcmc.geometry import PlacedScan, Pose2D, PoseBelief, PoseSamples, Scan
from ogm_mcmc.simulation.exploration import Exploration, Stop, explore
from ogm_mcmc.simulation.grid_world import GridWorld
from ogm_mcmc.simulation.lidar import Lidar
from ogm_mcmc.simulation.localization_kernels import scan_log_likelihoods
from ogm_mcmc.simulation.odometry import Motion, OdometryNoise, motion_between
from ogm_mcmc.simulation.recording import SPEED_M_S, STANDING_S, START_NS

__all__ = [
    'LocalizedScan',
    'ParticleFilter',
    'ParticleFilterSettings',
    'ScanFit',
    'WorldFit',
    'record_localized',
]

# The robot goes straight for so many cells at a time.
LEG_CELLS = 8


@dataclass(frozen=True)
class ParticleFilterSettings:
    """`spread_m` and `spread_rad` of the first belief; see the module for `power` and `beams`."""

    particles: int = 500
    beams: int = 60
    power: float = 0.1
    sigma_m: float = 0.2
    clutter: float = 0.05
    missing: float = 0.05
    spread_m: float = 0.1
    spread_rad: float = 0.05

    def __post_init__(self) -> None:
        """Refuse what is no filter."""
        require(self.particles >= 1, 'particles', self.particles, 'expected at least one')
        require(self.beams >= 1, 'beams', self.beams, 'expected at least one')
        require(0.0 < self.power <= 1.0, 'power', self.power, 'expected up to 1')
        require(self.sigma_m > 0.0, 'sigma', self.sigma_m, 'must be positive')
        for name in ('clutter', 'missing'):
            value = getattr(self, name)
            require(0.0 < value < 0.5, name, value, 'expected between 0 and 0.5')


class ScanFit(Protocol):
    """How well a scan fits in a map, at many poses of the sensor at once."""

    def log_likelihoods(
        self, poses: Float64Array, bearings: Float64Array, ranges: Float64Array, reach: float
    ) -> Float64Array:
        """Log-likelihoods (M,), nats, at poses (M, 3), m, m, rad.

        bearings, ranges  (B,) rad and m, informative beams; inf: no return; reach  range_max, m
        """
        ...


class WorldFit(NamedTuple):
    """Ranges cast exactly in a known world: hits, clutter, missing returns; see the kernel."""

    world: GridWorld
    sigma_m: float
    clutter: float
    missing: float
    depth: float = 0.5

    def log_likelihoods(
        self, poses: Float64Array, bearings: Float64Array, ranges: Float64Array, reach: float
    ) -> Float64Array:
        """See `ScanFit`."""
        spec = self.world.spec
        log_likelihoods = np.empty(len(poses))
        scan_log_likelihoods(
            self.world.occupied,
            *spec.scan_in_cells(poses, bearings, ranges, reach),
            self.depth,
            self.sigma_m / spec.resolution_m,
            self.clutter,
            self.missing,
            log_likelihoods,
        )
        return log_likelihoods


@dataclass
class ParticleFilter:
    """Monte Carlo localization: `move`, then `weigh` with a scan, again and again."""

    fit: ScanFit
    settings: ParticleFilterSettings
    noise: OdometryNoise
    rng: np.random.Generator
    poses: Float64Array = field(init=False)
    weights: Float64Array = field(init=False)

    def start(self, pose: Pose2D) -> None:
        """Believe in a Gaussian around a pose."""
        s = self.settings
        spread = np.array([s.spread_m, s.spread_m, s.spread_rad])
        here = np.array([pose.x_m, pose.y_m, pose.yaw_rad])
        self.poses = here + spread * self.rng.standard_normal((s.particles, 3))
        self.weights = np.full(s.particles, 1.0 / s.particles)

    def move(self, motion: Motion) -> None:
        """Move every particle by a measured motion, each with noise of its own.

        Resample before, when few particles fit: copies of one are told apart by their motion.
        """
        if self.effective_particles() < 0.5 * self.weights.size:
            self._resample()
        turn, way, after = self.noise.sampled(motion, self.poses.shape[0], self.rng)
        heading = self.poses[:, 2] + turn
        self.poses[:, 0] += way * np.cos(heading)
        self.poses[:, 1] += way * np.sin(heading)
        self.poses[:, 2] = heading + after

    def weigh(self, scan: Scan) -> None:
        """Weigh the particles by how well a scan fits."""
        s = self.settings
        chosen = self._chosen_beams(scan)
        if chosen.size == 0:
            return
        ranges = scan.ranges_m[chosen].astype(np.float64)
        log_likelihoods = self.fit.log_likelihoods(
            self.poses, scan.bearings()[chosen], ranges, scan.range_max_m
        )
        log_weights = np.log(self.weights) + s.power * log_likelihoods
        self.weights = np.exp(log_weights - log_weights.max())
        # A weight of 0 could never recover, and has no logarithm.
        self.weights = np.maximum(self.weights, 1e-300)
        self.weights /= self.weights.sum()

    def belief(self) -> PoseBelief:
        """Return what is believed now: weighted particles, their mean and covariance."""
        samples = PoseSamples.checked(self.poses.copy(), self.weights.copy())
        return PoseBelief(samples.mean(), samples.covariance(), samples)

    def effective_particles(self) -> float:
        """Return 1 / sum of squared weights."""
        return float(1.0 / np.sum(self.weights**2))

    def _chosen_beams(self, scan: Scan) -> Float64Array:
        """Indices (B,) of informative beams, evenly spread over the scan."""
        informative = np.flatnonzero(scan.informative())
        step = max(1, math.ceil(informative.size / self.settings.beams))
        return np.asarray(informative[::step])

    def _resample(self) -> None:
        """Draw as many particles with one random offset (low variance), all of equal weight."""
        count = self.weights.size
        positions = (np.arange(count) + self.rng.random()) / count
        edges = np.cumsum(self.weights)
        edges[-1] = 1.0
        self.poses = self.poses[np.searchsorted(edges, positions, side='right')]
        self.weights = np.full(count, 1.0 / count)


class LocalizedScan(NamedTuple):
    """A scan placed by what the filter believes, its true pose, and where odometry alone leads."""

    placed: PlacedScan
    truth: Pose2D
    odometry: Pose2D


def record_localized(
    world: GridWorld,
    lidar: Lidar,
    exploration: Exploration,
    rng: np.random.Generator,
    *,
    noise: OdometryNoise | None = None,
    settings: ParticleFilterSettings | None = None,
    depth: float = 0.5,
    frame_id: str = 'laser',
) -> Iterator[LocalizedScan]:
    """Yield a scan and a belief from every stop of an exploring robot.

    With the same generator the way and the scans are those of `record_exploration`. Odometry
    starts at the true pose. To localize, the robot also looks while it drives, once a leg; only
    the scans from its stops are recorded.
    """
    scan_noise, wheel_noise, filter_noise, underway_noise = rng.spawn(4)
    noise = noise or OdometryNoise()
    settings = settings or ParticleFilterSettings(sigma_m=max(0.2, lidar.noise_m))
    fit = WorldFit(world, settings.sigma_m, settings.clutter, settings.missing, depth)
    particle_filter = ParticleFilter(fit, settings, noise, filter_noise)
    bearings, time_s = lidar.bearings(), 0.0
    before: Pose2D | None = None
    odometry = Pose2D()
    for stop in explore(world, exploration, rng):
        time_s += STANDING_S + (len(stop.way) - 1) * world.spec.resolution_m / SPEED_M_S
        if before is None:
            odometry = stop.pose
            particle_filter.start(stop.pose)
        else:
            for motion, there in _legs(world, before, stop):
                measured = noise.measured(motion, wheel_noise)
                odometry = measured.applied(odometry)
                particle_filter.move(measured)
                if there == stop.pose:
                    break
                exact = world.ranges(there, bearings, lidar.range_max_m, depth)
                particle_filter.weigh(
                    lidar.scan(lidar.observe(exact, underway_noise), 0, frame_id)
                )
        exact = world.ranges(stop.pose, bearings, lidar.range_max_m, depth)
        stamp_ns = START_NS + round(time_s * 1e9)
        scan = lidar.scan(lidar.observe(exact, scan_noise), stamp_ns, frame_id)
        particle_filter.weigh(scan)
        yield LocalizedScan(PlacedScan(scan, particle_filter.belief()), stop.pose, odometry)
        before = stop.pose


def _legs(world: GridWorld, start: Pose2D, stop: Stop) -> Iterator[tuple[Motion, Pose2D]]:
    """Yield the true motions along the way to a stop, a leg at a time, and where they end."""
    spec, here = world.spec, start
    for column, row in stop.way[LEG_CELLS:-1:LEG_CELLS]:
        x, y = (
            spec.origin_x_m + (column + 0.5) * spec.resolution_m,
            spec.origin_y_m + (row + 0.5) * spec.resolution_m,
        )
        there = Pose2D(x, y, math.atan2(y - here.y_m, x - here.x_m))
        yield motion_between(here, there), there
        here = there
    yield motion_between(here, stop.pose), stop.pose

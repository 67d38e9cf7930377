"""Poses of recorded scans estimated together, before a map is sampled at them.

Scans with what the localizer believed ---> PoseRefinement.run ... until done or time is up
|                                                    |
v                                                    v
`placed`: the same scans where they are now          `trajectory`: where the robot was
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from ogm_mcmc.arrays import Float64Array
from ogm_mcmc.config import PosesConfig, TrajectoryConfig
from ogm_mcmc.engine.beam_times import BentScans, beam_times_figures, said_beam_times
from ogm_mcmc.engine.odometry import OdometryAt, wheel_moves
from ogm_mcmc.geometry import PlacedScan, Pose2D, PoseBelief
from ogm_mcmc.trajectory import Moves, TrajectoryProgress, TrajectoryRefinement
from ogm_mcmc.trajectory.points import wrapped, xyyaw

__all__ = ['PoseRefinement', 'PosesChoice', 'RefinedTrajectory', 'choose_joint']

# With fewer readings a scan, joint poses gained nothing (Intel, 4 or 5 a scan).
ENOUGH_READINGS = 20

UNSURE_RAD = math.radians(0.5)

# Where a sensor sits on the robot may differ by so much from scan to scan, m, m, rad.
SAME_MOUNT = (0.01, 0.01, 0.01)

# Odometry is not off by so many of its deviations, and this many m or rad, between two scans.
TORN_FROM, TORN_LEAST = 10.0, 0.2

# What the result says of points, see `ogm_mcmc.trajectory.curvature`.
OF_POINTS = ('held_by_points', 'points_show', 'stretches_show')

# A choice made before stays while the data are within this factor of what decides: each change
# moves the map and begins chains anew.
CLEARLY = 1.5


class PosesChoice(NamedTuple):
    """Whether poses of some scans are estimated, and why (empty where that was asked for)."""

    joint: bool
    why: str = ''


def choose_joint(
    scans: Sequence[PlacedScan],
    config: PosesConfig,
    resolution_m: float,
    before: bool | None = None,
    drifting: bool = False,
) -> PosesChoice:
    """Decide `poses: auto` for scans, whose map has cells of that side.

    Joint, where beliefs say that they are unsure by more than half a cell or half a degree
    (medians), or poses are those of odometry (`drifting`), which says how it errs from step to
    step if anything, and scans have enough readings to know better (median of `ENOUGH_READINGS`).
    What was chosen `before` stays until beliefs speak against it by a factor `CLEARLY`; joint
    poses stay until readings are too few by as much. Where no belief says anything, poses that
    do not drift are fixed, whatever they were before.
    """
    if config.poses != 'auto':
        return PosesChoice(config.joint)
    said = 'they are those of odometry, which drifts'
    if not drifting:
        deviations = [found for one in scans if (found := _deviation(one.belief)) is not None]
        if not deviations:
            return PosesChoice(False, 'poses fixed: nothing says how sure they are')
        place_m, turn_rad = np.median(np.array(deviations), axis=0)
        unsure = f'{100.0 * place_m:.1f} cm and {math.degrees(turn_rad):.2f} degrees unsure'
        factor = 1.0 if before is None else 1.0 / CLEARLY if before else CLEARLY
        if place_m <= factor * 0.5 * resolution_m and turn_rad <= factor * UNSURE_RAD:
            return PosesChoice(False, f'poses fixed: the localizer is only {unsure}')
        said = f'the localizer is {unsure}'
    counts = [np.count_nonzero(one.scan.measured()) for one in scans]
    readings = int(np.median(counts)) if counts else 0
    if readings < (ENOUGH_READINGS / CLEARLY if before else ENOUGH_READINGS):
        return PosesChoice(False, f'poses fixed: {readings} readings a scan are too few')
    return PosesChoice(True, f'poses joint: {said}, {readings} readings a scan')


def _deviation(belief: PoseBelief) -> tuple[float, float] | None:
    """Return the standard deviations of place (m) and heading (rad); None where none is said."""
    covariance = belief.covariance
    if belief.particles is not None:
        covariance = belief.particles.covariance()
    if covariance is None or not covariance.any():
        return None
    place = math.sqrt(0.5 * float(covariance[0, 0] + covariance[1, 1]))
    return place, math.sqrt(float(covariance[2, 2]))


class RefinedTrajectory(NamedTuple):
    """Where the robot was at `stamps_ns`, each later than the one before.

    `correction` takes the latest pose as the localizer gave it, in the map, to where it is now:
    the pose that the map frame of then has in that of now. `points` is how far points lie off
    their lines, m, between the ends of its 95 % interval. `apart` (N, 3): standard deviations of
    x, y (m) and yaw (rad) without the motion that all poses have in common, once known.
    """

    stamps_ns: list[int]
    beliefs: list[PoseBelief]
    correction: Pose2D
    points: tuple[float, float, float] | None = None
    apart: Float64Array | None = None


class PoseRefinement:
    """The poses of some scans, refined step by step; a thin coat of `TrajectoryRefinement`.

    `odometry` says where the robot was at a stamp by its wheels, where the settings want it;
    `wheels` are the moves that came of it. Where beams were taken at different times, scans come
    out bent by that, from `scans_bent`: those of before stay the same objects. That is not looked
    for where scans are of several sensors, each of which would have times and speeds of its own,
    or of one that moves on the robot: mounts that differ may be of either.

    Poses that are `drifting` are those of odometry: they are the moves themselves then, and no
    others are looked at, which may be the same once more.
    """

    def __init__(
        self,
        scans: Sequence[PlacedScan],
        config: TrajectoryConfig,
        odometry: OdometryAt | None = None,
        scans_bent: BentScans | None = None,
        *,
        drifting: bool = False,
    ) -> None:
        self.scans = list(scans)
        self.scans_bent = BentScans() if scans_bent is None else scans_bent
        stamps = np.array([placed.scan.stamp_ns for placed in scans], np.int64)
        self.order = np.argsort(stamps, kind='stable')
        self.wheels: Moves | None = None
        if odometry is not None and config.odometry and not drifting:
            self.wheels = wheel_moves(self.scans, self.order, odometry)
        self.one_sensor = _of_one_sensor(self.scans)
        self.estimator = TrajectoryRefinement(
            self.scans,
            config,
            moves=self.wheels,
            order=self.order,
            times_s=1e-9 * (stamps - stamps[:1]) if self.one_sensor else None,
            drifting=drifting,
        )
        self.drifting = drifting
        if drifting and len(self.scans) > 1:
            self.wheels = self.estimator.factors.moves
        self.progress: TrajectoryProgress | None = None

    @property
    def finished(self) -> bool:
        """Whether nothing is left to do."""
        return self.estimator.finished

    @property
    def aligned(self) -> bool:
        """Whether poses are what they will be; then standard deviations are drawn."""
        return self.estimator.aligned

    @property
    def usable(self) -> bool:
        """Whether poses are likely better than those given: aligned in squares of 0.4 m once."""
        return self.estimator.usable

    def run(
        self, max_time_s: float = math.inf, cancelled: Callable[[], bool] = lambda: False
    ) -> Iterator[TrajectoryProgress]:
        """Go on where it was left; yield after each step, until all is done or time is up."""
        for progress in self.estimator.run(max_time_s, cancelled):
            self.progress = progress
            yield progress

    def placed(self) -> list[PlacedScan]:
        """Return the scans at their poses as they are now, with covariances once known."""
        bent = self.scans_bent.bent(
            [one.scan for one in self.scans],
            self.estimator.speeds,
            self.estimator.beam_times.seconds,
        )
        return [
            PlacedScan(scan, belief._replace(offset=old.belief.offset))
            for old, scan, belief in zip(self.scans, bent, self.estimator.beliefs(), strict=True)
        ]

    def trajectory(self) -> RefinedTrajectory:
        """Return where the robot was; one pose for each stamp."""
        placed = self.placed()
        apart = self.estimator.covariances(apart=True)
        stamps: list[int] = []
        beliefs: list[PoseBelief] = []
        spreads: list[Float64Array] = []
        for k in self.order:
            stamp_ns = placed[k].scan.stamp_ns
            if not stamps or stamp_ns > stamps[-1]:
                stamps.append(stamp_ns)
                beliefs.append(placed[k].belief.of_robot())
                alone = placed[k].belief._replace(covariance=apart[k]).of_robot().covariance
                spreads.append(np.sqrt(np.diag(alone)))
        last = int(self.order[-1])
        correction = placed[last].pose.compose(self.scans[last].pose.inverse())
        known = np.array(spreads) if self.estimator.covariances_known else None
        return RefinedTrajectory(stamps, beliefs, correction, self.estimator.point_spread, known)

    def said_beam_times(self) -> str:
        """Return a line for the user: when beams were taken; empty where all were at once."""
        if self.one_sensor or not self.estimator.config.beam_times:
            return said_beam_times(self.estimator.beam_times)
        return (
            'scans of several sensors, or of one that moves on the robot: when their beams were '
            'taken is not estimated'
        )

    def said_torn(self) -> str:
        """Return a line where poses of odometry were torn apart; empty where they hold.

        That is where one step is off by more than `TORN_FROM` deviations of what is usual for
        odometry: these scans cannot lie like that in one map.
        """
        if not self.drifting or self.wheels is None:
            return ''
        errors = np.abs(self.wheels.errors(self.estimator.poses))
        variances = np.diagonal(np.linalg.inv(self.wheels.precision), axis1=1, axis2=2)
        torn = ((errors > TORN_FROM * np.sqrt(variances)) & (errors > TORN_LEAST)).any(axis=1)
        if not torn.any():
            return ''
        worst = int(np.argmax(torn * np.hypot(errors[:, 0], errors[:, 1])))
        stamp_s = 1e-9 * self.scans[int(self.wheels.second[worst])].scan.stamp_ns
        return (
            f'joint poses are torn apart at {np.count_nonzero(torn)} of {torn.size} steps: at '
            f'{stamp_s:.2f} s {np.hypot(*errors[worst, :2]):.2f} m and '
            f'{math.degrees(errors[worst, 2]):.1f} degrees from what odometry says'
        )

    @property
    def odometry_scale(self) -> float:
        """How many times the covariances of odometry are what poses show, 1 without any."""
        return 1.0 if self.wheels is None else float(self.estimator.move_scales[-1])

    def figures(self) -> dict[str, Any]:
        """Return plain values for JSON: how far poses went and how sure they are."""
        moved = wrapped(self.estimator.poses - self.estimator.factors.mean)
        squares = (moved**2).mean(axis=0)
        figures: dict[str, Any] = {
            'finished': self.finished,
            'draws': len(self.estimator.deviations),
            'moved_m': round(math.sqrt(float(squares[:2].sum())), 6),
            'moved_deg': round(math.degrees(math.sqrt(float(squares[2]))), 6),
        }
        if self.estimator.point_spread is not None:
            low, found, high = self.estimator.point_spread
            figures['point_deviation_m'] = round(found, 6)
            figures['point_deviation_95_m'] = [round(low, 6), round(high, 6)]
        figures['belief_scale'] = round(self.estimator.belief_scale, 6)
        figures['belief_correlation'] = [round(float(r), 6) for r in self.estimator.correlation]
        figures['beam_times'] = beam_times_figures(self.estimator.beam_times)
        figures['odometry_steps'] = 0 if self.wheels is None else int(self.wheels.first.size)
        if self.wheels is not None:
            figures['odometry_scale'] = round(self.odometry_scale, 6)
        of_points = self.estimator.held, self.estimator.shown, self.estimator.together
        for name, value in zip(OF_POINTS, of_points, strict=True):
            figures[name] = None if math.isnan(value) else round(value, 6)
        spread = _deviations(self.estimator.covariances())
        if self.estimator.covariances_known:
            place = np.sqrt((spread[:, :2] ** 2).sum(axis=1))
            figures['deviation_m'] = round(float(np.median(place)), 6)
            figures['deviation_deg'] = round(math.degrees(float(np.median(spread[:, 2]))), 6)
            apart = _deviations(self.estimator.covariances(apart=True))
            alone = np.sqrt((apart[:, :2] ** 2).sum(axis=1))
            figures['deviation_apart_m'] = round(float(np.median(alone)), 6)
        return figures


def _of_one_sensor(scans: Sequence[PlacedScan]) -> bool:
    """Whether the scans may all be of one sensor: of one name, at one place on the robot."""
    if len({placed.scan.frame_id for placed in scans}) != 1:
        return False
    offsets = xyyaw([placed.belief.offset for placed in scans])
    return bool((np.abs(wrapped(offsets - offsets[:1])) <= SAME_MOUNT).all())


def _deviations(covariances: Float64Array) -> Float64Array:
    return np.asarray(np.sqrt(np.diagonal(covariances, axis1=1, axis2=2)), np.float64)

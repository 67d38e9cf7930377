"""Placed scans in, better poses out, step by step: `TrajectoryRefinement`."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import AnyArray, Float64Array, Int64Array
from ogm_mcmc.config import TrajectoryConfig
from ogm_mcmc.errors import WindowError
from ogm_mcmc.geometry import Pose2D, PoseBelief, Scan
from ogm_mcmc.trajectory.alike import Alike
from ogm_mcmc.trajectory.apart import moved_as_one, without_common_motion
from ogm_mcmc.trajectory.beam_times import BeamTimes, bent_points, shown_times, velocities
from ogm_mcmc.trajectory.correlative import (
    LookUp,
    look_up_along,
    look_up_in_turn,
    recheck,
    relocate,
)
from ogm_mcmc.trajectory.curvature import (
    ROUGHLY,
    drawn_deviation,
    held_share,
    in_common,
    map_squares,
    numbers_fitted,
    shown_variance,
    widening,
)
from ogm_mcmc.trajectory.factors import PoseFactors
from ogm_mcmc.trajectory.moves import Moves
from ogm_mcmc.trajectory.normal_equations import NormalEquations, align
from ogm_mcmc.trajectory.points import ScanPoints, poses_of, wrapped
from ogm_mcmc.trajectory.surfels import Stage, SurfelSystem

__all__ = ['TrajectoryProgress', 'TrajectoryRefinement']

# Coarse to fine: every stage halves what it looks at. The last one is what poses are drawn from.
STAGES = (
    Stage(side_m=1.6, cut_m=0.4, flatness=0.3, steps=6),
    Stage(side_m=0.8, cut_m=0.2, flatness=0.3, steps=6),
    Stage(side_m=0.8, cut_m=0.1, flatness=0.3, steps=4),
    Stage(side_m=0.4, cut_m=0.06, flatness=0.2, steps=6),
    Stage(side_m=0.2, cut_m=0.05, flatness=0.3, steps=8),
)

# Poses are good enough by then to show how good their beliefs were.
RESCALED_FROM_M = 0.4

# After these, scans astray are looked up in what the others saw.
COARSE = STAGES[:3]

# A scan may be astray where its belief is wider than alignment reaches (standard deviations, m, m,
# rad), or where so small a share of what is usual of its points lies on lines.
VAGUE = (0.35, 0.35, 0.12)
FITTING_SHARE = 0.6
ASTRAY = LookUp(reach_rad=0.7)

# At the end no scan may fit better near by, nor far off one that fits badly. Where any does,
# alignment begins again from the third stage, so many times at most. By then poses are good enough
# to say where others looked through.
NEAR_BY = LookUp(reach_m=0.5, reach_rad=0.5, in_free=0.01)
FAR_OFF = LookUp(reach_m=4.0, reach_rad=1.25, step_m=0.2, step_rad=0.05, in_free=0.01)
RECHECKS = 2

# Stages that a search begins with, and that its look-up of astray scans is followed by.
SEARCH_STAGES = STAGES[:2]

# Odometry is off by no more from one scan to the next, as long as wheels do not slip by far.
ALONG = LookUp(reach_m=0.5, reach_rad=0.25)

# After these steps of stages from `RESCALED_FROM_M` on, it is asked when beams were taken.
TIMED_AFTER = (1, 3)

# Directions along which it is measured how firmly points hold poses, and how they err.
PROBES = 4


class TrajectoryProgress(NamedTuple):
    """How far refining has come: what was done last, the side of the squares in use, m, the
    standard deviation of points around their lines, m, the last change of the poses (root mean
    square, m and rad), draws so far, and the time it took.
    """  # noqa: D205

    doing: str
    side_m: float
    spread_m: float
    change_m: float
    change_rad: float
    draws: int
    seconds: float


class TrajectoryRefinement:
    """The poses of K scans given their ranges and what was believed of them.

    Deterministic for a seed, however it is stopped and gone on with. `order` (K,) is the order
    the scans were taken in, by default that in which they are given; `times_s` (K,) is when, as
    far as that is known. With it, `beam_times` says when their beams were, and `speeds` (K, 3) how
    fast the sensor was (m/s, m/s, rad/s, as it saw itself). Poses that are `drifting` are those of
    odometry: they tell how the robot went from scan to scan, not where it was.
    """

    def __init__(
        self,
        placed: Sequence[tuple[Scan, PoseBelief]],
        config: TrajectoryConfig | None = None,
        *,
        moves: Moves | None = None,
        order: AnyArray | None = None,
        times_s: AnyArray | None = None,
        drifting: bool = False,
    ) -> None:
        if not placed:
            raise WindowError('no scan was recorded: expected at least one')
        self.config = TrajectoryConfig() if config is None else config
        self._seen = ScanPoints.of([scan for scan, _ in placed], self.config.max_range)
        self.points = self._seen  # bent for when beams were taken
        self.beam_times, self.speeds = BeamTimes.at_once(), np.zeros((len(placed), 3))
        self._times = None if times_s is None else np.asarray(times_s, np.float64)
        beliefs = [belief for _, belief in placed]
        self.order: Int64Array = np.asarray(
            np.arange(len(placed)) if order is None else order, np.int64
        )
        factors = PoseFactors.of(beliefs, self.config.standard_deviations, moves)
        self._drifting = drifting
        if drifting:
            factors = factors.of_odometry(self.order, self.config.standard_deviations)
        elif self.config.steps:
            own = Moves.of_localizer(factors.mean, self.order)
            factors = factors._replace(moves=own.and_those(factors.moves))
        if self.config.correlation and not drifting:  # these count as one belief already
            told = max(self.config.correlation, 0.0)  # below 0: to be learned
            factors = factors._replace(alike=Alike.in_order(self.order, told))
        self._said = self.factors = factors
        self.move_scales = np.ones(factors.moves.n_sources)
        self.poses = self.factors.mean.copy()
        # Aligned in squares that are fine enough to be worth it; with nothing left but draws.
        self.usable = self.aligned = False
        self.deviations: list[Float64Array] = []
        # How much poses are held by points and how these err, see `curvature`.
        self.held = self.shown = self.together = math.nan
        self._rng = np.random.default_rng(self.config.seed)
        self._fitted = 0.0  # so many numbers of the poses come from points
        self._fitting = np.random.default_rng((self.config.seed, 1))
        self._system: SurfelSystem | None = None
        self._steps = self._plan()
        self._began = time.monotonic()

    # -- refining ---------------------------------------------------------------------------

    @property
    def n_steps(self) -> int:
        """Number of steps until all is done, at most."""
        searching = 2 + sum(stage.steps for stage in SEARCH_STAGES) if self.config.search else 0
        searching = 1 if self._drifting else searching
        again = 1 + sum(stage.steps for stage in COARSE[1:])
        around = RECHECKS * (1 + sum(stage.steps for stage in STAGES[len(COARSE) - 1 :]))
        return (
            1
            + searching
            + again
            + around
            + sum(stage.steps for stage in STAGES)
            + self.config.draws
        )

    def run(
        self, max_time_s: float = math.inf, cancelled: Callable[[], bool] = lambda: False
    ) -> Iterator[TrajectoryProgress]:
        """Go on where it was left; yield after each step, until all is done or time is up."""
        until = time.monotonic() + max_time_s
        for progress in self._steps:
            yield progress
            if time.monotonic() >= until or cancelled():
                return

    def _plan(self) -> Iterator[TrajectoryProgress]:
        if self._drifting:
            before, moves = self.poses, self.factors.moves
            self.poses = look_up_along(self.points, before, moves, self.order, ALONG)
            yield self._progress('looked up in turn', 0.0, self.poses - before)
        elif self.config.search:
            look_up = LookUp()
            before = self.poses
            self.poses = look_up_in_turn(self.points, self.factors, self.order, look_up)
            yield self._progress('looked up in turn', 0.0, self.poses - before)
            for stage in SEARCH_STAGES:
                yield from self._aligning(stage)
            before = self.poses
            self.poses = relocate(self.points, self.poses, self.factors, look_up)
            yield self._progress('looked up again', 0.0, self.poses - before)
        for stage in COARSE:
            yield from self._aligning(stage)
        astray = self._astray()
        if 0 < astray.size < len(self.poses) and not self._drifting:
            before = self.poses
            self.poses = relocate(self.points, before, self.factors, ASTRAY, astray)
            yield self._progress('looked up those astray', 0.0, self.poses - before)
            for stage in COARSE[1:]:
                yield from self._aligning(stage)
        for stage in STAGES[len(COARSE) :]:
            yield from self._aligning(stage)
        for _ in range(RECHECKS):
            before = self.poses
            believed, far = self.factors, FAR_OFF
            if self._drifting:  # where odometry has them is no place to look
                believed, far = believed._replace(mean=before), NEAR_BY
            self.poses = recheck(self.points, before, believed, NEAR_BY, far)
            yield self._progress('looked around', 0.0, self.poses - before)
            if np.array_equal(self.poses, before):
                break
            for stage in STAGES[len(COARSE) - 1 :]:
                yield from self._aligning(stage)
        yield from self._drawing(STAGES[-1])

    def _aligning(self, stage: Stage) -> Iterator[TrajectoryProgress]:
        share = 1.0
        for step in range(stage.steps):
            before = self.poses
            self.poses, equations = align(self.points, before, self.factors, stage, self._fitted)
            self._system = equations.system
            if step % 2 == 0:  # they change little, and cost as much as the step itself
                share = self._held_by(equations, before, stage)
            blocks = share * self._system.blocks
            if stage.side_m <= RESCALED_FROM_M and step in TIMED_AFTER:
                self._time_beams(equations, before, share)
            if self.config.rescale:
                self.factors = self._rescaled(blocks, stage)
            if self.config.correlation < 0.0 and stage.side_m <= RESCALED_FROM_M:
                self.factors = self.factors.correlated(self.poses, blocks)
            if step + 1 == stage.steps and stage.side_m <= RESCALED_FROM_M:
                self.usable = True
            yield self._progress('aligned', stage.side_m, self.poses - before)

    def _time_beams(self, equations: NormalEquations, poses: Float64Array, held: float) -> None:
        """Find out when beams were taken from what was solved around poses (K, 3); bend points."""
        if self._times is None or not self.config.beam_times:
            return
        speeds = velocities(poses, self.order, self._times)
        if not speeds.known.any():
            return
        now, self.speeds = self.beam_times.seconds, speeds.found
        self.beam_times = shown_times(equations, self.points, poses, speeds, now, held, self.order)
        self.points = bent_points(self._seen, self.speeds, self.beam_times.seconds)

    def _held_by(self, equations: NormalEquations, poses: Float64Array, stage: Stage) -> float:
        """Return how much of what points around poses (K, 3) say of them is so (`held_share`).

        By the way, find out how many numbers of the poses its points decide.
        """
        probe = drawn_deviation(equations, self._fitting, accuracy=ROUGHLY)
        self._fitted = numbers_fitted(equations.system, probe)
        if stage.side_m > RESCALED_FROM_M:
            return 1.0
        return held_share(equations.system, self.points, poses, stage, probe)

    def _rescaled(self, of_points: Float64Array, stage: Stage) -> PoseFactors:
        """Return the factors, beliefs and moves as sure as poses show them to be."""
        said, factors = self._said, self.factors
        if stage.side_m <= RESCALED_FROM_M:
            said = said._replace(alike=factors.alike)
            factors = said.doubted(said.doubt(self.poses, of_points, factors))
        if self.move_scales.size:
            blocks = of_points + factors.precision
            self.move_scales = said.moves.shown_scales(self.poses, blocks, self.move_scales)
            factors = factors._replace(moves=said.moves.scaled(self.move_scales))
        return factors

    def _astray(self) -> Int64Array:
        """Return the scans that may be anywhere: little was said of them, or they fit badly."""
        assert self._system is not None
        variances = np.diagonal(np.linalg.inv(self.factors.precision), axis1=1, axis2=2)
        vague = (variances > np.square(VAGUE)).any(axis=1)
        weight = self._system.weight * self._system.variance
        sums = np.bincount(self._system.scan, weight, minlength=self.points.n_scans)
        share = sums / np.maximum(np.diff(self.points.starts), 1)
        bad = vague | (share < FITTING_SHARE * np.median(share))
        return np.flatnonzero(bad & (np.diff(self.points.starts) > 0))

    def _drawing(self, stage: Stage) -> Iterator[TrajectoryProgress]:
        system = SurfelSystem.around(self.points, self.poses, stage, self._fitted)
        equations = NormalEquations.around(system, self.factors, self.poses)
        self._system, nowhere = system, np.zeros_like(self.poses)
        square = map_squares(self.points, self.poses, system)
        held, shown, of_stretches = [], [], []
        for _ in range(PROBES):
            probe = drawn_deviation(equations, self._rng)
            held.append(held_share(system, self.points, self.poses, stage, probe))
            shown.append(shown_variance(system, square, probe))
            common = in_common(equations, probe)
            of_stretches.append(shown_variance(system, square, common))
        self.held, self.shown = float(np.mean(held)), float(np.mean(shown))
        # Less than single scans show is not believed of stretches.
        self.together = max(math.sqrt(float(np.mean(of_stretches)) / self.shown), 1.0)
        wider = self.config.inflation * math.sqrt(self.shown) * widening(system, self.held)
        self.aligned = True
        yield self._progress('curvature measured', stage.side_m, nowhere)
        for _ in range(self.config.draws):
            drawn = drawn_deviation(equations, self._rng, wider, together=self.together)
            if self._drifting:
                spread = np.array(self.config.standard_deviations)
                drawn = moved_as_one(drawn, self.poses, spread * self._rng.normal(size=3))
            self.deviations.append(drawn)
            yield self._progress('drawn', stage.side_m, nowhere)

    def _progress(self, doing: str, side_m: float, change: Float64Array) -> TrajectoryProgress:
        spread = math.nan if self._system is None else math.sqrt(self._system.variance)
        squares = wrapped(change) ** 2
        return TrajectoryProgress(
            doing,
            side_m,
            spread,
            math.sqrt(float(squares[:, :2].sum(axis=1).mean())),
            math.sqrt(float(squares[:, 2].mean())),
            len(self.deviations),
            time.monotonic() - self._began,
        )

    # -- sensor numbers out -----------------------------------------------------------------

    @property
    def point_spread(self) -> tuple[float, float, float] | None:
        """Standard deviation of a point around its line, m, between the ends of its 95 % interval.

        None before the first step. The interval takes points for independent.
        """
        if self._system is None:
            return None
        spread = math.sqrt(self._system.variance)
        half = 1.96 * spread * 0.5 * self._system.doubt
        return max(spread - half, 0.0), spread, spread + half

    @property
    def correlation(self) -> Float64Array:
        """How alike errors of beliefs are from scan to scan (3,), place, place, heading."""
        return self.factors.alike.correlation

    @property
    def belief_scale(self) -> float:
        """How many times the covariances of beliefs are what they say, as taken by now."""
        if not self.factors.said.any():
            return 1.0
        k = int(np.argmax(self.factors.said))
        return float(self._said.precision[k, 0, 0] / self.factors.precision[k, 0, 0])

    # -- poses out --------------------------------------------------------------------------

    def trajectory(self) -> list[Pose2D]:
        """Return the poses as they are now."""
        return poses_of(self.poses)

    @property
    def finished(self) -> bool:
        """Whether all that the settings ask for is done."""
        return len(self.deviations) >= self.config.draws

    @property
    def covariances_known(self) -> bool:
        """Whether there are enough draws for covariances."""
        return len(self.deviations) >= 2

    def covariances(self, *, apart: bool = False) -> Float64Array:
        """Return the covariance (K, 3, 3) of every pose; nan before two draws.

        apart  without the motion that all poses have in common
        """
        if not self.covariances_known:
            return np.full((len(self.poses), 3, 3), np.nan)
        drawn = np.array(self.deviations)
        if apart:
            drawn = without_common_motion(drawn, self.poses)
        covariances: Float64Array = np.einsum('ski,skj->kij', drawn, drawn) / len(drawn)
        return covariances

    def beliefs(self) -> list[PoseBelief]:
        """Return the poses with their covariances, once there are any."""
        return [
            PoseBelief(pose, covariance if self.covariances_known else None)
            for pose, covariance in zip(self.trajectory(), self.covariances(), strict=True)
        ]

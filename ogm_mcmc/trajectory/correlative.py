"""A first alignment where poses are further off than squares of a metre reach.

Each scan is looked up, one after the other, in a field of what the scans before it saw
(correlative scan matching: Olson 2009, "Real-time correlative scan matching"): at all poses of a
lattice around its belief, then on a finer one. A scan that was put down wrongly leads others
astray, so later every scan is looked up once more, in a field of all scans but those of its part
(every fourth): `relocate`. Poses that alignment came to are looked at once more in this way, most
of them near by only: `recheck`.

Odometry says where a scan is from the one before, and not where in the map. So its scans are
looked up in turn where the move from the one before puts them: `look_up_along`.
"""

from __future__ import annotations

import math
from copy import copy
from dataclasses import dataclass

import numpy as np

from ogm_mcmc.arrays import AnyArray, Float32Array, Float64Array, Int64Array
from ogm_mcmc.errors import require
from ogm_mcmc.trajectory.correlative_kernels import best_pose, paint, paint_free
from ogm_mcmc.trajectory.factors import PoseFactors
from ogm_mcmc.trajectory.moves import Moves, composed
from ogm_mcmc.trajectory.points import ScanPoints, wrapped

__all__ = ['LookUp', 'look_up_along', 'look_up_in_turn', 'recheck', 'relocate']

# Parts that are looked up in what all the others saw.
PARTS = 4

# A pose is given up for one that is likelier by so many nats.
SURER_BY = 5.0

# Scans whose points score so small a share of what is usual fit badly.
FITTING_SHARE = 0.75

# Space that others looked through is free from so many `blur_m` before what they saw.
FREE_FROM = 1.5

# A field that scans leave is made wider by so much on every side, m.
WIDER_M = 10.0

# The first look is at every other point.
COARSE_STRIDE = 2


@dataclass(frozen=True)
class LookUp:
    """How scans are looked up; lengths m, angles rad."""

    reach_m: float = 1.5
    reach_rad: float = 0.3
    step_m: float = 0.1
    step_rad: float = 0.025
    cell_m: float = 0.05
    blur_m: float = 0.1
    floor: float = 0.1
    """Likelihood of a point far from everything, as a share of the highest."""
    in_free: float = 0.0
    """Likelihood of a point where others looked through, as a share of `floor`; 0: the floor."""
    power: float = 0.5
    """Exponent of the likelihood of a scan: its points do not err independently."""

    def __post_init__(self) -> None:
        """Refuse what is no lattice."""
        for name in ('step_m', 'step_rad', 'cell_m', 'blur_m', 'floor', 'power'):
            require(getattr(self, name) > 0.0, name, getattr(self, name), 'must be positive')

    def kernel(self) -> Float32Array:
        """Return log(floor + exp(-d^2 / 2 blur^2)) - log(floor), times `power`."""
        half = math.ceil(3.0 * self.blur_m / self.cell_m)
        d = np.arange(-half, half + 1) * self.cell_m
        distance = np.hypot(d[:, None], d) / self.blur_m
        return np.asarray(self.of_near(distance), np.float32)

    def of_near(self, distance: AnyArray | float) -> AnyArray:
        """Return the log-likelihood of points so many `blur_m` from others, as in `kernel`."""
        near = np.exp(-0.5 * np.square(distance))
        return np.asarray(self.power * np.log1p(near / self.floor))

    @property
    def of_free(self) -> float:
        """Log-likelihood of a point where others looked through, times `power`; 0 elsewhere."""
        return self.power * math.log(self.in_free) if self.in_free > 0.0 else 0.0


class _Field:
    """What scans saw, blurred: the likeliest of what any of their points says."""

    def __init__(self, points: ScanPoints, poses: Float64Array, settings: LookUp) -> None:
        self.points, self.settings, self.kernel = points, settings, settings.kernel()
        placed = points.placed(poses)
        margin = settings.reach_m + 1.0
        self.corner = np.minimum(placed.min(axis=0), poses[:, :2].min(axis=0)) - margin
        size = np.maximum(placed.max(axis=0), poses[:, :2].max(axis=0)) + margin - self.corner
        width, height = np.ceil(size / settings.cell_m).astype(int)
        self.values = np.zeros((height, width), np.float32)

    def within(self, settings: LookUp) -> _Field:
        """Return the same field, looked at with another lattice of poses."""
        other = copy(self)
        other.settings = settings
        return other

    def make_room(self, k: int, pose: Float64Array) -> None:
        """Make it wider until it holds the points of scan k at a pose, and around that."""
        cell_m, ends = self.settings.cell_m, self._ends(k, pose)
        around = (self.settings.reach_m + 1.0) / cell_m
        size = np.array(self.values.shape[::-1])[:, None]
        out = max(np.max(around - ends, initial=0.0), np.max(ends + around - size, initial=0.0))
        if out > 0.0:
            cells = math.ceil(out) + round(WIDER_M / cell_m)
            self.values = np.pad(self.values, cells)
            self.corner = self.corner - cells * cell_m

    def add(self, scans: AnyArray, poses: Float64Array) -> None:
        """Paint scans as the poses (K, 3) place them; all at once where free space counts."""
        ends = [self._ends(k, poses[k]) for k in scans]
        for x, y in ends:
            paint(self.values, self.kernel, x.astype(np.int64), y.astype(np.int64))
        settings = self.settings
        if settings.of_free == 0.0:
            return
        near = FREE_FROM * settings.blur_m / settings.cell_m
        below = float(settings.of_near(FREE_FROM))
        for k, (x, y) in zip(scans, ends, strict=True):
            at = (poses[k, :2] - self.corner) / settings.cell_m
            paint_free(
                self.values, at[0], at[1], x, y, near, below, settings.of_free
            )  # fmt: skip

    def _ends(self, k: int, pose: Float64Array) -> Float64Array:
        """Return x and y (2, n) of the points of scan k in the field, cells."""
        local = self.points.local[self.points.starts[k] : self.points.starts[k + 1]]
        cosine, sine = math.cos(pose[2]), math.sin(pose[2])
        x = pose[0] + cosine * local[:, 0] - sine * local[:, 1] - self.corner[0]
        y = pose[1] + sine * local[:, 0] + cosine * local[:, 1] - self.corner[1]
        return np.stack((x, y)) / self.settings.cell_m

    def look_up(
        self, k: int, at: Float64Array, factors: PoseFactors, *, wide: bool
    ) -> tuple[float, Float64Array]:
        """Return the score and the best pose of scan k around `at`, far and then near."""
        points, settings = self.points, self.settings
        local = points.local[points.starts[k] : points.starts[k + 1]]
        shift = np.array([*self.corner, 0.0])
        mean, precision = factors.mean[k] - shift, factors.precision[k]
        scale = 1.0 / settings.cell_m
        pose = at - shift
        if wide:
            # Half of the points count twice.
            _, *found = best_pose(
                self.values, np.ascontiguousarray(local[::COARSE_STRIDE]), pose, mean,
                precision / COARSE_STRIDE, round(settings.reach_m / settings.step_m),
                settings.step_m, round(settings.reach_rad / settings.step_rad),
                settings.step_rad, scale,
            )  # fmt: skip
            pose = np.array(found)
        score, *found = best_pose(
            self.values, local, pose, mean, precision,
            4, settings.step_m / 4.0, 5, settings.step_rad / 5.0, scale,
        )  # fmt: skip
        return float(score), wrapped(np.array(found) + shift)


def look_up_in_turn(
    points: ScanPoints, factors: PoseFactors, order: Int64Array, settings: LookUp
) -> Float64Array:
    """Return poses (K, 3): the first scan of `order` (K,) as believed, each other looked up."""
    poses = factors.mean.copy()
    field = _Field(points, poses, settings)
    for n, k in enumerate(order):
        if n:
            _, poses[k] = field.look_up(int(k), factors.mean[k], factors, wide=True)
        field.add(order[n : n + 1], poses)
    return poses


def look_up_along(
    points: ScanPoints, start: Float64Array, moves: Moves, order: Int64Array, settings: LookUp
) -> Float64Array:
    """Return poses (K, 3): scans of `order` (K,) looked up where moves from others put them.

    Each is looked up in what all before it saw, with the move (of the first source) as what is
    believed of it. A scan that none leads to stays at `start` (K, 3).
    """
    poses = start.copy()
    leads = {int(moves.second[m]): int(m) for m in np.flatnonzero(moves.source == 0)}
    mean, precision = start.copy(), np.zeros((len(start), 3, 3))
    believed = PoseFactors(mean, precision, Moves.none(), np.ones(len(start), np.bool_))
    field = _Field(points, poses, settings)
    for n, k in enumerate(order):
        if (m := leads.get(int(k))) is not None:
            before = poses[moves.first[m]]
            mean[k] = composed(before, moves.move[m])
            cosine, sine = math.cos(before[2]), math.sin(before[2])
            turned = np.array([(cosine, -sine, 0.0), (sine, cosine, 0.0), (0.0, 0.0, 1.0)])
            precision[k] = turned @ moves.precision[m] @ turned.T
            field.make_room(int(k), mean[k])
            _, poses[k] = field.look_up(int(k), mean[k], believed, wide=True)
        field.add(order[n : n + 1], poses)
    return poses


def relocate(
    points: ScanPoints,
    poses: Float64Array,
    factors: PoseFactors,
    settings: LookUp,
    which: AnyArray | None = None,
) -> Float64Array:
    """Return the poses (K, 3) after every scan was looked up in what those of other parts saw.

    Far from where it is only where that is likelier than the best pose near by. With `which`
    only those scans are, in what all the others saw.
    """
    result = poses.copy()
    everyone = np.arange(points.n_scans)
    part_of = everyone % PARTS
    if which is not None:
        part_of = np.isin(everyone, which) - 1
    for part in range(part_of.max() + 1):
        field = _Field(points, poses, settings)
        field.add(everyone[part_of != part], poses)
        for k in everyone[part_of == part]:
            near, _ = field.look_up(int(k), poses[k], factors, wide=False)
            far, pose = field.look_up(int(k), factors.mean[k], factors, wide=True)
            if far > near and np.abs(wrapped(pose - poses[k])).max() > settings.step_m:
                result[k] = pose
    return result


def recheck(
    points: ScanPoints, poses: Float64Array, factors: PoseFactors, near: LookUp, far: LookUp
) -> Float64Array:
    """Return poses (K, 3), those put elsewhere that fit better there, by `SURER_BY` nats.

    Every scan is looked up around where it is in what those of other parts saw; those that fit
    badly for their number of points, also around where they are believed to be, as `far` says.
    None does where most points lie in free space: nothing is usual there.
    """
    result = poses.copy()
    everyone = np.arange(points.n_scans)
    count = np.maximum(np.diff(points.starts), 1)
    score, found = np.zeros(count.size), np.zeros(count.size)
    fields = []
    for part in range(min(PARTS, count.size)):
        field = _Field(points, poses, near)
        field.add(everyone[everyone % PARTS != part], poses)
        fields.append(field)
        for k in everyone[part::PARTS]:
            score[k], _ = field.look_up(int(k), poses[k], factors, wide=False)
            found[k], pose = field.look_up(int(k), poses[k], factors, wide=True)
            if _is_better(found[k] - score[k], pose - poses[k], near):
                result[k] = pose
    usual = float(np.median(score / count))
    # A share of a number below 0 is above it: most scans would be below that share.
    badly = found / count < FITTING_SHARE * usual if usual > 0.0 else np.zeros(count.size, bool)
    for k in np.flatnonzero(badly):
        # The field of a larger reach would only be wider: nothing is known out there.
        wide = fields[k % PARTS].within(far)
        best, pose = wide.look_up(int(k), factors.mean[k], factors, wide=True)
        if _is_better(best - max(score[k], found[k]), pose - poses[k], far):
            result[k] = pose
    return result


def _is_better(gain: float, step: Float64Array, settings: LookUp) -> bool:
    moved = np.abs(wrapped(step)) > (settings.step_m, settings.step_m, settings.step_rad)
    return bool(gain > SURER_BY and moved.any())

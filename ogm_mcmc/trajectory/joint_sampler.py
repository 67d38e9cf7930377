"""Exact sampling of maps and poses together: p(m, x | z), cells of a grid and poses of scans.

    p(m, x | z) ~ prod over cells of p(m_c) * p(x) * prod over scans and beams of p(z | m, x_k)

p(m_c) is one prior for all cells, p(x) the factors of `ogm_mcmc.trajectory.factors`, p(z | m, x)
the forward model of the package for the first occupied cell on the beam, rays followed as far as
the window says. Cells are those of a box; poses from which a ray leaves it have probability 0.

One round leaves it invariant, since each part of it does:

map    sweeps of `CellModel` at the present poses ([gibbs] Eq. 3: exact conditionals); then every
       cell no ray touches is drawn from the prior, its conditional: rays of other poses meet it.
poses  the trajectory is cut into stretches of one length, from a random offset. Each is moved
       rigidly, turned about the mean of its positions, by a draw that is as probable backwards
       (the middle moves along, the Jacobian is 1), and accepted with min(1, p' / p). Given the
       map, stretches are independent but for measured moves from one to the next, and errors that
       are alike from one scan to the next: where there are any, only every other one is moved, so
       each ratio is that of one stretch alone.
shares clutter and missing, each on a ladder of values: one step up or down, as probable backwards
       (at the ends it stays), accepted with min(1, p' / p): a Beta prior times the likelihood of
       all beams. With a ladder only; else they are given.

Likelihoods of proposals come from a `RayWindow` of their own, so they are those that the sweeps
use, to the last rounding. Single scans freeze against a sharp map and whole stretches against
what others saw of the same walls: this is exact, not fast. See the note in the package.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, Protocol

import numpy as np
from numpy.random import Generator

from ogm_mcmc.arrays import AnyArray, BoolArray, Float64Array, Int64Array, UInt8Array
from ogm_mcmc.config import ChainConfig, ForwardModelConfig, WindowConfig
from ogm_mcmc.errors import WindowError, require
from ogm_mcmc.geometry import CellBox, GridSpec, PlacedScan, Scan
from ogm_mcmc.sampling import CellModel, RayWindow, WindowSize
from ogm_mcmc.sampling.first_hits import first_hits
from ogm_mcmc.trajectory.factors import PoseFactors
from ogm_mcmc.trajectory.points import poses_of, wrapped

__all__ = [
    'JointPosterior',
    'JointState',
    'Proposal',
    'RigidStretches',
    'ShareLadder',
    'split_r_hat',
]


class Proposal(Protocol):
    """Where stretches of a trajectory may go; must be as probable backwards."""

    def length(self, rng: Generator) -> int:
        """Draw how many scans a stretch has."""
        ...

    def moved(self, rng: Generator, poses: Float64Array, stretch: Int64Array) -> Float64Array:
        """Return proposed poses (K, 3); scan k belongs to stretch number `stretch[k]`."""
        ...


@dataclass(frozen=True)
class RigidStretches:
    """Rigid moves of stretches of one of the lengths: normal steps, times one of `factors`.

    A stretch of n scans moves 1 / sqrt(n) as far: that is how its posterior narrows.
    """

    step_m: float = 0.01
    step_rad: float = 0.003
    lengths: tuple[int, ...] = (1, 1, 1, 8, 64)
    factors: tuple[float, ...] = (0.2, 1.0)

    def length(self, rng: Generator) -> int:
        """Draw how many scans a stretch has."""
        return int(rng.choice(self.lengths))

    def moved(self, rng: Generator, poses: Float64Array, stretch: Int64Array) -> Float64Array:
        """Return proposed poses (K, 3)."""
        count: Float64Array = np.bincount(stretch).astype(np.float64)
        steps = rng.standard_normal((count.size, 3)) * (self.step_m, self.step_m, self.step_rad)
        steps *= float(rng.choice(self.factors)) / np.sqrt(np.maximum(count, 1.0))[:, None]
        sums = np.column_stack([np.bincount(stretch, poses[:, d]) for d in (0, 1)])
        middle = sums / np.maximum(count, 1.0)[:, None]
        dx, dy = (poses[:, :2] - middle[stretch]).T
        cosine, sine = np.cos(steps[stretch, 2]), np.sin(steps[stretch, 2])
        proposed = poses + steps[stretch]
        proposed[:, 0] += cosine * dx - sine * dy - dx
        proposed[:, 1] += sine * dx + cosine * dy - dy
        return wrapped(proposed)


@dataclass(frozen=True)
class ShareLadder:
    """Values that the shares of clutter and of missing returns may have, in rising order.

    Their prior is Beta(1, `seen_before` - 1), as if so many beams had been right, for each value
    by as much of the ladder as it stands for: half way to its neighbours, one for either end.
    """

    values: tuple[float, ...] = (0.001, 0.002, 0.005, 0.01, 0.02, 0.03, 0.05, 0.07, 0.1, 0.14, 0.2)
    seen_before: float = 100.0

    def __post_init__(self) -> None:
        """Refuse what are no shares of two kinds, or stand in no order."""
        values = np.asarray(self.values, np.float64)
        rising = values.size > 1 and bool((np.diff(values) > 0.0).all())
        require(rising and values[0] > 0.0, 'values', self.values, 'expected to rise from above 0')
        require(values[-1] < 0.5, 'values', self.values, 'expected below 0.5')

    def log_priors(self) -> Float64Array:
        """Return the log-probability of every value, up to a constant."""
        values = np.asarray(self.values, np.float64)
        gaps = np.diff(values, prepend=values[0], append=values[-1])  # 0 beyond either end
        stands_for = 0.5 * (gaps[:-1] + gaps[1:])
        return (self.seen_before - 2.0) * np.log1p(-values) + np.log(stands_for)


class JointState(NamedTuple):
    """A map, `cells` (H * W,) uint8 of the box, the `poses` (K, 3) and log p(z | m, x) (K,).

    `shares`: where on the ladder clutter and missing stand; without one they say nothing.
    """

    cells: UInt8Array
    poses: Float64Array
    log_likelihoods: Float64Array
    shares: tuple[int, int] = (0, 0)


class JointPosterior:
    """Maps and poses of K scans; `box` are the lattice cells that a map has.

    `order` (K,): the scans in the order they were taken; measured moves, and errors that are
    alike, lead from one to the next of it. `ladder`: clutter and missing returns of the sensor are
    drawn as well. Raises WindowError where the box does not hold the rays from the believed poses,
    ConfigError for moves between scans that are no neighbours.
    """

    def __init__(
        self,
        scans: Sequence[Scan],
        factors: PoseFactors,
        box: CellBox,
        *,
        window: WindowConfig,
        model: ForwardModelConfig,
        chain: ChainConfig,
        proposal: Proposal | None = None,
        order: AnyArray | None = None,
        ladder: ShareLadder | None = None,
    ) -> None:
        self.ladder = ladder
        self.scans, self.factors, self.box = list(scans), factors, box
        self.window, self.model, self.chain = window, model, chain
        self.proposal: Proposal = RigidStretches() if proposal is None else proposal
        count = len(self.scans)
        self.place = np.empty(count, np.int64)  # in the order
        self.place[np.arange(count) if order is None else order] = np.arange(count)
        first, second = factors.neighbours
        apart = np.abs(self.place[first] - self.place[second])
        neighbours = bool((apart == 1).all())
        require(neighbours, 'moves', apart.max(initial=0), 'expected from each scan to the next')
        self.spec = GridSpec(window.resolution, 1, 1).windowed(box)
        sizes = self._sizes(factors.mean)
        if not all(box.covers(size.box) for size in sizes):
            raise WindowError('the box of the map: expected to hold all rays of the scans')
        self.rays = np.array([size.rays for size in sizes], np.int64)

    def _sizes(self, poses: Float64Array) -> list[WindowSize]:
        empty = RayWindow(self.window, self.model)
        return [
            empty.size_of(PlacedScan.at(scan, pose))
            for scan, pose in zip(self.scans, poses_of(poses), strict=True)
        ]

    # -- the density ------------------------------------------------------------------------

    def model_at(self, shares: tuple[int, int]) -> ForwardModelConfig:
        """Return the sensor's model with clutter and missing at these steps of the ladder."""
        if self.ladder is None:
            return self.model
        clutter, missing = (self.ladder.values[step] for step in shares)
        return replace(self.model, clutter=clutter, missing=missing)

    def log_likelihoods(
        self,
        cells: UInt8Array,
        poses: Float64Array,
        which: AnyArray | None = None,
        shares: tuple[int, int] = (0, 0),
    ) -> Float64Array:
        """Return log p(z | m, x) of the scans `which` (n,), nats; -inf from outside of the box."""
        chosen = np.arange(len(self.scans)) if which is None else which
        placed = poses_of(poses[chosen])
        empty = RayWindow(self.window, self.model)
        inside = [
            self.box.covers(empty.size_of(PlacedScan.at(self.scans[k], pose)).box)
            for k, pose in zip(chosen, placed, strict=True)
        ]
        result = np.full(chosen.size, -np.inf)
        used = np.flatnonzero(inside)
        rays = RayWindow(self.window, self.model_at(shares))
        rays.add(PlacedScan.at(self.scans[chosen[i]], placed[i]) for i in used)
        per_scan = self.rays[chosen[used]]
        if per_scan.sum() == 0:
            result[used] = 0.0
            return result
        part = self._part(cells, rays.spec)
        values = first_hits(part, rays.index).view(np.float32)[:, 1].astype(np.float64)
        owner = np.repeat(np.arange(used.size), per_scan)
        result[used] = np.bincount(owner, values, minlength=used.size)
        return result

    def _part(self, cells: UInt8Array, spec: GridSpec) -> UInt8Array:
        whole = cells.reshape(self.spec.height, self.spec.width)
        return np.ascontiguousarray(whole[self.spec.slices(spec.box)]).reshape(-1)

    def log_posterior(self, state: JointState) -> float:
        """Return log p(m, x | z) up to a constant, nats."""
        prior = self.chain.prior_log_odds * float(np.count_nonzero(state.cells))
        poses = self.factors.log_density(state.poses)
        result = prior + poses + float(state.log_likelihoods.sum())
        if self.ladder is not None:
            result += float(self.ladder.log_priors()[list(state.shares)].sum())
        return result

    # -- a chain ----------------------------------------------------------------------------

    def start(
        self, cells: UInt8Array, poses: Float64Array, shares: tuple[int, int] = (0, 0)
    ) -> JointState:
        """Return the state of a map (H * W,), poses (K, 3) and steps of the ladder."""
        values = self.log_likelihoods(cells, poses, shares=shares)
        return JointState(cells.copy(), poses.copy(), values, shares)

    def advance(
        self, rng: Generator, state: JointState, *, sweeps: int = 1, tries: int = 1
    ) -> tuple[JointState, float]:
        """Return the state after so many sweeps of the map and tries of the poses.

        With it the share of scans whose move was accepted, of those that were tried.
        """
        state = self.sweep_map(rng, state, sweeps)
        accepted = tried = 0
        for _ in range(tries):
            state, moving, moved = self.move_poses(rng, state)
            tried, accepted = tried + moving, accepted + moved
        state = self.move_shares(rng, state)
        return state, accepted / max(tried, 1)

    def sweep_map(self, rng: Generator, state: JointState, sweeps: int) -> JointState:
        """Draw the map so many times, given the poses."""
        rays = RayWindow(self.window, self.model_at(state.shares), chains=1)
        rays.add(map(PlacedScan.at, self.scans, poses_of(state.poses)))
        model = CellModel(rays.index, self.chain.prior_log_odds, rays.spec.width, self.chain.order)
        part = model.start(self._part(state.cells, rays.spec))
        for _ in range(sweeps):
            model.advance(rng, part)
        cells = (rng.random(state.cells.size) < self.chain.prior).astype(np.uint8)
        whole = cells.reshape(self.spec.height, self.spec.width)
        mine = np.zeros(part.cells.size, np.bool_)
        mine[model.touched] = True
        shape = (rays.spec.height, rays.spec.width)
        view = whole[self.spec.slices(rays.spec.box)]
        view[mine.reshape(shape)] = part.cells[mine]
        values = part.records.view(np.float32)[:, 1].astype(np.float64)
        owner = np.repeat(np.arange(len(self.scans)), self.rays)
        sums = np.bincount(owner, values, minlength=len(self.scans))
        return JointState(cells, state.poses, np.asarray(sums, np.float64), state.shares)

    def move_poses(self, rng: Generator, state: JointState) -> tuple[JointState, int, int]:
        """Propose stretches, accept each or not; count the scans that were tried and moved."""
        length = self.proposal.length(rng)
        stretch = (self.place + int(rng.integers(length))) // length
        moving = np.ones(len(self.scans), np.bool_)
        if self.factors.neighbours[0].size:
            moving = stretch % 2 == int(rng.integers(2))
        proposed = self.proposal.moved(rng, state.poses, stretch)
        proposed[~moving] = state.poses[~moving]
        which = np.flatnonzero(moving)
        likelihoods = state.log_likelihoods.copy()
        likelihoods[which] = self.log_likelihoods(state.cells, proposed, which, state.shares)
        ratio = self._log_ratios(state, proposed, likelihoods, stretch, moving)
        yes = np.log1p(-rng.random(ratio.size)) < ratio
        taken = yes[stretch] & moving
        poses = np.where(taken[:, None], proposed, state.poses)
        likelihoods = np.where(taken, likelihoods, state.log_likelihoods)
        moved = state._replace(poses=poses, log_likelihoods=likelihoods)
        return moved, int(moving.sum()), int(taken.sum())

    def move_shares(self, rng: Generator, state: JointState) -> JointState:
        """Propose a step of clutter, then one of missing; accept each or not."""
        if self.ladder is None:
            return state
        for which in (0, 1):
            steps = list(state.shares)
            steps[which] += 1 if rng.random() < 0.5 else -1
            if not 0 <= steps[which] < len(self.ladder.values):
                continue
            proposed = self.start(state.cells, state.poses, (steps[0], steps[1]))
            ratio = self.log_posterior(proposed) - self.log_posterior(state)
            if np.log1p(-rng.random()) < ratio:
                state = proposed
        return state

    def _log_ratios(
        self,
        state: JointState,
        proposed: Float64Array,
        likelihoods: Float64Array,
        stretch: Int64Array,
        moving: BoolArray,
    ) -> Float64Array:
        """Return log p' / p of every stretch, all others where they are."""
        gain = likelihoods - state.log_likelihoods
        gain += self.factors.of_beliefs(proposed) - self.factors.of_beliefs(state.poses)
        ratio = np.bincount(stretch, np.where(moving, gain, 0.0))
        first, second = self.factors.neighbours
        between = self.factors.between(proposed) - self.factors.between(state.poses)
        owner = np.where(moving[first], stretch[first], stretch[second])
        np.add.at(ratio, owner, between)
        return np.asarray(ratio, np.float64)


def split_r_hat(draws: AnyArray) -> Float64Array:
    """Return R-hat (...) of draws (C, S, ...): C chains of S draws, each cut into two halves.

    Gelman et al. 2013, "Bayesian Data Analysis", section 11.4. Raises ConfigError for less than
    four draws of a chain.
    """
    values = np.asarray(draws, np.float64)
    half = values.shape[1] // 2
    require(half >= 2, 'draws', values.shape[1], 'expected at least 4 of every chain')
    parts = np.concatenate((values[:, :half], values[:, -half:]))
    within = parts.var(axis=1, ddof=1).mean(axis=0)
    between = parts.mean(axis=1).var(axis=0, ddof=1)
    with np.errstate(divide='ignore', invalid='ignore'):
        ratio = np.sqrt((half - 1.0) / half + between / within)
    return np.asarray(np.where(between == 0.0, 1.0, ratio), np.float64)

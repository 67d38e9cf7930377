"""The adaptive map: cells as large as what was seen in them allows ([pose] section VI)."""

from __future__ import annotations

import math
from statistics import NormalDist
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ogm_mcmc.arrays import Float32Array, Float64Array, UInt8Array
from ogm_mcmc.config import MapperConfig
from ogm_mcmc.errors import require
from ogm_mcmc.geometry import (
    CellBox,
    GridSpec,
    Pose2D,
    PoseBelief,
    PoseSamples,
    Rays,
    Scan,
    cast_rays,
)
from ogm_mcmc.mapping.belief_samples import belief_samples
from ogm_mcmc.mapping.quadtree import Quadtree, Trail, TreeStatistics
from ogm_mcmc.mapping.quadtree_kernels import (
    ACTIVE,
    apply_evidence,
    count_seen,
    count_unknowns,
    mark_again,
    merge_leaves,
    split_leaves,
)

__all__ = ['AdaptiveMapper', 'PlacedBeams', 'chi_square_limit']

Int64Array = npt.NDArray[np.int64]

# A beam is followed behind its end up to just inside the window, so that rounding stays there.
INSIDE = 1e-6

# More than the cells by which a walk may exceed the sides of the box around it.
SPARE = 8
TRAIL_SIZE = 4096


class PlacedBeams(NamedTuple):
    """The beams of a scan from every pose sample, in cells relative to each sensor's own cell.

    `column`, `row`: that cell, relative to the tree's; `x`, `y`: the sensor in it; `end_x`,
    `end_y`: where the reading ends; `last_x`, `last_y`: how far behind it cells are unknown;
    `hit`: whether something was hit; `sample`, `weight`: of the pose.
    """

    column: Int64Array
    row: Int64Array
    x: Float64Array
    y: Float64Array
    end_x: Float64Array
    end_y: Float64Array
    last_x: Float64Array
    last_y: Float64Array
    hit: UInt8Array
    sample: Int64Array
    weight: Float64Array


def chi_square_limit(significance: float, degrees: int) -> float:
    """Value a chi-square variable exceeds with probability `significance`; 1 or 2 degrees."""
    if significance <= 0.0:
        return math.inf
    if significance >= 1.0:
        return 0.0
    if degrees == 2:
        return -2.0 * math.log(significance)
    return NormalDist().inv_cdf(0.5 * significance) ** 2


class AdaptiveMapper:
    """A quadtree whose leaves split where counts contradict each other, and merge where not.

    For every scan: count hits, misses and unknowns per leaf, weighted by the pose samples; split
    what a chi-square test refuses, and count again there, until nothing splits; add the mean
    log-odds over the samples ([pose] Eq. 9) to every leaf seen; merge. `finest_level` and
    `coarsest_level` 0 make a regular grid, the same map as `two_assumption`.
    """

    def __init__(self, config: MapperConfig) -> None:
        self.config = config
        self.settings = config.adaptive
        for name in ('finest_level', 'output_level'):
            level = getattr(self.settings, name)
            require(
                level <= self.settings.coarsest_level,
                f'adaptive.{name}',
                level,
                f'must not be above adaptive.coarsest_level ({self.settings.coarsest_level})',
            )
        self.tree = Quadtree(self.settings.coarsest_level, config.max_cells)
        self._lattice = GridSpec(config.resolution, 1, 1)
        self._rng = np.random.default_rng(self.settings.seed)
        # The values of the other methods, in float32 as they have them.
        self._l_free = float(np.float32(config.step.l_free))
        self._l_occ = float(np.float32(config.step.l_occ))
        self._prior = np.float32(math.log(config.prior) - math.log1p(-config.prior))
        self._limit = np.float32(config.log_odds_limit)
        significance = self.settings.significance
        self._split_above = chi_square_limit(significance, 2 if self.settings.unknowns else 1)
        self._merge_below = chi_square_limit(significance, 1)

    @property
    def spec(self) -> GridSpec:
        """Where the output cells lie."""
        level, box = self.settings.output_level, self.tree.box
        return GridSpec(
            self.config.resolution * 2**level,
            (box.column1 - box.column0) >> level,
            (box.row1 - box.row0) >> level,
            box.column0 >> level,
            box.row0 >> level,
        )

    def update(self, scan: Scan, belief: PoseBelief) -> CellBox:
        """Add one scan; see `MappingMethod.update`."""
        samples = belief_samples(belief, self.settings.samples, self._rng)
        casts = [self._cast(scan, pose) for pose in samples.poses]
        seen = CellBox(0, 0, 0, 0)
        for rays in casts:
            if rays.n_rays:
                seen = seen.union(rays.box)
        if seen.empty:
            return seen
        self.tree.cover(seen)
        beams = self._place(casts, samples, seen, scan)
        self._count_and_split(beams)
        return self._apply_and_merge()

    def _cast(self, scan: Scan, pose: Float64Array) -> Rays:
        return cast_rays(
            scan,
            Pose2D(*pose.tolist()),
            self._lattice,
            max_range_m=self.config.max_range,
            no_return_clears=self.config.no_return == 'clear',
        )

    def _place(
        self, casts: list[Rays], samples: PoseSamples, seen: CellBox, scan: Scan
    ) -> PlacedBeams:
        """All beams of all samples, relative to the tree."""
        counts = [rays.n_rays for rays in casts]

        def per_beam(values: list[float]) -> Float64Array:
            return np.repeat(np.array(values, np.float64), counts)

        column = np.repeat(np.array([r.column - self.tree.column0 for r in casts]), counts)
        row = np.repeat(np.array([r.row - self.tree.row0 for r in casts]), counts)
        x, y = per_beam([r.x for r in casts]), per_beam([r.y for r in casts])
        end_x, end_y = np.concatenate([r.ends[:, : r.n_rays] for r in casts], axis=1)
        reach = scan.range_max_m
        if self.config.max_range > 0.0:
            reach = min(reach, self.config.max_range)
        last_x, last_y = self._behind(
            column, row, x, y, end_x, end_y, reach / self.config.resolution, seen
        )
        return PlacedBeams(
            column,
            row,
            x,
            y,
            np.ascontiguousarray(end_x),
            np.ascontiguousarray(end_y),
            last_x,
            last_y,
            np.concatenate([r.hit[: r.n_rays] for r in casts]),
            np.repeat(np.arange(len(casts)), counts),
            np.repeat(samples.weights, counts),
        )

    def _behind(
        self,
        column: Int64Array,
        row: Int64Array,
        x: Float64Array,
        y: Float64Array,
        end_x: Float64Array,
        end_y: Float64Array,
        reach: float,
        seen: CellBox,
    ) -> tuple[Float64Array, Float64Array]:
        """Where beams would have ended at `reach`, or where they leave the tiles that were seen.

        Leaves further away are touched by no beam of this scan.
        """
        dx, dy = end_x - x, end_y - y
        length = np.hypot(dx, dy)
        coarsest, tree = self.tree.coarsest, self.tree
        left = ((seen.column0 >> coarsest) << coarsest) - tree.column0 - column
        bottom = ((seen.row0 >> coarsest) << coarsest) - tree.row0 - row
        right = (((seen.column1 - 1) >> coarsest) + 1 << coarsest) - tree.column0 - column
        top = (((seen.row1 - 1) >> coarsest) + 1 << coarsest) - tree.row0 - row
        with np.errstate(divide='ignore', invalid='ignore'):
            share = np.where(length > 0.0, reach / length, 1.0)
            for start, step, low, high in ((x, dx, left, right), (y, dy, bottom, top)):
                edge = np.where(step > 0.0, high - INSIDE - start, low + INSIDE - start)
                share = np.minimum(share, np.where(step != 0.0, edge / step, np.inf))
        share = np.maximum(share, 1.0)
        return x + share * dx, y + share * dy

    def _count_and_split(self, beams: PlacedBeams) -> None:
        """Count, split, and count again along the beams that met a leaf which was split."""
        tree, settings = self.tree, self.settings
        tree.counters[ACTIVE] = 0
        seen = Trail.of(np.ones(beams.hit.size, np.uint8), TRAIL_SIZE)
        behind = Trail.of(beams.hit, TRAIL_SIZE)
        fresh = 0
        while True:
            seen = self._count_seen(beams, seen, fresh)
            if settings.unknowns:
                behind = self._count_unknowns(beams, behind, fresh)
            counted = int(tree.counters[ACTIVE])
            tree.make_room(rows=4 * (counted - fresh), slots=counted)
            split = split_leaves(
                tree.tree,
                tree.counters,
                tree.active,
                settings.finest_level,
                fresh,
                self._split_above,
                settings.noise,
                settings.unknowns,
            )
            if split == 0:
                return
            fresh = counted
            mark_again(tree.active, seen)
            mark_again(tree.active, behind)

    def _count_seen(self, beams: PlacedBeams, trail: Trail, fresh: int) -> Trail:
        tree, start = self.tree, 0
        while True:
            start = count_seen(
                tree.tree,
                tree.counters,
                tree.active,
                trail,
                tree.table,
                tree.coarsest,
                self.settings.finest_level,
                beams,
                start,
                fresh,
                self._l_free,
                self._l_occ,
                self.config.fusion == 'per_scan',
                self.settings.way_to_hit,
            )
            if start == beams.hit.size:
                return trail
            dx, dy = beams.end_x[start] - beams.x[start], beams.end_y[start] - beams.y[start]
            room = int(abs(dx) + abs(dy)) + SPARE
            tree.make_room(rows=room, slots=int(tree.counters[ACTIVE]) + room)
            trail = trail.roomier(room)

    def _count_unknowns(self, beams: PlacedBeams, trail: Trail, fresh: int) -> Trail:
        tree, start = self.tree, 0
        while True:
            start = count_unknowns(
                tree.tree,
                tree.active,
                trail,
                tree.table,
                tree.coarsest,
                self.settings.finest_level,
                beams,
                start,
                fresh,
            )
            if start == beams.hit.size:
                return trail
            dx = beams.last_x[start] - beams.end_x[start]
            dy = beams.last_y[start] - beams.end_y[start]
            trail = trail.roomier(int(abs(dx) + abs(dy)) + SPARE)

    def _apply_and_merge(self) -> CellBox:
        tree, settings = self.tree, self.settings
        extent = np.array([2**60, 2**60, -(2**60), -(2**60)])
        apply_evidence(tree.tree, tree.counters, tree.active, self._prior, self._limit, extent)
        merge_leaves(
            tree.tree,
            tree.counters,
            tree.active,
            settings.merge_free,
            settings.merge_occupied,
            settings.merge_spread,
            settings.merge_margin,
            self._merge_below,
            settings.noise,
            extent,
        )
        level = settings.output_level
        left, bottom, right, top = extent.tolist()
        return CellBox(
            (left + tree.column0) >> level,
            (bottom + tree.row0) >> level,
            ((right + tree.column0 - 1) >> level) + 1,
            ((top + tree.row0 - 1) >> level) + 1,
        )

    def log_odds(self, box: CellBox) -> Float32Array:
        """Log-odds in nats for each output cell of a box, nan where never measured."""
        return self.tree.log_odds(box, self.settings.output_level)

    def probabilities(self, box: CellBox) -> Float32Array:
        """Probability of being occupied; see `MappingMethod.probabilities`."""
        with np.errstate(over='ignore'):
            odds_against = np.exp(-self.log_odds(box))
        probability: Float32Array = np.float32(1.0) / (np.float32(1.0) + odds_against)
        return probability

    def statistics(self) -> TreeStatistics:
        """Leaves and bytes, beside those of a regular grid."""
        return self.tree.statistics()

    def reset(self) -> None:
        """Forget every scan, and give the memory back."""
        self.tree.clear()
        self._rng = np.random.default_rng(self.settings.seed)

    def forget_cells(self) -> None:
        """Forget every scan, but keep the extent and its memory."""
        self.tree.forget_cells()
        self._rng = np.random.default_rng(self.settings.seed)

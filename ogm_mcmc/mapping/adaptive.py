"""The adaptive map: cells as large as what was seen in them allows ([pose] section VI)."""

from __future__ import annotations

import math
from statistics import NormalDist

import numpy as np

from ogm_mcmc.arrays import Float32Array
from ogm_mcmc.config import MapperConfig
from ogm_mcmc.errors import require
from ogm_mcmc.geometry import CellBox, GridSpec, PlacedScan, PoseSamples
from ogm_mcmc.geometry.rays import SampledRays, cast_sampled_rays, usable_range
from ogm_mcmc.mapping.extras import Extras
from ogm_mcmc.mapping.map_weights import weighted_by_map
from ogm_mcmc.mapping.pose_samples import pose_samples
from ogm_mcmc.mapping.quadtree import Quadtree, TreeStatistics
from ogm_mcmc.mapping.quadtree_arrays import PlacedBeams, Trail
from ogm_mcmc.mapping.quadtree_counting_kernels import count_seen, count_unknowns, mark_again
from ogm_mcmc.mapping.quadtree_kernels import (
    ACTIVE,
    apply_evidence,
    merge_leaves,
    split_leaves,
)

__all__ = ['AdaptiveMapper', 'chi_square_limit']

# A beam is followed behind its end up to just inside the window, so that rounding stays there.
INSIDE = 1e-6

# More than the cells by which a walk may exceed the sides of the box around it.
SPARE = 8
TRAIL_SIZE = 4096


def chi_square_limit(significance: float, degrees: int) -> float:
    """Value a chi-square variable exceeds with probability `significance`; 1 or 2 degrees."""
    if significance <= 0.0:
        return math.inf
    if significance >= 1.0:
        return 0.0
    if degrees == 2:
        return -2.0 * math.log(significance)
    return NormalDist().inv_cdf(0.5 * significance) ** 2


def _placed(rays: SampledRays, samples: PoseSamples, tree: Quadtree, reach: float) -> PlacedBeams:
    """All beams of all samples, relative to the tree.

    Behind its end a beam is followed to `reach` cells from the sensor, or to where it leaves the
    tiles that any beam of this scan crossed: no leaf further away is touched.
    """
    n, m = rays.n_rays, samples.weights.size
    column, row = (np.repeat(rays.cells[:, k] - (tree.column0, tree.row0)[k], n) for k in (0, 1))
    x, y = np.repeat(rays.places[:, 0], n), np.repeat(rays.places[:, 1], n)
    end_x, end_y = rays.ends[:, 0, :n].ravel(), rays.ends[:, 1, :n].ravel()
    tiles = tree.tiles_around(rays.box)
    dx, dy = end_x - x, end_y - y
    with np.errstate(divide='ignore', invalid='ignore', over='ignore'):
        share = reach / np.hypot(dx, dy)
        for start, step, low, high in (
            (x, dx, tiles.column0 - tree.column0 - column, tiles.column1 - tree.column0 - column),
            (y, dy, tiles.row0 - tree.row0 - row, tiles.row1 - tree.row0 - row),
        ):
            edge = np.where(step > 0.0, high - INSIDE, low + INSIDE)
            share = np.where(step != 0.0, np.minimum(share, (edge - start) / step), share)
    # Not below 1 by rounding, and finite for a beam without length.
    share = np.where(share > 1.0, np.minimum(share, 1e18), 1.0)
    share[(dx == 0.0) & (dy == 0.0)] = 1.0
    return PlacedBeams(
        column,
        row,
        x,
        y,
        end_x,
        end_y,
        x + share * dx,
        y + share * dy,
        np.tile(rays.hit[:n], m),
        np.repeat(np.arange(m), n),
        np.repeat(samples.weights, n),
    )


class AdaptiveMapper:
    """A quadtree whose leaves split where counts contradict each other, and merge where not.

    For every scan: count hits, misses and unknowns per leaf, weighted by the pose samples; split
    what a chi-square test refuses, and count again there, until nothing splits; add the mean
    log-odds over the samples ([pose] Eq. 9) to every leaf seen; merge. `finest_level` and
    `coarsest_level` 0 make a regular grid, the same map as `two_assumption`.
    """

    def __init__(self, config: MapperConfig) -> None:
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
        self._rng = np.random.default_rng(config.pose_uncertain.seed)
        significance = self.settings.significance
        self._split_above = chi_square_limit(significance, 2 if self.settings.unknowns else 1)
        self._merge_below = chi_square_limit(significance, 1)
        self.configure(config)

    def configure(self, config: MapperConfig) -> None:
        """Take over settings; the ones that are fixed at start are as before."""
        self.config = config
        # The values of the other methods, in float32 as they have them.
        self._l_free = float(np.float32(config.step.l_free))
        self._l_occ = float(np.float32(config.step.l_occ))
        self._prior = np.float32(math.log(config.prior) - math.log1p(-config.prior))
        self._limit = np.float32(config.log_odds_limit)

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

    def update(self, placed: PlacedScan) -> CellBox:
        """Add one scan; see `MappingMethod.update`."""
        scan = placed.scan
        samples = pose_samples(placed, self.config.pose_uncertain, self._rng)
        samples = weighted_by_map(samples, scan, self, self.config)
        rays = cast_sampled_rays(
            scan,
            samples.poses,
            self._lattice,
            max_range_m=self.config.max_range,
            no_return_clears=self.config.no_return == 'clear',
        )
        if rays.n_rays == 0:
            return CellBox(0, 0, 0, 0)
        self.tree.cover(rays.box)
        reach_m = usable_range(scan, self._lattice, self.config.max_range)
        self._count_and_split(_placed(rays, samples, self.tree, reach_m / self.config.resolution))
        return self._apply_and_merge()

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
                float(settings.noise),
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
        apply_evidence(
            tree.tree,
            tree.counters,
            tree.active,
            self._prior,
            self._limit,
            float(settings.count_limit),
            extent,
        )
        merge_leaves(
            tree.tree,
            tree.counters,
            tree.active,
            float(settings.merge_free),
            float(settings.merge_occupied),
            float(settings.merge_spread),
            float(settings.merge_margin),
            self._merge_below,
            float(settings.noise),
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

    def extras(self, box: CellBox) -> Extras:
        """All leaves of the tree, and what they take (all of it, whatever the box)."""
        found = self.statistics()
        return Extras(
            tables={'tree': self.tree.leaves()._asdict()},
            statistics={'tree': found._asdict()},
            summary=f'{found.leaves} leaves for {found.measured_cells} cells, '
            f'{found.n_bytes / 1e6:.2f} MB (a regular grid: {found.regular_bytes / 1e6:.2f} MB)',
        )

    def reset(self) -> None:
        """Forget every scan, and give the memory back."""
        self.tree.clear()
        self._rng = np.random.default_rng(self.config.pose_uncertain.seed)

    def forget_cells(self) -> None:
        """Forget every scan, but keep the extent and its memory."""
        self.tree.forget_cells()
        self._rng = np.random.default_rng(self.config.pose_uncertain.seed)

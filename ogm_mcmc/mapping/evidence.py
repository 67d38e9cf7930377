"""The evidence of one scan, averaged over samples of its pose."""

from __future__ import annotations

import math

import numpy as np

from ogm_mcmc.arrays import Float32Array, Float64Array, UInt64Array
from ogm_mcmc.config import MapperConfig
from ogm_mcmc.geometry import CellBox, PoseSamples, SampledRays, Scan, cast_sampled_rays
from ogm_mcmc.geometry.rays import usable_range
from ogm_mcmc.mapping.beam_evidence_kernels import sum_gaussians_per_beam, sum_steps_per_beam
from ogm_mcmc.mapping.evidence_kernels import add_evidence, sum_per_scan
from ogm_mcmc.mapping.log_odds_grid import LogOddsGrid
from ogm_mcmc.sensors import BeamModel

__all__ = ['EvidenceWindow']


class EvidenceWindow:
    """Scratch memory of one scan: about 10 bytes for each cell of the largest box so far."""

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Give the memory back."""
        self.evidence: Float32Array = np.zeros(0, np.float32)
        self.best: Float32Array = np.zeros(0, np.float32)
        self.seen: UInt64Array = np.zeros(0, np.uint64)
        self.free: UInt64Array = np.zeros(0, np.uint64)
        self.special: UInt64Array = np.zeros(0, np.uint64)
        self.misses: UInt64Array = np.zeros(0, np.uint64)
        self.hits: UInt64Array = np.zeros(0, np.uint64)

    def _cover(self, words: int, digits: int = 0, gaussian: bool = False) -> None:
        if self.seen.size < words:
            self.evidence = np.zeros(64 * words, np.float32)
            self.seen = np.zeros(words, np.uint64)
            self.free = np.zeros(words, np.uint64)
            self.special = np.zeros(words, np.uint64)
        if gaussian and self.best.size < 64 * words:
            self.best = np.zeros(64 * words, np.float32)
        if self.misses.size < digits * words:
            self.misses = np.zeros(digits * words, np.uint64)
        if not gaussian and self.hits.size < digits * words:
            self.hits = np.zeros(digits * words, np.uint64)

    def add(
        self,
        grid: LogOddsGrid,
        scan: Scan,
        samples: PoseSamples,
        model: BeamModel,
        config: MapperConfig,
        prior: np.float32,
        limit: np.float32,
    ) -> CellBox:
        """Add sum_j w_j l(m | z_j) of a scan to the map ([pose] Eq. 9); return the changed box.

        Raises GridError, with nothing changed, when the map would become too large.
        """
        samples = _by_weight(samples)
        weights = samples.weights.astype(np.float32)
        rays = cast_sampled_rays(
            scan,
            samples.poses,
            grid.spec,
            max_range_m=config.max_range,
            no_return_clears=config.no_return == 'clear',
        )
        if rays.n_rays == 0:
            return CellBox(0, 0, 0, 0)
        reach = usable_range(scan, grid.spec, config.max_range) / config.resolution
        margin = _margin(rays, reach, model)
        box = _widened(rays.box, margin)
        grid.cover(box)
        left, bottom = box.column0 // 64 * 64, box.row0
        words, n_rows = -((left - box.column1) // 64), box.row1 - bottom
        boxes = rays.boxes - np.array([left, bottom, left, bottom])
        boxes += np.array([-margin, -margin, margin, margin])
        cells = rays.cells - np.array([left, bottom])
        placed = (cells, rays.places, rays.ends, rays.hit, rays.n_rays, weights)
        if config.fusion == 'per_scan':
            digits = int(np.unique(weights, return_counts=True)[1].max()).bit_length()
            self._cover(words * n_rows, digits, model.gaussian)
            scratch = (self.evidence, self.best, self.seen, self.free, self.special)
            counters = (self.misses, self.hits, digits)
            sum_per_scan(*scratch, *counters, words, *placed, reach, boxes, model)
        elif model.gaussian:
            self._cover(words * n_rows)
            sum_gaussians_per_beam(self.evidence, self.seen, words, *placed, reach, model)
        else:
            self._cover(words * n_rows)
            steps = (model.l_free, model.l_occ)
            sum_steps_per_beam(self.evidence, self.seen, words, *placed, *steps)
        first_word, first_row = (left - grid.spec.column0) // 64, bottom - grid.spec.row0
        window = (self.evidence, self.seen, words, n_rows, first_word, first_row)
        add_evidence(grid.log_odds, *window, prior, limit)
        return box


def _by_weight(samples: PoseSamples) -> PoseSamples:
    """Bring samples of equal weight together: those are counted, which is quicker."""
    if samples.weights.min() == samples.weights.max():
        return samples
    order = np.argsort(samples.weights, kind='stable')
    return PoseSamples(samples.poses[order], samples.weights[order])


def _margin(rays: SampledRays, reach: float, model: BeamModel) -> int:
    """Return how many cells beyond a ray's end the model may have something to say."""
    if not model.gaussian:
        return 0
    ends = rays.ends[0, :, : rays.n_rays] - rays.places[0][:, None]
    lengths: Float64Array = np.hypot(ends[0], ends[1])
    sigma = model.sigma + model.growth * lengths**2
    behind = np.minimum(model.half_width + model.sigmas_behind * sigma, reach - lengths)
    return math.ceil(max(float(behind.max()), 0.0)) + 1


def _widened(box: CellBox, margin: int) -> CellBox:
    return CellBox(
        box.column0 - margin, box.row0 - margin, box.column1 + margin, box.row1 + margin
    )

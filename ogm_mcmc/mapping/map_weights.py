"""Samples of a pose weighed by how well the scan fits the map so far.

A localizer's cloud is as wide as the localizer is in doubt; the map often knows better. Here
w_j is multiplied by p(z_t | m_1:t-1, x^j)^a: the first-hit mixture of the map's probabilities
(`ProbabilityBeams`), tempered. Beams are no independent witnesses, and neighbouring cells of a
traditional map are surer than they should be: of B beams, spread evenly over the scan, as many
count as `map_beams` says, a = map_beams / B.

Cells that are unknown, or lie outside, stop no beam here. A beam that ends in them has the
density of clutter wherever the robot stands, so what the map does not know moves no weight, and
an empty map changes nothing at all. Beams without a return are left out.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from ogm_mcmc.arrays import Float32Array, Float64Array
from ogm_mcmc.config import ForwardModelConfig, MapperConfig
from ogm_mcmc.geometry import CellBox, GridMap, GridSpec, PoseSamples, Scan
from ogm_mcmc.geometry.pose_sampling import merged
from ogm_mcmc.geometry.rays import MAX_LATTICE_CELLS, usable_range
from ogm_mcmc.mapping.probability_beams import ProbabilityBeams
from ogm_mcmc.sensors import ForwardModel

__all__ = ['MapSoFar', 'log_fits', 'weighted_by_map']

# Beams looked at per scan, and from all poses together: 100 poses have 30 beams each. More cost
# time and say little that is new: 60 at CSAIL, from 26 poses, are worth 0.002 of ROC area over 30.
MOST_BEAMS, FEWEST_BEAMS, MOST_LOOKS = 60, 10, 3000

# Hits further off than this many sigma count for nothing (`probability_fits`).
TAIL = 6.0


class MapSoFar(Protocol):
    """What is asked of a map: where its cells lie, and how probably they are occupied."""

    @property
    def spec(self) -> GridSpec:
        """Where the cells lie."""
        ...

    def probabilities(self, box: CellBox) -> Float32Array:
        """Probability of being occupied for each cell of a box, nan where never measured."""
        ...


def weighted_by_map(
    samples: PoseSamples, scan: Scan, so_far: MapSoFar, config: MapperConfig
) -> PoseSamples:
    """Return samples with the weights that the map gives them; the lightest are left out.

    Unchanged where `map_beams` is 0, a single sample is believed in, or the map knows nothing.
    """
    chosen = config.pose_uncertain
    if chosen.map_beams == 0.0 or samples.weights.size == 1:
        return samples
    fits = log_fits(samples.poses, scan, so_far, config)
    if fits is None:
        return samples
    with np.errstate(divide='ignore'):
        log_weights = np.log(samples.weights) + fits
    weights = np.exp(log_weights - log_weights.max())
    return merged(PoseSamples(samples.poses, weights / weights.sum()), chosen.negligible)


def log_fits(
    poses: Float64Array, scan: Scan, so_far: MapSoFar, config: MapperConfig
) -> Float64Array | None:
    """Tempered log-likelihoods (M,) of a scan at poses (M, 3), nats; None: nothing is known there.

    Raises GridError for a sensor without a greatest range.
    """
    chosen, spec = config.pose_uncertain, so_far.spec
    reach = usable_range(scan, spec, config.max_range)
    measured = np.flatnonzero(scan.measured() & (scan.ranges_m < reach))
    if measured.size == 0:
        return None
    most = max(FEWEST_BEAMS, min(MOST_BEAMS, MOST_LOOKS // poses.shape[0]))
    spread = np.linspace(0, measured.size - 1, min(most, measured.size))
    used = measured[spread.round().astype(np.int64)]
    ranges = scan.ranges_m[used].astype(np.float64)
    bearings = scan.bearings()[used]
    box = _crossed(poses, bearings, ranges + TAIL * chosen.map_sigma, spec)
    if box.empty:
        return None
    seen = GridMap(spec.windowed(box), so_far.probabilities(box))
    if not np.isfinite(seen.probability).any():
        return None
    model = ForwardModel.from_config(ForwardModelConfig(sigma=chosen.map_sigma))
    fit = ProbabilityBeams(seen, model, prior=0.0)
    power = min(1.0, chosen.map_beams / used.size)
    return power * fit.log_likelihoods(poses, bearings, ranges, reach)


def _crossed(
    poses: Float64Array, bearings: Float64Array, lengths_m: Float64Array, spec: GridSpec
) -> CellBox:
    """Return the cells of the map around beams from all poses; none if one is absurdly far off."""
    places = spec.in_cells(poses)
    if np.abs(places[:, :2]).max() >= MAX_LATTICE_CELLS:
        return CellBox(0, 0, 0, 0)
    angles = places[:, 2, None] + bearings
    along = lengths_m / spec.resolution_m
    ranges = []
    for at, turned in ((places[:, 0], np.cos(angles)), (places[:, 1], np.sin(angles))):
        ends = at[:, None] + along * turned
        ranges.append((min(at.min(), ends.min()), max(at.max(), ends.max())))
    (left, right), (bottom, top) = ranges
    size = (spec.width, spec.height)
    low = np.clip(np.floor((left, bottom)), 0, size).astype(np.int64)
    high = np.clip(np.ceil((right, top)), 0, size).astype(np.int64)
    corner = np.array((spec.column0, spec.row0))
    return CellBox(*(low + corner).tolist(), *(high + corner).tolist())

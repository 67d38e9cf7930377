"""What the worker hands over: the map of chains as they are now, and figures of the sampled."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ogm_mcmc.engine.collision import chance_of_unknown
from ogm_mcmc.engine.joint_poses import RefinedTrajectory
from ogm_mcmc.engine.kept_samples import KeptSamples
from ogm_mcmc.engine.refined_map import RefinedMap
from ogm_mcmc.engine.refinement import Refinement
from ogm_mcmc.geometry import PlacedScan

__all__ = ['figures_of', 'map_now']


def map_now(
    refinement: Refinement,
    kept: KeptSamples,
    scans: Sequence[PlacedScan],
    trajectory: RefinedTrajectory | None,
    *,
    number: int,
    final: bool,
) -> RefinedMap:
    """Return the map of these scans, which are those taken; `final`: of sweeps that count alone.

    trajectory  the poses that they were taken at, where these are estimated
    """
    sampler = refinement.sampler
    assert sampler is not None
    mean = sampler.estimate() if final else sampler.present_estimate()
    grid_map = refinement.known_map(mean)
    samples = kept.bits(sampler, refinement.window.spec)
    unknown = None
    if samples is not None:
        # Where the mean says nothing their cells are the prior's, one by one: calibrated
        # worse than by the area of unknown space, as `collision_risk` takes it.
        samples = samples.known_in(grid_map)
        unknown = chance_of_unknown(samples, refinement.prior)
    return RefinedMap(
        number,
        grid_map,
        refinement.drawn_map(mean),
        refinement.prior,
        mean.draws,
        len(scans),
        scans[-1].scan.stamp_ns,
        final,
        trajectory,
        samples,
        refinement.guess,
        unknown,
    )


def figures_of(refinement: Refinement) -> dict[str, Any]:
    """Return of what is sampled what `WorkerStatus` says, by its names."""
    size, sampler = refinement.size, refinement.sampler
    assert sampler is not None
    return {
        'rays': size.n_rays,
        'merged': size.n_merged,
        'sensor': refinement.beams.sensor,
        'no_return': refinement.beams.no_return,
        'n_bytes': size.n_bytes + sampler.n_bytes,
        'index_bytes': size.n_bytes,
    }

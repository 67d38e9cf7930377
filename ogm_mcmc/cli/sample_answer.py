"""What `sample` tells of its work: the figures of its JSON, and its lines."""

from __future__ import annotations

from typing import Any

import numpy as np

from ogm_mcmc.config import StopConfig
from ogm_mcmc.engine.progress import Progress, each_of
from ogm_mcmc.engine.recording import Recording
from ogm_mcmc.engine.refinement import Refinement

__all__ = ['answer_text', 'sampling_figures']


def sampling_figures(
    refinement: Refinement,
    progress: Progress,
    stop: StopConfig,
    resumed: int,
    recording: Recording,
) -> dict[str, Any]:
    """Return what was sampled and how well; as JSON takes it."""
    sampler, index = refinement.sampler, refinement.size
    assert sampler is not None
    quality, beams = sampler.quality(), refinement.beams
    figures = {
        # Finite or null: JSON knows no infinity.
        key: None if isinstance(value, float) and not np.isfinite(value) else value
        for key, value in progress.as_dict().items()
        if key != 'seconds'
    }
    return {
        'scans_used': len(recording),
        'scans_let_go': dict(recording.let_go),
        'rays': index.n_rays,
        'rays_merged': index.n_merged,
        'pairs': index.n_pairs,
        'memory_mb': round((index.n_bytes + sampler.n_bytes) / 1e6, 1),
        'cells': int(sampler.model.touched.size),
        'undecided_cells': None if quality is None else quality.summary()['undecided_cells'],
        **figures,
        'agreeing_share': progress.agreeing_share if stop.r_hat > 0.0 else None,
        'no_return': beams.no_return.as_dict(),
        'sensor': None if beams.sensor is None else beams.sensor.as_dict(),
        'resumed_at': resumed,
        'sampling_seconds': round(progress.seconds, 3),
    }


def answer_text(result: dict[str, Any]) -> str:
    """Return the line for people: of what was it made, how far did it come, why did it stop."""
    r_hat = 'unknown' if result['r_hat_p99'] is None else f'{result["r_hat_p99"]:.3f}'
    share = result['agreeing_share']
    agreeing = '' if share is None else f', {100.0 * share:.1f} % agree'
    dropped = ', '.join(f'{count} {reason}' for reason, count in result['dropped'].items())
    moved = ''
    if 'trajectory' in result:
        of = result['trajectory']
        moved = f'; poses moved {100.0 * of["moved_m"]:.1f} cm, {of["moved_deg"]:.2f} degrees'
        if 'deviation_m' in of:
            moved += (
                f', now sure to {100.0 * of["deviation_apart_m"]:.1f} cm, '
                f'all together to {100.0 * of["deviation_m"]:.0f} cm'
            )
    merged = f' ({result["rays_merged"]} merged with equal ones)' if result['rays_merged'] else ''
    early = '' if result['counted'] else ' before the end of the burn-in: no posterior mean yet'
    return (
        f'{result["scans_used"]} of {result["scans"]} scans, {result["rays"]} rays{merged} -> '
        f'{result["files"]["yaml"]}: {result["cells"]} cells, {result["counted"]} sweeps counted '
        f'of {each_of(result["chains"])}, {result["sweeps_per_s"]:.1f}/s, '
        f'R-hat {r_hat} (99 %){agreeing}; '
        f'stopped: {result["reason"]}{early}{moved}' + (f'; dropped: {dropped}' if dropped else '')
    )

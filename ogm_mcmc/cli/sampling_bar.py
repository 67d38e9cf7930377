"""Sampling as a person at a terminal sees it: a bar that Ctrl-C or SIGTERM ends.

What was sampled by then is written.
"""

from __future__ import annotations

import threading
from collections.abc import Callable

from tqdm import tqdm

from ogm_mcmc.config import StopConfig
from ogm_mcmc.engine.joint_poses import PoseRefinement
from ogm_mcmc.engine.progress import Progress
from ogm_mcmc.engine.refinement import Refinement

__all__ = ['refine_poses', 'sample', 'status']


def refine_poses(poses: PoseRefinement, interrupted: threading.Event) -> None:
    """Refine until all is done; after Ctrl-C the poses are those of then."""
    with tqdm(total=poses.estimator.n_steps, desc='poses', unit=' steps', disable=None) as bar:
        for progress in poses.run(cancelled=interrupted.is_set):
            left = f'{progress.doing}, moved by {100.0 * progress.change_m:.1f} cm'
            bar.set_postfix_str(left, refresh=False)
            bar.update()


def sample(
    refinement: Refinement,
    stop: StopConfig,
    interrupted: threading.Event,
    round_done: Callable[[], object] = lambda: None,
) -> Progress:
    """Sample until a limit, Ctrl-C or SIGTERM; return the last progress.

    `round_done` is called between sweeps, some ten times a second.
    """
    rounds = refinement.run(stop, interrupted.is_set)
    form = '{desc}: {percentage:3.0f}%|{bar}| {n_fmt}/{total_fmt} sweeps{postfix}'
    with tqdm(total=stop.max_sweeps, desc='sample', bar_format=form, disable=None) as bar:
        for progress in rounds:
            done = round(progress.sweeps_per_s * progress.seconds)
            bar.set_postfix_str(status(progress, stop, done), refresh=False)
            bar.update(done - bar.n)
            round_done()
    return progress


def status(progress: Progress, stop: StopConfig, done: int) -> str:
    """Return what is known while sampling; the time left is that of the nearest limit."""
    left = stop.max_time - progress.seconds
    if progress.sweeps_per_s > 0.0:
        left = min(left, (stop.max_sweeps - done) / progress.sweeps_per_s)
    # Without a rule for R-hat there is no limit below which chains would agree.
    share = f', {100.0 * progress.agreeing_share:.1f} % agree' if stop.r_hat > 0.0 else ''
    return (
        f'{progress.sweeps_per_s:.1f} sweeps/s, R-hat {progress.r_hat_p99:.3f} (99 %){share}, '
        f'at most {max(left, 0.0):.0f} s left'
    )

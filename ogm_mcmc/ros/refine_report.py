"""What `refine_server` says of its sampling: in answers, in the log and in diagnostics."""

from __future__ import annotations

from ogm_mcmc.config import StopConfig, WindowConfig
from ogm_mcmc.engine.no_returns import NoReturnChoice
from ogm_mcmc.engine.progress import Progress, nothing_said
from ogm_mcmc.engine.refined_map import WorkerStatus
from ogm_mcmc.engine.sensor_fit import SensorNumbers
from ogm_mcmc.trajectory import TrajectoryProgress

__all__ = [
    'disagreement',
    'no_return_values',
    'nothing_recorded',
    'nothing_refined',
    'order_text',
    'progress_text',
    'progress_values',
    'sensor_values',
    'size_refusal',
    'status_values',
]


def order_text(
    scans: int, rays: int, stop: StopConfig, chain_sweeps: int, state_file: bool
) -> str:
    """Return the answer to an order: what is sampled, for how long at most, from where.

    chain_sweeps  of chains that are there already
    """
    limits = f'for at most {stop.max_time:g} s and {stop.max_sweeps} sweeps'
    if chain_sweeps > 0:
        start = f'goes on from the chains of {chain_sweeps} earlier sweeps'
    elif state_file:
        start = 'goes on from the state file if it fits, else with new chains'
    else:
        start = 'begins with new chains'
    return f'sampling {scans} scans, {rays} rays, {limits}; {start}'


def nothing_recorded(waiting: int, lost: int) -> str:
    """Return why an order is refused: nothing was recorded, but scans wait or were dropped."""
    return (
        f'no scan was recorded yet: nothing to sample ({waiting} scans wait for a pose, '
        f'{lost} messages dropped)'
    )


def nothing_refined(status: WorkerStatus) -> str:
    """Return why there is no refined map: none was asked for, it is on its way, or it failed."""
    if status.state != 'idle':
        return f'the first map is not there yet ({status.state}, {status.scans} scans)'
    if status.stopped:
        return f'the last ~/refine ended before its first map ({status.error or status.stopped})'
    return 'nothing was refined yet: call ~/refine first'


def size_refusal(scans: int, rays: int, n_bytes: int, window: WindowConfig) -> str:
    """Return why an order is refused that says nothing or is too large; empty if it is neither."""
    if rays == 0:
        return nothing_said(scans, window.max_range)
    if n_bytes > 1e6 * window.max_memory_mb:
        return (
            f'{rays} rays may need {n_bytes / 1e6:.1f} MB: expected at most '
            f'window.max_memory_mb = {window.max_memory_mb:g}'
        )
    return ''


def progress_text(status: WorkerStatus, stop: StopConfig) -> str:
    """Return how far sampling is, for people; empty while there is nothing to say."""
    progress = status.progress
    if status.state == 'refining poses' and status.poses is not None:
        return _poses_text(status.poses)
    if status.state != 'sampling' or progress is None:
        return ''
    share = 100.0 * progress.seconds / stop.max_time
    return (
        f'{progress.sweeps} sweeps, {share:.0f} % of the time, '
        f'{100.0 * progress.agreeing_share:.1f} % of the cells agree'
    )


def _poses_text(poses: TrajectoryProgress) -> str:
    """Return what was done of poses last."""
    if poses.side_m > 0.0:
        return f'{poses.doing} in squares of {poses.side_m:g} m after {poses.seconds:.1f} s'
    return f'{poses.doing} after {poses.seconds:.1f} s'


def disagreement(status: WorkerStatus, stop: StopConfig) -> str:
    """Return by how much a refinement that has ended lacks agreement; empty if it does not."""
    progress = status.progress
    ended = status.state == 'idle' and status.stopped in ('time', 'sweeps', 'stopped')
    if progress is None or not ended or stop.r_hat == 0.0:
        return ''
    if progress.agreeing_share >= stop.agreeing_share:
        return ''
    return (
        f'ended without agreement ({status.stopped}): R-hat is below {stop.r_hat:g} in '
        f'{100.0 * progress.agreeing_share:.1f} % of the cells, expected '
        f'{100.0 * stop.agreeing_share:g} %'
    )


def status_values(status: WorkerStatus, no_return: str) -> dict[str, object]:
    """Return how sampling goes, for /diagnostics.

    no_return  what +inf shall mean, as asked for
    """
    return {
        'state': status.state,
        'scans sampled': status.scans,
        'rays': status.rays,
        'scans left out of the index': status.left_out,
        'rays merged with equal ones': status.merged,
        'memory (MB)': f'{status.n_bytes / 1e6:.1f}',
        'memory of the index (MB)': f'{status.index_bytes / 1e6:.1f}',
        **progress_values(status.progress),
        **sensor_values(status.sensor),
        **no_return_values(status.no_return, no_return),
        'poses of the map': status.poses_of_map,
        **({'joint poses': _poses_text(status.poses)} if status.poses else {}),
        'stopped because': status.stopped,
        'last error': status.error,
    }


def progress_values(progress: Progress | None) -> dict[str, object]:
    """Return the figures of sampling, for /diagnostics."""
    if progress is None:
        return {'sweeps': 0, 'sweeps counted': 0}
    return {
        'chains': progress.chains,
        'sweeps': progress.sweeps,
        'sweeps counted': progress.counted,
        'seconds': f'{progress.seconds:.1f}',
        'sweeps per second': f'{progress.sweeps_per_s:.1f}',
        'R-hat (99 % of cells below)': f'{progress.r_hat_p99:.3f}',
        'cells that agree (share)': f'{progress.agreeing_share:.4f}',
        'effective samples (median)': f'{progress.ess_median:.0f}',
        'standard error (largest)': f'{progress.mcse_max:.4f}',
        'log-likelihood': f'{progress.log_likelihood:.1f}',
    }


def sensor_values(sensor: SensorNumbers | None) -> dict[str, object]:
    """Return what was found out about the sensor, for /diagnostics; nothing where it is given."""
    if sensor is None:
        return {}
    shares = {'clutter': sensor.clutter, 'missing': sensor.missing}
    values: dict[str, object] = {
        f'{name} beams (share, 95 % interval)': str(share)
        for name, share in shares.items()
        if share is not None
    }
    spreads = {'sigma of ranges': sensor.sigma, 'grazing': sensor.grazing}
    values |= {
        f'{name} (95 % interval)': str(spread)
        for name, spread in spreads.items()
        if spread is not None
    }
    if sensor.grazing is not None:
        values['grazing used (m)'] = f'{sensor.grazing.used:.4f}'
    return values


def no_return_values(choice: NoReturnChoice | None, asked: str) -> dict[str, object]:
    """Return what +inf means in the scans sampled, for /diagnostics."""
    key = 'window.no_return'
    if choice is None:
        return {key: asked}
    how = ' (auto)' if choice.asked == 'auto' else ''
    why = f': {choice.found}' if choice.found.beams else ''
    return {key: f'{choice.value}{how}{why}'}

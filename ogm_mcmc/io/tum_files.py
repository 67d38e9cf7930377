"""Beliefs about a trajectory as a TUM file with standard deviations beside it.

Beside NAME.txt a file NAME_deviations.csv holds the standard deviations of x, y (m) and yaw (rad)
of every pose, where they are known. evo reads the first, and takes no notice of the second.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ogm_mcmc.arrays import Float64Array
from ogm_mcmc.errors import PoseError
from ogm_mcmc.files.input_files import reason_of, text_of
from ogm_mcmc.files.output_files import replacing
from ogm_mcmc.geometry import PoseBelief
from ogm_mcmc.io.trajectory_files import write_tum

__all__ = ['deviations_file', 'read_deviations', 'write_beliefs']

HEADER = 'stamp_s,x_m,y_m,yaw_rad'


def deviations_file(path: Path) -> Path:
    """Return where the standard deviations of a TUM file lie."""
    return path.with_name(f'{path.stem}_deviations.csv')


def write_beliefs(
    path: Path, stamps_ns: Sequence[int], beliefs: Sequence[PoseBelief]
) -> list[Path]:
    """Write poses and, where every covariance is known, deviations; return the files.

    Raises OutputError.
    """
    write_tum(path, stamps_ns, [belief.mean for belief in beliefs])
    covariances = [belief.covariance for belief in beliefs if belief.covariance is not None]
    if len(covariances) < len(beliefs):
        return [path]
    rows = [HEADER]
    for stamp_ns, covariance in zip(stamps_ns, covariances, strict=True):
        spread = np.sqrt(np.diag(covariance))
        stamp = '{}.{:09d}'.format(*divmod(stamp_ns, 10**9))
        rows.append(','.join([stamp, *(f'{value:.8f}' for value in spread)]))
    beside = deviations_file(path)
    with replacing(beside) as temporary:
        temporary.write_text('\n'.join(rows) + '\n', encoding='utf-8')
    return [path, beside]


def read_deviations(path: Path, count: int) -> Float64Array | None:
    """Return the deviations (count, 3) that lie beside a TUM file; None where there are none.

    Raises PoseError for a file that is not of this many poses.
    """
    beside = deviations_file(path)
    if not beside.exists():
        return None
    try:
        lines = text_of(beside).splitlines()[1:]
        rows = np.loadtxt(lines, delimiter=',', ndmin=2) if lines else np.empty((0, 4))
    except (OSError, ValueError) as error:
        reason = reason_of(error)
        raise PoseError(f'{beside}: expected lines of four numbers ({reason})') from error
    if rows.shape != (count, 4):
        raise PoseError(f'{beside}: expected a line of four numbers for each of {count} poses')
    if not np.isfinite(rows).all() or (rows[:, 1:] < 0.0).any():
        raise PoseError(f'{beside}: expected standard deviations from 0 on')
    return np.ascontiguousarray(rows[:, 1:])

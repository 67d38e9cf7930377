"""Beliefs about a trajectory as a TUM file with standard deviations beside it.

Beside NAME.txt a file NAME_deviations.csv holds the standard deviations of x, y (m) and yaw (rad)
of every pose, where they are known. evo reads the first, and takes no notice of the second.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ogm_mcmc.arrays import Float64Array, Int64Array
from ogm_mcmc.errors import PoseError
from ogm_mcmc.files.input_files import reason_of, text_of
from ogm_mcmc.files.output_files import replacing
from ogm_mcmc.geometry import PoseBelief
from ogm_mcmc.io.trajectory_files import ROUNDING_NS, write_tum

__all__ = ['deviations_file', 'read_deviations', 'write_beliefs']

HEADER = 'stamp_s,x_m,y_m,yaw_rad'

WIDEST = 1e3  # m, rad: more says nothing of a pose


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


def read_deviations(path: Path, stamps_ns: Int64Array) -> Float64Array | None:
    """Return the deviations (N, 3) that lie beside a file of poses; None where there are none.

    stamps_ns  (N,) of these poses
    Raises PoseError for a file that is not of these poses.
    """
    beside = deviations_file(path)
    if not beside.exists():
        return None
    try:
        lines = list(filter(str.strip, text_of(beside).splitlines()))[1:]
        rows = np.loadtxt(lines, delimiter=',', ndmin=2) if lines else np.empty((0, 4))
    except (OSError, ValueError) as error:
        reason = reason_of(error)
        raise PoseError(f'{beside}: expected lines of four numbers ({reason})') from error
    count = len(stamps_ns)
    if rows.shape != (count, 4):
        raise PoseError(
            f'{beside}: {rows.shape[0]} lines of {rows.shape[1]} numbers below the first: '
            f'expected one of four for each of {count} poses in {path}'
        )
    spread = rows[:, 1:]
    bad = ~((spread >= 0.0) & (spread <= WIDEST)).all(axis=1)
    if bad.any():
        k = int(np.argmax(bad))
        raise PoseError(
            f'{beside}: line {k + 2} has {", ".join(f"{value:g}" for value in spread[k])}: '
            f'expected standard deviations from 0 to {WIDEST:g}'
        )
    off = ~(np.abs(rows[:, 0] - stamps_ns / 1e9) <= 1e-9 * ROUNDING_NS)
    if off.any():
        k = int(np.argmax(off))
        raise PoseError(
            f'{beside}: line {k + 2} is of {rows[k, 0]:.15g} s: '
            f'expected {stamps_ns[k] / 1e9:.15g} s, the stamp of that pose in {path}'
        )
    return np.ascontiguousarray(spread)

"""Beliefs about a trajectory as a TUM file with standard deviations beside it.

Beside NAME.txt a file NAME_deviations.csv holds the standard deviations of x, y (m) and yaw (rad)
of every pose, where they are known, and once more without the motion that all poses have in
common, where that is known: this is what blurs a map. Its first line names the columns; what
follows a # is a remark. evo reads the first file, and takes no notice of the second.
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
APART = ',x_apart_m,y_apart_m,yaw_apart_rad'

WIDEST = 1e3  # m, rad: more says nothing of a pose


def deviations_file(path: Path) -> Path:
    """Return where the standard deviations of a TUM file lie."""
    return path.with_name(f'{path.stem}_deviations.csv')


def write_beliefs(
    path: Path,
    stamps_ns: Sequence[int],
    beliefs: Sequence[PoseBelief],
    apart: Float64Array | None = None,
) -> list[Path]:
    """Write poses and, where every covariance is known, deviations; return the files.

    apart  (N, 3) deviations without the motion that all poses have in common
    Raises OutputError.
    """
    write_tum(path, stamps_ns, [belief.mean for belief in beliefs])
    covariances = [belief.covariance for belief in beliefs if belief.covariance is not None]
    if len(covariances) < len(beliefs):
        return [path]
    spreads = np.array([np.sqrt(np.diag(covariance)) for covariance in covariances])
    if apart is not None:
        spreads = np.concatenate((spreads, apart), axis=1)
    rows = [HEADER if apart is None else HEADER + APART]
    for stamp_ns, spread in zip(stamps_ns, spreads, strict=True):
        stamp = '{}.{:09d}'.format(*divmod(stamp_ns, 10**9))
        rows.append(','.join([stamp, *(f'{value:.8f}' for value in spread)]))
    beside = deviations_file(path)
    with replacing(beside) as temporary:
        temporary.write_text('\n'.join(rows) + '\n', encoding='utf-8')
    return [path, beside]


def read_deviations(
    path: Path, stamps_ns: Int64Array, *, apart: bool = False
) -> Float64Array | None:
    """Return the deviations (N, 3) that lie beside a file of poses; None where there are none.

    stamps_ns  (N,) of these poses
    apart      without the motion that all poses have in common, where the file tells these
    Raises PoseError with file and line for a file that is not of these poses.
    """
    beside = deviations_file(path)
    if not beside.exists():
        return None
    numbers, rows = _table(beside)
    count = len(stamps_ns)
    if len(rows) != count:
        raise PoseError(
            f'{beside}: deviations of {len(rows)} pose{"s"[: len(rows) != 1]}: '
            f'expected those of {count} in {path}'
        )
    spread = rows[:, 1:]
    bad = ~((spread >= 0.0) & (spread <= WIDEST)).all(axis=1)
    if bad.any():
        k = int(np.argmax(bad))
        raise PoseError(
            f'{beside}: line {numbers[k]} has {", ".join(f"{value:g}" for value in spread[k])}: '
            f'expected standard deviations from 0 to {WIDEST:g}'
        )
    off = ~(np.abs(rows[:, 0] - stamps_ns / 1e9) <= 1e-9 * ROUNDING_NS)
    if off.any():
        k = int(np.argmax(off))
        raise PoseError(
            f'{beside}: line {numbers[k]} is of {rows[k, 0]:.15g} s: '
            f'expected {stamps_ns[k] / 1e9:.15g} s, the stamp of that pose in {path}'
        )
    return np.ascontiguousarray(spread[:, -3:] if apart else spread[:, :3])


def _table(path: Path) -> tuple[list[int], Float64Array]:
    """Return the numbers of N lines in the file, and what is in them (N, 4 or 7)."""
    try:
        text = text_of(path)
    except (OSError, ValueError) as error:
        raise PoseError(f'{path}: cannot be read ({reason_of(error)})') from error
    lines = [(k, line.partition('#')[0].strip()) for k, line in enumerate(text.splitlines(), 1)]
    lines = [(k, said) for k, said in lines if said]
    first, header = lines[0] if lines else (1, '')
    if header.replace(' ', '') not in (HEADER, HEADER + APART):
        raise PoseError(
            f'{path}: line {first} is {header[:80]!r}: expected {HEADER}, or {HEADER + APART}'
        )
    width = len(header.split(','))
    rows = np.empty((len(lines) - 1, width))
    for row, (k, said) in zip(rows, lines[1:], strict=True):
        values = said.split(',')
        if len(values) != width:
            shown = f'{len(values)} of {width} numbers: {said[:80]!r}'
            raise PoseError(f'{path}: line {k} has {shown}')
        try:
            row[:] = [float(value) for value in values]
        except ValueError as error:
            raise PoseError(f'{path}: line {k}: expected numbers, not {said[:80]!r}') from error
    return [k for k, _ in lines[1:]], rows

"""Trajectories as text, as the TUM benchmark has them and evo reads them.

One pose a line: stamp (s), x y z (m), qx qy qz qw. Beside NAME.tum a file NAME_deviations.csv
holds the standard deviations of x, y (m) and yaw (rad) of every pose, where they are known.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ogm_mcmc.arrays import Float64Array
from ogm_mcmc.errors import LogError
from ogm_mcmc.files.output_files import replacing
from ogm_mcmc.geometry import PoseBelief

__all__ = ['read_tum', 'write_tum']


def write_tum(path: Path, stamps_ns: Sequence[int], beliefs: Sequence[PoseBelief]) -> list[Path]:
    """Write poses and, where every covariance is known, deviations; return the files.

    Raises OutputError.
    """
    lines, deviations = [], ['stamp_s,x_m,y_m,yaw_rad']
    known = all(belief.covariance is not None for belief in beliefs)
    for stamp_ns, belief in zip(stamps_ns, beliefs, strict=True):
        stamp = f'{stamp_ns // 10**9}.{stamp_ns % 10**9:09d}'
        pose, half = belief.mean, 0.5 * belief.mean.yaw_rad
        place = f'{pose.x_m:.6f} {pose.y_m:.6f} 0'
        lines.append(f'{stamp} {place} 0 0 {math.sin(half):.9f} {math.cos(half):.9f}')
        if belief.covariance is not None:
            spread = np.sqrt(np.diag(belief.covariance))
            deviations.append(','.join([stamp, *(f'{value:.6f}' for value in spread)]))
    contents = {path: lines}
    if known:
        contents[path.with_name(f'{path.stem}_deviations.csv')] = deviations
    for name, rows in contents.items():
        with replacing(name) as temporary:
            temporary.write_text('\n'.join(rows) + '\n', encoding='utf-8')
    return list(contents)


def read_tum(path: Path) -> tuple[Float64Array, Float64Array]:
    """Return stamps (K,), s, and poses (K, 3): x, y, yaw. Raises LogError."""
    try:
        rows = np.loadtxt(path, ndmin=2)
    except (OSError, ValueError) as error:
        raise LogError(f'{path}: expected lines of eight numbers ({error})') from error
    if rows.shape[1] != 8:
        raise LogError(f'{path}: {rows.shape[1]} numbers in a line: expected 8')
    x, y, z, w = rows[:, 4:].T
    yaw = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    return rows[:, 0], np.column_stack((rows[:, 1:3], yaw))

"""Files of known moves between poses (Kuemmerle et al. 2009)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ogm_mcmc.arrays import Float64Array
from ogm_mcmc.errors import LogError
from ogm_mcmc.files.input_files import reason_of, text_of

__all__ = ['read_relations']


def read_relations(path: Path) -> Float64Array:
    """Return (N, 8): stamp, stamp, s, and x, y, z, m, roll, pitch, yaw, rad, of the move.

    Raises LogError for anything but lines of eight finite numbers.
    """
    try:
        lines = [line for line in text_of(path).splitlines() if line.partition('#')[0].strip()]
        rows: Float64Array = np.loadtxt(lines, ndmin=2) if lines else np.empty((0, 8))
    except (OSError, ValueError) as error:
        reason = reason_of(error)
        raise LogError(f'{path}: expected lines of eight numbers ({reason})') from error
    if rows.shape[1] != 8:
        raise LogError(f'{path}: {rows.shape[1]} numbers in a line: expected 8')
    odd = np.flatnonzero(~np.isfinite(rows).all(1))
    if odd.size:
        raise LogError(f'{path}: relation {odd[0] + 1}: expected finite numbers')
    return rows

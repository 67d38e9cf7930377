"""Where the recorded data are that some experiments need, and what their scans say."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from ogm_mcmc.errors import ConfigError
from ogm_mcmc.geometry import Scan
from ogm_mcmc.io.carmen import LogScan

__all__ = ['RANGE_MAX_M', 'as_scan', 'data_folder']

# Readings of a SICK in centimetre mode from here on are codes for "nothing".
NO_RETURN_M, RANGE_MAX_M = 81.8, 80.0


def data_folder(needed: Path, expected: str) -> Path:
    """Return the folder that OGM_MCMC_DATA names.

    Raises ConfigError where it does not hold `needed`, a path in it; `expected` says how to come
    by that, with the whole path for `{path}`.
    """
    folder = Path(os.environ.get('OGM_MCMC_DATA', '../shared/data'))
    path = folder / needed
    if not path.exists():
        raise ConfigError(f'{path}: no such file; expected {expected.format(path=path)}')
    return folder


def as_scan(logged: LogScan) -> Scan:
    """Return a scan that a SICK in centimetre mode left in a log as REP 117 has it."""
    return Scan.checked(
        np.where(logged.ranges_m >= NO_RETURN_M, np.inf, logged.ranges_m),
        angle_min_rad=logged.start_angle_rad,
        angle_increment_rad=logged.increment_rad,
        range_min_m=0.0,
        range_max_m=RANGE_MAX_M,
    )

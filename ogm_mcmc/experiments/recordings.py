"""Where the recorded data are that some experiments need."""

from __future__ import annotations

import os
from pathlib import Path

from ogm_mcmc.errors import ConfigError

__all__ = ['data_folder']


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

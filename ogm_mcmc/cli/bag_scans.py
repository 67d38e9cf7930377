"""All placed scans of a bag, with a progress bar, for commands that need them at once."""

from __future__ import annotations

import argparse
from collections.abc import Callable

from tqdm import tqdm

from ogm_mcmc.cli.options import stream_choice
from ogm_mcmc.config import MapperConfig, PlacingConfig
from ogm_mcmc.engine.bag_scans import BagScans, read_scans

__all__ = ['read_bag']


def read_bag(
    options: argparse.Namespace, placing: PlacingConfig, mapper: MapperConfig | None = None
) -> BagScans:
    """Read and place all scans of `options.bag`. Raises BagError when none can be placed."""
    bars = []

    def progress(total: int) -> Callable[[], object]:
        bars.append(tqdm(total=total, unit=' scans', desc='read', disable=None))
        return bars[-1].update

    try:
        return read_scans(
            options.bag, stream_choice(options, placing, mapper or MapperConfig()), progress
        )
    finally:
        for bar in bars:
            bar.close()

"""Placed scans of a bag, with a progress bar: the door of all commands that read one."""

from __future__ import annotations

import argparse
import contextlib
from collections.abc import Iterator
from typing import NamedTuple

from tqdm import tqdm

from ogm_mcmc.cli.options import stream_choice
from ogm_mcmc.config import MapperConfig, PlacingConfig
from ogm_mcmc.engine.bag_scans import PlacedScans, StreamTopics, open_scans
from ogm_mcmc.geometry import PlacedScan

__all__ = ['BagScans', 'placed_scans', 'read_bag']


class BagScans(NamedTuple):
    """All placed scans of a bag, the topics they came from, and what was dropped, by reason."""

    placed: list[PlacedScan]
    topics: StreamTopics
    dropped: dict[str, int]


@contextlib.contextmanager
def placed_scans(
    options: argparse.Namespace,
    placing: PlacingConfig,
    mapper: MapperConfig | None = None,
    *,
    title: str = 'read',
) -> Iterator[PlacedScans]:
    """Yield the scans of `options.bag`, one after the other, behind a bar with a title.

    Raises BagError that says what is missing.
    """
    choice = stream_choice(options, placing, mapper or MapperConfig())
    with (
        open_scans(options.bag, choice) as scans,
        tqdm(total=scans.topics.n_scans, unit=' scans', desc=title, disable=None) as bar,
    ):
        scans.on_scan = bar.update
        yield scans


def read_bag(
    options: argparse.Namespace, placing: PlacingConfig, mapper: MapperConfig | None = None
) -> BagScans:
    """Read and place all scans of `options.bag`. Raises BagError when none can be placed."""
    with placed_scans(options, placing, mapper) as scans:
        placed = list(scans)
    return BagScans(placed, scans.topics, dict(scans.placer.dropped))

"""All placed scans of a bag, for commands that need them at once."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import NamedTuple

from tqdm import tqdm

from ogm_mcmc.cli.options import stream_choice
from ogm_mcmc.config import MapperConfig, PlacingConfig
from ogm_mcmc.errors import BagError
from ogm_mcmc.io.bags import BagReader
from ogm_mcmc.io.scan_stream import PlacedScans, StreamTopics, choose_topics
from ogm_mcmc.pipeline import mounted, sensor_mount
from ogm_mcmc.placement import Placement

__all__ = ['BagScans', 'read_bag']


class BagScans(NamedTuple):
    """Scans with the belief about their sensor's pose; how many were dropped, by reason."""

    placements: list[Placement]
    topics: StreamTopics
    n_scans: int
    dropped: dict[str, int]


def read_bag(
    options: argparse.Namespace, placing: PlacingConfig, mapper: MapperConfig | None = None
) -> BagScans:
    """Read and place all scans of `options.bag`. Raises BagError when none can be placed."""
    path: Path = options.bag
    with BagReader(path) as bag:
        choice = stream_choice(options, placing, mapper or MapperConfig())
        topics = choose_topics(bag, choice)
        n_scans = sum(topic.n_messages for topic in topics.scans)
        with tqdm(total=n_scans, unit=' scans', desc='read', disable=None) as bar:
            placed = PlacedScans(bag, topics, choice, on_scan=bar.update)
            placements = [
                mounted(scan, robot, sensor_mount(placing.mount, scan.frame_id))
                for scan, robot in placed
            ]
    dropped = dict(placed.placer.dropped)
    if not placements:
        raise BagError(
            f'{path}: none of {n_scans} scans could be placed ({dropped}): '
            f'expected poses on {topics.pose.name} around the stamps of {topics.scan.name}'
        )
    return BagScans(placements, topics, n_scans, dropped)

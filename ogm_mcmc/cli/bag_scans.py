"""Placed scans of a bag, with a progress bar: the door of all commands that read one."""

from __future__ import annotations

import argparse
import contextlib
from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

from tqdm import tqdm

from ogm_mcmc.cli.options import stream_choice
from ogm_mcmc.config import MapperConfig, PlacingConfig
from ogm_mcmc.engine.bag_scans import PlacedScans, StreamTopics, open_scans
from ogm_mcmc.engine.odometry import OdometryAt
from ogm_mcmc.engine.recording import Recording
from ogm_mcmc.errors import GridError
from ogm_mcmc.files.saying import say
from ogm_mcmc.geometry import PlacedScan

__all__ = ['BagScans', 'placed_scans', 'read_bag', 'record']


class BagScans(NamedTuple):
    """All placed scans of a bag, the topics they came from, and what was dropped, by reason.

    `odometry` beside the poses in use, called `odometry_name`, where it was asked for.
    """

    placed: list[PlacedScan]
    topics: StreamTopics
    dropped: dict[str, int]
    odometry: OdometryAt | None = None
    odometry_name: str = ''


@contextlib.contextmanager
def placed_scans(
    options: argparse.Namespace,
    placing: PlacingConfig,
    mapper: MapperConfig | None = None,
    *,
    title: str = 'read',
    beliefs: bool = False,
) -> Iterator[PlacedScans]:
    """Yield the scans of `options.bag`, one after the other, behind a bar with a title.

    What was chosen and what is odd is said on standard error. With `beliefs` covariances count
    whatever the method, but those beside a trajectory file: it may come of these very scans, which
    would then count twice for the poses. Raises BagError that says what is missing.
    """
    choice = stream_choice(options, placing, mapper or MapperConfig())
    if beliefs:
        choice = replace(choice, beliefs=True, deviations=False)
    with (
        open_scans(options.bag, choice) as scans,
        tqdm(total=scans.topics.n_scans, unit=' scans', desc=title, disable=None) as bar,
    ):
        scans.on_scan = bar.update
        scans.tell = say
        yield scans


def read_bag(
    options: argparse.Namespace,
    placing: PlacingConfig,
    mapper: MapperConfig | None = None,
    *,
    beliefs: bool = False,
    odometry: bool = False,
) -> BagScans:
    """Read and place all scans of `options.bag`, with its `odometry` if that is asked for.

    Raises BagError when no scan can be placed.
    """
    with placed_scans(options, placing, mapper, beliefs=beliefs) as scans:
        placed = list(scans)
        wheels = scans.odometry() if odometry else None
    dropped = dict(scans.placer.dropped)
    return BagScans(placed, scans.topics, dropped, wheels, scans.odometry_name)


def record(bag: BagScans, recording: Recording) -> None:
    """Record all scans of a bag but those that lead too far away: they are counted and said.

    Raises GridError where all do.
    """
    refused = ''
    for placed in bag.placed:
        try:
            recording.add(placed)
        except GridError as error:
            bag.dropped['scan_off_map'] = bag.dropped.get('scan_off_map', 0) + 1
            if not refused:
                refused = str(error)
                say(f'scan at {placed.scan.stamp_ns / 1e9:.3f} s left out: {refused}')
    if refused and not len(recording):
        raise GridError(refused)

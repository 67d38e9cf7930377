"""What the demo replays: a log, a bag, or a simulated building."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ogm_mcmc.cli.import_carmen import describe
from ogm_mcmc.cli.options import config_from, stream_choice
from ogm_mcmc.config import PlacingConfig
from ogm_mcmc.config.nodes import NodeMapperConfig
from ogm_mcmc.engine.bag_scans import PlacedScans
from ogm_mcmc.engine.bag_topics import choose_topics
from ogm_mcmc.engine.mounts import mounts_setting
from ogm_mcmc.errors import LogError
from ogm_mcmc.files.saying import say
from ogm_mcmc.io.bag_files import is_recording
from ogm_mcmc.io.bags import BagReader
from ogm_mcmc.io.carmen_import import ImportOptions, import_carmen
from ogm_mcmc.io.recording_bag import write_recording
from ogm_mcmc.simulation import WORLDS, Lidar, record

__all__ = ['DemoInput', 'prepare']

BAG_SUFFIXES = ('.bag', '.mcap', '.db3')


class DemoInput(NamedTuple):
    """A bag to replay and what the nodes have to be told about it.

    `pose_source`: of the nodes; `computed`: what `replay` computes poses from, '' where it sends
    those of `pose_topic` as they are. `mounts`: where sensors sit, as `mount.frames` has it;
    `moving`: others move on the robot, and `replay` sends where they are.
    """

    bag: Path
    scan_topics: tuple[str, ...]
    pose_topic: str
    pose_source: str
    computed: str
    map_frame: str
    base_frame: str
    mounts: str
    moving: bool
    n_scans: int
    beams: int  # of the first scan


def prepare(path: Path | None, folder: Path, options: argparse.Namespace) -> DemoInput:
    """Turn whatever was named into a bag, and look into it."""
    if path is None:
        bag_path = folder / 'recording'
        count = write_recording(
            bag_path, record(WORLDS['office'](), Lidar(), np.random.default_rng(1)), overwrite=True
        )
        say(f'simulated office: {count} scans -> {bag_path}')
    elif path.is_dir() or path.suffix in BAG_SUFFIXES or is_recording(path):
        bag_path = path
    else:
        bag_path = folder / 'recording'
        if not path.exists():
            raise LogError(f'{path}: no such file; expected a CARMEN log or a bag')
        how = ImportOptions(field_of_view_deg=options.field_of_view)
        say(describe(import_carmen(path, bag_path, how, overwrite=True)))
    return _looked_into(bag_path, options)


def _looked_into(bag_path: Path, options: argparse.Namespace) -> DemoInput:
    """Choose scans and poses as `map` does, and say so."""
    choice = stream_choice(
        options, config_from(options, PlacingConfig), config_from(options, NodeMapperConfig)
    )
    with BagReader(bag_path) as bag:
        topics = choose_topics(bag, replace(choice, sensor='scan'))
        topics.require_stamps(bag_path)
        scans = PlacedScans(bag, topics, choice, tell=say)
        for line in topics.remarks:
            say(line)
        found = list(scans.sensor_mounts().values())
        first = next(bag.records((topics.scans[0].name,)))
        beams = len(bag.decode(first).ranges)
    # Of the others some need messages that are not installed everywhere. What moves on the robot
    # `replay` sends together with computed poses.
    moving = any(one.moves for one in found)
    sent = topics.pose_source in ('pose', 'pose_stamped', 'odom', 'particles')
    recorded = sent and not moving
    computed = '' if recorded else topics.pose_source
    return DemoInput(
        bag_path,
        tuple(topic.name for topic in topics.scans),
        topics.pose_name,
        topics.pose_source if recorded else 'pose',
        computed,
        topics.map_frame,
        topics.base_frame,
        mounts_setting(one for one in found if not one.moves),
        moving,
        topics.n_scans,
        beams,
    )

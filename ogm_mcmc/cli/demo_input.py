"""What the demo replays: a log, a bag, or a simulated building."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ogm_mcmc.cli.import_carmen import describe
from ogm_mcmc.errors import BagError, LogError
from ogm_mcmc.io import messages, ros_types
from ogm_mcmc.io.bags import BagReader
from ogm_mcmc.io.carmen_import import ImportOptions, import_carmen
from ogm_mcmc.io.recording_bag import write_recording
from ogm_mcmc.simulation import WORLDS, Lidar, record

__all__ = ['DemoInput', 'prepare']

BAG_SUFFIXES = ('.bag', '.mcap', '.db3')


class DemoInput(NamedTuple):
    """A bag to replay and what the nodes have to be told about it."""

    bag: Path
    from_log: bool
    scan_topic: str
    pose_topic: str
    pose_source: str
    map_frame: str
    n_scans: int
    beams: int  # of the first scan


def prepare(path: Path | None, folder: Path) -> DemoInput:
    """Turn whatever was named into a bag, and look into it."""
    from_log = False
    if path is None:
        bag_path = folder / 'recording'
        count = write_recording(
            bag_path, record(WORLDS['office'](), Lidar(), np.random.default_rng(1)), overwrite=True
        )
        print(f'simulated office: {count} scans -> {bag_path}', file=sys.stderr)
    elif path.is_dir() or path.suffix in BAG_SUFFIXES:
        bag_path = path
    else:
        bag_path, from_log = folder / 'recording', True
        if not path.exists():
            raise LogError(f'{path}: no such file; expected a CARMEN log or a bag')
        print(
            describe(import_carmen(path, bag_path, ImportOptions(), overwrite=True)),
            file=sys.stderr,
        )
    with BagReader(bag_path) as bag:
        scan = bag.find('scans', (ros_types.SCAN,))
        try:
            pose, source = bag.find('poses', (ros_types.POSE,)), 'pose'
        except BagError:
            pose, source = bag.find('poses', (ros_types.POSE, ros_types.PARTICLES)), 'particles'
        first = next(bag.records((pose.name,)), None)
        if first is None:
            raise BagError(f'{bag_path}: no message on {pose.name}, although its index names some')
        frame = messages.frame_of(bag.decode(first))
        scan_message = next(bag.records((scan.name,)), None)
        if scan_message is None:
            raise BagError(f'{bag_path}: no message on {scan.name}, although its index names some')
        beams = len(bag.decode(scan_message).ranges)
    return DemoInput(
        bag_path, from_log, scan.name, pose.name, source, frame, scan.n_messages, beams
    )

"""`info BAG` (or a trajectory file): what is inside, on one screen."""

from __future__ import annotations

import argparse
import itertools
import math
from pathlib import Path
from typing import Any

import numpy as np

from ogm_mcmc.cli.options import Subparsers, add_json, print_result
from ogm_mcmc.config.pose_sources import POSE_SOURCES
from ogm_mcmc.engine.bag_scans import PlacedScans
from ogm_mcmc.engine.bag_topics import choose_topics
from ogm_mcmc.engine.stream_choice import StreamChoice
from ogm_mcmc.errors import OgmError
from ogm_mcmc.geometry import Scan
from ogm_mcmc.io import messages, ros_types
from ogm_mcmc.io.bags import BagReader
from ogm_mcmc.io.tf_messages import TF_TYPES, read_transforms
from ogm_mcmc.io.trajectory_files import read_trajectory

__all__ = ['add_to']

# Suffixes that only trajectories have.
TRAJECTORIES = ('.tum', '.txt', '.csv', '.kitti', '.g2o', '.traj')

# Transforms come in turn: so many messages of a topic are asked what they name.
TF_MESSAGES = 100

DETAILS = (
    'frame',
    'transforms',
    'sensors',
    'beams',
    'field_of_view_rad',
    'range_m',
    'particles',
    'remark',
    'problem',
)


def add_to(subparsers: Subparsers) -> None:
    """Declare the command."""
    parser = subparsers.add_parser(
        'info', help='what a bag or a trajectory file holds, on one screen'
    )
    parser.add_argument('bag', type=Path, help='ROS 1 bag, rosbag2 or trajectory file')
    parser.add_argument(
        '--trajectory-stamps', type=Path, metavar='FILE', help='stamps of a KITTI or g2o file'
    )
    add_json(parser)
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Run the command."""
    if options.bag.is_file() and options.bag.suffix in TRAJECTORIES:
        return _of_trajectory(options)
    with BagReader(options.bag) as bag:
        duration_s = bag.duration_ns / 1e9
        values: dict[str, Any] = {
            'path': str(options.bag),
            'kind': bag.kind,
            'messages': bag.message_count,
            'start_s': bag.start_ns / 1e9,
            'duration_s': duration_s,
            'topics': [
                {**topic._asdict(), **_first_message(bag, topic.name, topic.msgtype)}
                for topic in bag.topics()
            ],
            'map_takes': _what_map_takes(bag),
        }
    print_result(options, values, _text(values))
    return 0


def _what_map_takes(bag: BagReader) -> list[str]:
    """Return the lines that `map` would say of its choice, or why it can take nothing."""
    kinds = {topic.msgtype for topic in bag.topics() if topic.n_messages > 0}
    only_cones = ros_types.RANGE in kinds and ros_types.SCAN not in kinds
    choice = StreamChoice(sensor='range' if only_cones else 'scan')
    try:
        topics = choose_topics(bag, choice)
        lines = list(topics.remarks)
        scans = PlacedScans(bag, topics, choice, tell=lines.append)
        scans.sensor_mounts()
        scans.learn_codes()
        return lines
    except OgmError as error:
        return [str(error)]


def _of_trajectory(options: argparse.Namespace) -> int:
    held = read_trajectory(options.bag, options.trajectory_stamps)
    places = np.array([(pose.x_m, pose.y_m) for pose in held.poses])
    first, last = int(held.stamps_ns[0]), int(held.stamps_ns[-1])
    values: dict[str, Any] = {
        'path': str(options.bag),
        'kind': f'trajectory ({held.format})',
        'poses': len(held.poses),
        'start_s': first / 1e9,
        'duration_s': (last - first) / 1e9,
        'length_m': round(float(np.hypot(*np.diff(places, axis=0).T).sum()), 3),
        'x_m': [round(float(value), 3) for value in (places[:, 0].min(), places[:, 0].max())],
        'y_m': [round(float(value), 3) for value in (places[:, 1].min(), places[:, 1].max())],
    }
    text = (
        f'{values["path"]}: {values["kind"]}, {values["poses"]} poses, '
        f'{values["duration_s"]:.1f} s from {values["start_s"]:.3f} s\n'
        f'  {values["length_m"]} m long, x {values["x_m"]}, y {values["y_m"]} m'
    )
    print_result(options, values, text)
    return 0


def _first_message(bag: BagReader, topic: str, msgtype: str) -> dict[str, Any]:
    """Return the essentials of a scan, range or pose topic, from its first message (tf: some).

    Of any topic, `problem` says why it cannot be read.
    """
    interesting = (
        ros_types.SCAN,
        ros_types.RANGE,
        *(kind for kinds in POSE_SOURCES.values() for kind in kinds),
    )
    if problem := bag.problem(topic):
        return {'problem': problem}
    try:
        record = next(bag.records((topic,)), None) if msgtype in interesting else None
        if record is None:
            return {}
        message = bag.decode(record)
        if msgtype in TF_TYPES:
            return {'transforms': _transforms_in(bag, topic)}
        details: dict[str, Any] = {'frame': messages.frame_of(message)}
        if msgtype == ros_types.SCAN:
            remarks: list[str] = []
            scan = messages.read_scan(message, remarks.append)
            if remarks:
                details['remark'] = '; '.join(remarks)
            details['beams'] = scan.ranges_m.size
            details['range_m'] = _limits(scan)
        elif msgtype == ros_types.RANGE:
            scan = messages.read_range(message)
            details['field_of_view_rad'] = round(scan.beam_width_rad, 3)
            details['range_m'] = _limits(scan)
            details['sensors'] = len(_frames_in_turn(bag, topic))
        elif msgtype == ros_types.PARTICLES:
            details['particles'] = len(message.poses)
        elif msgtype == ros_types.PARTICLE_CLOUD:
            details['particles'] = len(message.particles)
    except OgmError as error:
        return {'problem': str(error)}
    return details


def _transforms_in(bag: BagReader, topic: str) -> list[str]:
    """Return the transforms that the first messages of a topic name, in order, each once."""
    return list(
        dict.fromkeys(
            f'{entry.parent} -> {entry.child}'
            for record in itertools.islice(bag.records((topic,)), TF_MESSAGES)
            for entry in read_transforms(bag.decode(record)).entries
        )
    )


def _limits(scan: Scan) -> list[float | None]:
    """Return range_min and range_max in m, None for one that is not said."""
    furthest = scan.range_max_m
    return [round(scan.range_min_m, 3), round(furthest, 3) if math.isfinite(furthest) else None]


def _frames_in_turn(bag: BagReader, topic: str) -> set[str]:
    """Return the frames on a topic up to where one of them comes again."""
    frames: set[str] = set()
    for record in bag.records((topic,)):
        frame = messages.frame_of(bag.decode(record))
        if frame in frames:
            break
        frames.add(frame)
    return frames


def _text(values: dict[str, Any]) -> str:
    lines = [
        f'{values["path"]}: {values["kind"]}, {values["messages"]} messages, '
        f'{values["duration_s"]:.1f} s from {values["start_s"]:.3f} s'
    ]
    width = max((len(topic['name']) for topic in values['topics']), default=0)
    for topic in values['topics']:
        rate = topic['n_messages'] / values['duration_s'] if values['duration_s'] > 0 else 0.0
        details = ', '.join(f'{key} {topic[key]}' for key in DETAILS if key in topic)
        lines.append(
            f'  {topic["name"]:<{width}}  {topic["n_messages"]:>8}  {rate:>7.2f} Hz  '
            f'{topic["msgtype"]}' + (f'  ({details})' if details else '')
        )
    lines += [f'  map: {line}' for line in values['map_takes']]
    return '\n'.join(lines)

"""`info BAG`: what is inside, on one screen."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import Any

from ogm_mcmc.cli.options import Subparsers, add_json, print_result
from ogm_mcmc.config.pose_sources import POSE_SOURCES
from ogm_mcmc.errors import OgmError
from ogm_mcmc.geometry import Scan
from ogm_mcmc.io import messages, ros_types
from ogm_mcmc.io.bags import BagReader

__all__ = ['add_to']

DETAILS = (
    'frame',
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
    parser = subparsers.add_parser('info', help='what a bag holds, on one screen')
    parser.add_argument('bag', type=Path, help='ROS 1 bag or rosbag2')
    add_json(parser)
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Run the command."""
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
        }
    print_result(options, values, _text(values))
    return 0


def _first_message(bag: BagReader, topic: str, msgtype: str) -> dict[str, Any]:
    """Return the essentials of a scan, range or pose topic, from its first message.

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
    except OgmError as error:
        return {'problem': str(error)}
    return details


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
    return '\n'.join(lines)

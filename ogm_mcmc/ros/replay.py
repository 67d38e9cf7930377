"""The node `replay`: publishes what a bag holds, at a chosen rate, with `/clock` on request."""

from __future__ import annotations

import argparse
import importlib
import json
import sys
import threading
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rclpy._rclpy_pybind11 import RCLError
from rclpy.exceptions import NameValidationException
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.utilities import remove_ros_args
from rosgraph_msgs.msg import Clock
from std_srvs.srv import SetBool
from tqdm import tqdm

from ogm_mcmc.config import add_arguments, given
from ogm_mcmc.config.nodes import ReplayConfig
from ogm_mcmc.errors import BagError, ConfigError
from ogm_mcmc.files.user_paths import user_path
from ogm_mcmc.io.bags import BagReader, BagRecord, BagTopic
from ogm_mcmc.io.messages import time_parts
from ogm_mcmc.ros.pacing import Pacer
from ogm_mcmc.ros.parameters import ParameterSet
from ogm_mcmc.ros.running import StopSignal, ros_args_explained, run_node

__all__ = ['Replay', 'main', 'replay']

LONGEST_SLEEP_S = 0.05
CLOCK_PERIOD_S = 0.01


@dataclass(slots=True)
class ReplayCounts:
    """What a replay did, for the user and for machines."""

    published: Counter[str]
    skipped_topics: dict[str, str]
    skipped_messages: int = 0
    loops: int = 0
    seconds: float = 0.0

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {
            'published': dict(self.published),
            'skipped_topics': self.skipped_topics,
            'skipped_messages': self.skipped_messages,
            'loops': self.loops,
            'seconds': round(self.seconds, 3),
        }


class Replay(Node):
    """Publishes the stored bytes as they are; ROS 1 messages are converted, not decoded.

    rate 1 keeps the times of the recording, 0 goes as fast as the subscribers keep up: see
    `ogm_mcmc.ros.pacing`.
    """

    def __init__(self, bag: Path, **node_options: Any) -> None:
        super().__init__('replay', **node_options)
        self.parameters = ParameterSet(self, (ReplayConfig,), frozenset())
        self.settings = self.parameters.read(ReplayConfig)
        self.bag = bag
        self.counts = ReplayCounts(Counter(), {})
        self.running = threading.Event()
        self.running.set()
        if self.settings.start_paused:
            self.running.clear()
        self.stopped = threading.Event()
        self.failure: BaseException | None = None
        self.outlets: dict[str, Publisher] = {}
        self.pacer = Pacer(self, self.outlets)
        self._wall = 0.0  # when the first message was due, on the steady clock
        self.clock_outlet = (
            self.create_publisher(Clock, '/clock', 10) if self.settings.clock else None
        )
        self.create_service(SetBool, '~/pause', self.on_pause)
        self.add_on_set_parameters_callback(self.parameters.check)

    def on_pause(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        """Stop or go on publishing."""
        if request.data:
            self.running.clear()
        else:
            self.running.set()
        response.success = True
        response.message = 'paused' if request.data else 'publishing'
        return response

    def play(self) -> None:
        """Publish the whole bag, again and again with `loop`; runs in its own thread."""
        with BagReader(self.bag) as bag:
            chosen = self._choose(bag)
            self._advertise(chosen)
            self._wait_for_subscribers()
            started = time.monotonic()
            while not self.stopped.is_set():
                self._play_once(bag, [topic.name for topic in chosen])
                self.counts.loops += 1
                if not self.settings.loop:
                    break
            self._drain()
            self.counts.seconds = time.monotonic() - started

    # -- which topics -----------------------------------------------------------------------

    def _choose(self, bag: BagReader) -> list[BagTopic]:
        wanted = [name.lstrip('/') for name in self.settings.topics.replace(',', ' ').split()]
        held = {topic.name.lstrip('/'): topic for topic in bag.topics()}
        for name in wanted:
            if name not in held:
                raise BagError(
                    f'{bag.path}: no topic {name} in it: expected one of {", ".join(held)}'
                )
        chosen = [topic for name, topic in held.items() if not wanted or name in wanted]
        usable = []
        for topic in chosen:
            if topic.name == '/clock' and self.clock_outlet is not None:
                self.counts.skipped_topics[topic.name] = 'the clock is made anew'
            elif _message_class(topic.msgtype) is None:
                self._skip(topic, f'its type {topic.msgtype} is not installed')
            else:
                usable.append(topic)
        if not usable:
            raise BagError(f'{bag.path}: no topic in it can be published')
        return usable

    def _skip(self, topic: BagTopic, reason: str) -> None:
        self.counts.skipped_topics[topic.name] = reason
        self.get_logger().warning(f'{topic.name} is left out: {reason}')

    def _advertise(self, topics: list[BagTopic]) -> None:
        renamed = _remaps(self.settings.remap)
        for old in renamed.keys() - {topic.name.lstrip('/') for topic in topics}:
            raise ConfigError(f'remap of {old}: no such topic is published')
        for topic in topics:
            message_class = _message_class(topic.msgtype)
            # Absolute names become relative, so that namespaces and ROS remaps apply.
            name = renamed.get(topic.name.lstrip('/'), topic.name.lstrip('/'))
            try:
                outlet = self.create_publisher(message_class, name, _profile(topic))
            except (NameValidationException, RCLError) as error:
                reason = ' '.join(str(error).split())
                raise ConfigError(
                    f'{topic.name} cannot be published as {name}: {reason}'
                ) from error
            self.outlets[topic.name] = outlet

    def _wait_for_subscribers(self) -> None:
        """Wait until every topic that is listened to at all has been discovered."""
        deadline = time.monotonic() + self.settings.wait
        publishers = self.outlets.values()
        while time.monotonic() < deadline and not self.stopped.is_set():
            enough = self.settings.wait_subscribers
            listened = [p for p in publishers if p.get_subscription_count() >= enough]
            if len(listened) >= min(self.settings.wait_topics, len(self.outlets)):
                # The other side's discovery of us may lag a little behind ours of it.
                self.stopped.wait(0.2)
                return
            self.stopped.wait(0.05)

    # -- publishing -------------------------------------------------------------------------

    def _play_once(self, bag: BagReader, topics: list[str]) -> None:
        start_ns = bag.start_ns + round(self.settings.start * 1e9)
        if start_ns > bag.start_ns + bag.duration_ns:
            raise ConfigError(
                f'start is {self.settings.start:g} s: expected less than the '
                f'{bag.duration_ns / 1e9:g} s the bag lasts'
            )
        total = sum(topic.n_messages for topic in bag.topics() if topic.name in topics)
        self._wall = time.monotonic()
        bar = tqdm(
            total=total, unit=' msg', desc='replay', disable=not self.settings.progress, leave=True
        )
        with bar:
            for record in bag.records(topics, start_ns):
                self._wait_until_due(record.time_ns, start_ns)
                if self.stopped.is_set():
                    return
                self._send_clock(record.time_ns)
                self._publish(bag, record)
                bar.update()

    def _wait_until_due(self, time_ns: int, start_ns: int) -> None:
        """Sleep until a message is due, with the clock going on; a pause puts everything off."""
        rate = self.settings.rate
        while not self.stopped.is_set():
            if not self.running.is_set():
                paused = time.monotonic()
                self.running.wait(LONGEST_SLEEP_S)
                self._wall += time.monotonic() - paused
                continue
            if rate == 0.0:
                return
            left = self._wall + (time_ns - start_ns) / 1e9 / rate - time.monotonic()
            if left <= 0.0:
                return
            if self.clock_outlet is not None:
                self._send_clock(time_ns - round(left * rate * 1e9))
            time.sleep(min(left, LONGEST_SLEEP_S if self.clock_outlet is None else CLOCK_PERIOD_S))

    def _send_clock(self, time_ns: int) -> None:
        if self.clock_outlet is None:
            return
        message = Clock()
        message.clock.sec, message.clock.nanosec = time_parts(max(0, time_ns))
        self.clock_outlet.publish(message)

    def _publish(self, bag: BagReader, record: BagRecord) -> None:
        try:
            raw = bag.cdr(record)
        except BagError as error:
            self.counts.skipped_messages += 1
            if self.counts.skipped_messages == 1:
                self.get_logger().warning(f'message left out: {error}')
            return
        publisher = self.outlets[record.topic]
        publisher.publish(raw)
        self.counts.published[record.topic] += 1
        if self.settings.rate == 0.0:
            self.pacer.sent(publisher, self.stopped)

    def _drain(self) -> None:
        """Let the subscribers take the last messages before the publishers go."""
        if not self.stopped.is_set():
            self.pacer.wait(self.stopped)


def _message_class(msgtype: str) -> Any:
    parts = msgtype.split('/')
    if len(parts) != 3:
        return None
    try:
        return getattr(importlib.import_module(f'{parts[0]}.{parts[1]}'), parts[2], None)
    except ImportError:
        return None


def _remaps(text: str) -> dict[str, str]:
    remaps = {}
    for rule in text.replace(',', ' ').split():
        # Not OLD:=NEW, which rclpy would take for itself.
        old, equals, new = rule.partition('=')
        if not (old and equals and new):
            raise ConfigError(f'remap is {rule!r}: expected OLD=NEW')
        remaps[old.lstrip('/')] = new
    return remaps


def _profile(topic: BagTopic) -> QoSProfile:
    latched = topic.name.endswith(('/tf_static', '/map'))
    return QoSProfile(
        depth=100,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=(DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE),
    )


def _spin_while_playing(node: Replay, told: StopSignal) -> None:
    def work() -> None:
        try:
            node.play()
        except BaseException as error:
            node.failure = error
        finally:
            node.stopped.set()

    player = threading.Thread(target=work, name='replay')
    player.start()
    try:
        told.spin(node, lambda: not node.stopped.is_set())
    finally:
        node.stopped.set()
        node.running.set()
        player.join()
    if node.failure is not None:
        raise node.failure


def replay(options: argparse.Namespace, ros_args: list[str] | None = None) -> int:
    """Run the node with the options of the command line; return the exit code."""
    named = given(options, ReplayConfig)
    overrides = [Parameter(name, value=value) for name, value in named.items()]
    nodes: list[Replay] = []

    def make() -> Replay:
        path = user_path(options.bag, 'bag', BagError)
        nodes.append(Replay(path, parameter_overrides=overrides))
        return nodes[0]

    code = run_node(make, ros_args, _spin_while_playing)
    if options.json and nodes:
        print(json.dumps(nodes[0].counts.as_dict()))
    return code


def main(args: list[str] | None = None) -> None:
    """Run `replay BAG [options] [--ros-args ...]`."""
    argv = sys.argv if args is None else ['replay', *args]
    parser = argparse.ArgumentParser(prog='replay', description=__doc__)
    parser.add_argument('bag', help='ROS 1 bag or rosbag2')
    add_arguments(parser, ReplayConfig)
    parser.add_argument('--json', action='store_true', help='print what was done as JSON')
    try:
        with ros_args_explained():
            own = remove_ros_args(argv)[1:]
    except ConfigError as error:
        print(f'error: {error}', file=sys.stderr)
        sys.exit(2)
    options = parser.parse_args(own)
    sys.exit(replay(options, argv[1:]))


if __name__ == '__main__':
    main()

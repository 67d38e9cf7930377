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
from rclpy.utilities import remove_ros_args
from rosgraph_msgs.msg import Clock
from std_srvs.srv import SetBool
from tqdm import tqdm

from ogm_mcmc.config import add_arguments, given
from ogm_mcmc.config.nodes import ReplayConfig
from ogm_mcmc.errors import BagError, ConfigError
from ogm_mcmc.files.saying import say
from ogm_mcmc.files.user_paths import user_path
from ogm_mcmc.io.bags import BagReader, BagRecord, BagTopic
from ogm_mcmc.io.messages import time_parts
from ogm_mcmc.io.tf_messages import TF_TYPES
from ogm_mcmc.ros.computed_poses import ComputedPoses, computed_poses
from ogm_mcmc.ros.pacing import Pacer
from ogm_mcmc.ros.parameters import ParameterSet
from ogm_mcmc.ros.qos import recorded_profile
from ogm_mcmc.ros.running import StopSignal, ros_args_explained, run_node

__all__ = ['Replay', 'main', 'replay']

LONGEST_SLEEP_S = 0.05
CLOCK_PERIOD_S = 0.01

# Stamps further apart are a stray one or another clock: nobody waits for that.
LONGEST_GAP_S = 60.0

LATEST_S = 2**31 - 1  # what a time message holds


@dataclass(slots=True)
class ReplayCounts:
    """What a replay did, for the user and for machines."""

    published: Counter[str]
    skipped_topics: dict[str, str]
    skipped_messages: int = 0
    skipped_seconds: float = 0.0
    loops: int = 0
    seconds: float = 0.0

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {
            'published': dict(self.published),
            'skipped_topics': self.skipped_topics,
            'skipped_messages': self.skipped_messages,
            'skipped_seconds': round(self.skipped_seconds, 3),
            'loops': self.loops,
            'seconds': round(self.seconds, 3),
        }


class Replay(Node):
    """Publishes the stored bytes as they are; those of ROS 1 or older types are converted.

    Topics are latched and reliable as they were recorded; reliable where a recording says nothing.
    rate 1 keeps the times of the recording, 0 goes as fast as the subscribers keep up: see
    `ogm_mcmc.ros.pacing`. Poses that cannot be sent are computed: see `computed_poses`.
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
        self.unheard = False
        self.outlets: dict[str, Publisher] = {}
        self.pacer = Pacer(self, self.outlets)
        self.poses: ComputedPoses | None = None
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
            tf_is_sent = any(topic.msgtype in TF_TYPES for topic in chosen)
            self.poses = computed_poses(self, bag, self.settings, tf_is_sent=tf_is_sent)
            if self.poses is not None:
                chosen = self._without_computed(chosen)
            self._advertise(bag, chosen)
            self._wait_for_subscribers()
            if self.unheard:
                return
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
            elif reason := bag.unsendable(topic.name):
                self._skip(topic, reason)
            elif _message_class(topic.msgtype) is None:
                self._skip(topic, f'its type {topic.msgtype} is not installed')
            else:
                usable.append(topic)
        if not usable:
            raise BagError(
                f'{bag.path}: no topic in it can be published: expected at least one that can'
            )
        return usable

    def _without_computed(self, chosen: list[BagTopic]) -> list[BagTopic]:
        computed = {} if self.poses is None else self.poses.outlets
        for topic in chosen:
            if topic.name.lstrip('/') in computed:
                self._skip(topic, 'others are published there')
        return [topic for topic in chosen if topic.name.lstrip('/') not in computed]

    def _skip(self, topic: BagTopic, reason: str) -> None:
        self.counts.skipped_topics[topic.name] = reason
        self.get_logger().warning(f'{topic.name} is left out: {reason}')

    def _advertise(self, bag: BagReader, topics: list[BagTopic]) -> None:
        renamed = _remaps(self.settings.remap)
        for old in renamed.keys() - {topic.name.lstrip('/') for topic in topics}:
            raise ConfigError(f'remap of {old}: no such topic is published')
        if self.poses is not None:
            self.outlets.update(self.poses.outlets)
        for topic in topics:
            message_class = _message_class(topic.msgtype)
            # Absolute names become relative, so that namespaces and ROS remaps apply.
            name = renamed.get(topic.name.lstrip('/'), topic.name.lstrip('/'))
            try:
                outlet = self.create_publisher(
                    message_class, name, recorded_profile(topic.name, bag.offer(topic.name))
                )
            except (NameValidationException, RCLError) as error:
                reason = ' '.join(str(error).split())
                raise ConfigError(
                    f'{topic.name} cannot be published as {name}: {reason}'
                ) from error
            self.outlets[topic.name] = outlet

    def _wait_for_subscribers(self) -> None:
        """Wait until enough topics are listened to; `unheard` if none is in time."""
        while not self.running.wait(LONGEST_SLEEP_S) and not self.stopped.is_set():
            pass  # whoever started paused is not in a hurry
        deadline = time.monotonic() + self.settings.wait
        publishers = self.outlets.values()
        while time.monotonic() < deadline and not self.stopped.is_set():
            enough = self.settings.wait_subscribers
            listened = [p for p in publishers if p.get_subscription_count() >= enough]
            if len(listened) >= min(self.settings.wait_topics, len(self.outlets)):
                if self.settings.rate == 0.0:
                    self.pacer.meet(self.stopped)
                else:  # nobody is waited for, but the other side may find us a little later
                    self.stopped.wait(0.2)
                return
            self.stopped.wait(0.05)
        nobody = not any(publisher.get_subscription_count() for publisher in publishers)
        if nobody and self.settings.wait > 0.0 and not self.stopped.is_set():
            self.unheard = True
            self.get_logger().error(
                f'nobody listened to {", ".join(p.topic_name for p in publishers)} within '
                f'{self.settings.wait:g} s: expected a subscriber (or --wait 0)'
            )

    # -- publishing -------------------------------------------------------------------------

    def _play_once(self, bag: BagReader, topics: list[str]) -> None:
        start_ns = bag.start_ns + round(self.settings.start * 1e9)
        if start_ns > bag.start_ns + bag.duration_ns:
            raise ConfigError(
                f'start is {self.settings.start:g} s: expected less than the '
                f'{bag.duration_ns / 1e9:g} s the bag lasts'
            )
        total = sum(topic.n_messages for topic in bag.topics() if topic.name in topics)
        if self.poses is not None:
            self.poses.restart()
        self._wall, last_ns = time.monotonic(), start_ns
        bar = tqdm(
            total=total, unit=' msg', desc='replay', disable=not self.settings.progress, leave=True
        )
        with bar:
            for record in bag.records(topics, start_ns):
                self._skip_gap(last_ns, record.time_ns)
                last_ns = max(last_ns, record.time_ns)
                self._wait_until_due(record.time_ns, start_ns)
                if self.stopped.is_set():
                    return
                self._send_clock(record.time_ns)
                self._publish(bag, record)
                bar.update()

    def _skip_gap(self, last_ns: int, time_ns: int) -> None:
        """Go on at once where the times jump, and say so."""
        gap_s = (time_ns - last_ns) / 1e9
        if gap_s <= LONGEST_GAP_S:
            return
        if self.settings.rate > 0.0:
            self.counts.skipped_seconds += gap_s
            self._wall -= gap_s / self.settings.rate
            self.get_logger().warning(
                f'the times jump by {gap_s:.0f} s to {time_ns / 1e9:.3f} s: not waiting for that'
            )

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
        seconds, nanoseconds = time_parts(max(0, time_ns))
        if self.clock_outlet is None or seconds > LATEST_S:
            return
        message = Clock()
        message.clock.sec, message.clock.nanosec = seconds, nanoseconds
        self.clock_outlet.publish(message)

    def _publish(self, bag: BagReader, record: BagRecord) -> None:
        publisher = self.outlets[record.topic]
        if self.poses is not None:
            for topic in self.poses.before(record):
                self._count(topic, self.poses.outlets[topic])
        try:
            publisher.publish(bag.cdr(record))
        except (BagError, RCLError) as error:
            self.counts.skipped_messages += 1
            if self.counts.skipped_messages == 1:
                self.get_logger().warning(f'message left out: {" ".join(str(error).split())}')
            return
        self._count(record.topic, publisher)

    def _count(self, topic: str, publisher: Publisher) -> None:
        self.counts.published[topic] += 1
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
    """Run the node with the options of the command line; return the exit code.

    1: nobody listened; 2: a user's mistake.
    """
    named = given(options, ReplayConfig)
    overrides = [Parameter(name, value=value) for name, value in named.items()]
    nodes: list[Replay] = []

    def make() -> Replay:
        path = user_path(options.bag, 'bag', BagError)
        nodes.append(Replay(path, parameter_overrides=overrides))
        return nodes[0]

    code = run_node(make, ros_args, _spin_while_playing)
    if nodes and nodes[0].unheard:
        code = code or 1
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
        say(f'error: {error}')
        sys.exit(2)
    options = parser.parse_args(own)
    sys.exit(replay(options, argv[1:]))


if __name__ == '__main__':
    main()

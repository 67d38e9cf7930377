"""Whether a node gets what it needs, and who should send it: for the log and /diagnostics."""

from __future__ import annotations

import time
from typing import NamedTuple

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node

from ogm_mcmc.errors import listed

__all__ = ['WELL', 'Health', 'IntakeHealth', 'publishers_of']

# A node that has just started waits; that is worth a line only if it goes on.
QUIET_S = 3.0


class Health(NamedTuple):
    """A level of diagnostic_msgs/DiagnosticStatus and one line; empty when all is well."""

    level: bytes
    message: str


WELL = Health(DiagnosticStatus.OK, '')


class IntakeHealth:
    """Watches what comes in on some topics; `judge` says how it is and logs a change once."""

    def __init__(self, node: Node, scan_topics: list[str], pose_topics: list[str]) -> None:
        self.node = node
        self.scan_topics = scan_topics
        self.pose_topics = pose_topics
        self._started = time.monotonic()
        self._scan_s = self._pose_s = self._used_s = float('-inf')
        self._logged = ''

    def begin(self) -> None:
        """Begin to wait: now is the time from which on something could have come."""
        self._started = time.monotonic()

    def scan_came(self) -> None:
        """Note a scan."""
        self._scan_s = time.monotonic()

    def pose_came(self) -> None:
        """Note a pose, or a transform where poses come from tf."""
        self._pose_s = time.monotonic()

    def scan_used(self) -> None:
        """Note a scan that was placed and used."""
        self._used_s = time.monotonic()

    def judge(self, stale_after_s: float, *, paused: bool = False) -> Health:
        """Return OK while scans are used, WARN before the first, ERROR after a time without.

        A node that is paused misses nothing.
        """
        now_s = time.monotonic()
        if paused:
            self._started = now_s
            return Health(DiagnosticStatus.OK, 'paused')
        without_s = now_s - max(self._used_s, self._started)
        waiting = self._used_s < self._started
        if without_s > stale_after_s:
            what = self._missing(now_s - stale_after_s)
            health = Health(
                DiagnosticStatus.ERROR, f'{what} for {without_s:.0f} s: {self.who_publishes()}'
            )
        elif waiting:
            health = Health(DiagnosticStatus.WARN, f'waiting: {self.who_publishes()}')
        else:
            health = WELL
        self._log(health, now_s)
        return health

    def _missing(self, since_s: float) -> str:
        if self._scan_s < since_s:
            return 'no scan and no pose' if self._pose_s < since_s else 'no scan'
        return 'no pose' if self._pose_s < since_s else 'scans and poses come, but none was used'

    def who_publishes(self) -> str:
        """Return `/scan has 0 publishers, /pose has 1 (/amcl)`."""
        topics = [*self.scan_topics, *self.pose_topics]
        first, *rest = (_described(self.node, topic) for topic in topics)
        return ', '.join([first.long, *(one.short for one in rest)])

    def who_sends_poses(self) -> str:
        """Return `/pose has 0 publishers`."""
        first, *rest = (_described(self.node, topic) for topic in self.pose_topics)
        return ', '.join([first.long, *(one.short for one in rest)])

    def _log(self, health: Health, now_s: float) -> None:
        state = {DiagnosticStatus.OK: 'well', DiagnosticStatus.WARN: 'waiting'}.get(
            health.level, 'stale'
        )
        if state == self._logged or (state == 'waiting' and now_s - self._started < QUIET_S):
            return
        logger, before = self.node.get_logger(), self._logged
        self._logged = state
        if state == 'stale':
            logger.error(health.message)
        elif state == 'waiting':
            logger.warning(health.message)
        elif before:
            logger.info('scans are used now')


class _Described(NamedTuple):
    topic: str
    names: list[str]

    @property
    def short(self) -> str:
        who = f' ({listed(self.names)})' if self.names else ''
        return f'{self.topic} has {len(self.names)}{who}'

    @property
    def long(self) -> str:
        who = f' ({listed(self.names)})' if self.names else ''
        plural = '' if len(self.names) == 1 else 's'
        return f'{self.topic} has {len(self.names)} publisher{plural}{who}'


def publishers_of(node: Node, topic: str) -> list[str]:
    """Return the full names of the nodes that publish on a topic, one for each publisher."""
    found = node.get_publishers_info_by_topic(topic)
    return sorted(f'{one.node_namespace.rstrip("/")}/{one.node_name}' for one in found)


def _described(node: Node, topic: str) -> _Described:
    return _Described(topic, publishers_of(node, topic))

"""What a node could not use: counted under a reason, and said now and then."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Mapping

from rclpy.node import Node

__all__ = ['Problems']

WARN_EVERY_S = 5.0

# At most this many remarks are logged.
MAX_REMARKS = 20


class Problems:
    """Counters by reason and warnings, at most one every five seconds for each reason.

    `elsewhere()` gives what others count under reasons of the same kind.
    """

    def __init__(self, node: Node, elsewhere: Callable[[], Mapping[str, int]]) -> None:
        self.node = node
        self.elsewhere = elsewhere
        self._counts: Counter[str] = Counter()
        self._warned_at: dict[str, float] = {}
        self._reported: Counter[str] = Counter()
        self._remarks: set[str] = set()

    def warn(self, reason: str, text: str | Callable[[], str], *, count: bool = True) -> None:
        """Count a problem (unless it is counted elsewhere) and say so where that is due.

        A text that takes long to find out is given as a function.
        """
        if count:
            self._counts[reason] += 1
        now = time.monotonic()
        if now - self._warned_at.get(reason, -WARN_EVERY_S) >= WARN_EVERY_S:
            self._warned_at[reason] = now
            said = text if isinstance(text, str) else text()
            self.node.get_logger().warning(f'{said} [{reason}: {self.all()[reason]}]')

    def remark(self, text: str) -> None:
        """Say once what was odd and how it was understood."""
        if text not in self._remarks and len(self._remarks) < MAX_REMARKS:
            self._remarks.add(text)
            self.node.get_logger().warning(text)

    def all(self) -> Counter[str]:
        """Return how often each thing went wrong."""
        return self._counts + Counter(self.elsewhere())

    def new(self) -> Counter[str]:
        """Return what went wrong since this was last asked."""
        problems = self.all()
        fresh = problems - self._reported
        self._reported = problems
        return fresh

    def values(self) -> dict[str, object]:
        """Return what was dropped and why, for /diagnostics."""
        return {f'dropped: {key}': count for key, count in sorted(self.all().items())}

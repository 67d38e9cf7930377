"""What the node's thread leaves for the worker's: scans to sample, and when to end."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from typing import NamedTuple

from ogm_mcmc.config import StopConfig
from ogm_mcmc.engine.recording import Recording
from ogm_mcmc.geometry import PlacedScan

__all__ = ['Order', 'Orders']


class Order(NamedTuple):
    """Scans to sample, and when to stop; what chooses among them where there is no room.

    left_out  how many were chosen to go, of those that were asked for
    settled  False: their poses are being corrected, and are not to be estimated meanwhile
    drifting  their poses are those of odometry
    """

    scans: Sequence[PlacedScan]
    stop: StopConfig
    kept: Recording | None = None
    left_out: int = 0
    settled: bool = True
    drifting: bool = False


class Orders:
    """The last order, the one at work, and what else is asked of the worker.

    All is guarded by the condition `changed`, of a re-entrant lock; the worker waits for it.
    """

    def __init__(self) -> None:
        self.changed = threading.Condition()
        self.at_work: Order | None = None
        self.cancel = ''  # why the order at work shall end
        self.save = False
        self.forget = False
        self.closing = False
        self._order: Order | None = None

    def leave(self, order: Order | None, reason: str) -> bool:
        """Have this carried out next, and what is at work ended; return whether anything was."""
        with self.changed:
            busy = self.at_work is not None
            some = busy or self._order is not None
            self._order = order
            if busy:
                self.cancel = reason
            self.changed.notify()
            return some

    def tell(self) -> None:
        """Wake the worker where it waits."""
        with self.changed:
            self.changed.notify()

    @property
    def wanted(self) -> bool:
        """Whether somebody waits for a result: there is an order, and nobody ended it."""
        with self.changed:
            return self._order is not None or (self.at_work is not None and not self.cancel)

    def wait(self) -> None:
        """Wait for something to do."""
        self.at_work, self.cancel = None, ''
        self.changed.wait_for(lambda: self._order or self.save or self.forget or self.closing)

    def take(self) -> bool:
        """Take the order to work, if there is one; False: there is nothing left to do."""
        self.at_work, self._order = self._order, None
        return self.at_work is not None or self.save or not self.closing

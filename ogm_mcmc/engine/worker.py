"""The thread that samples while its node goes on; imports no ROS.

The node's thread leaves orders and reads `status`, `result` and `failure`, each one reference that
the worker swaps. Nobody ever waits for the other: kernels release the GIL, and an order takes
effect when the round of sampling in progress is over, about 0.1 s.
"""

from __future__ import annotations

import contextlib
import os
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from ogm_mcmc.config import PosesConfig, SamplerConfig, StopConfig
from ogm_mcmc.engine.kept_poses import KeptPoses
from ogm_mcmc.engine.kept_samples import MOST_SAMPLES
from ogm_mcmc.engine.odometry import OdometryAt
from ogm_mcmc.engine.order_runner import OrderRunner
from ogm_mcmc.engine.orders import Order, Orders
from ogm_mcmc.engine.poses_beside import PosesBeside
from ogm_mcmc.engine.recording import Recording
from ogm_mcmc.engine.refined_map import RefinedMap, WorkerStatus
from ogm_mcmc.engine.state_file import StateFile
from ogm_mcmc.engine.warm_chains import WarmChains
from ogm_mcmc.geometry import PlacedScan

__all__ = ['RefineWorker']

JOIN_S = 60.0

# Building an index, or a step of poses, cannot be interrupted, and half of one is of no use: it is
# not waited for.
LEAVE_S = 1.0


class RefineWorker:
    """Samples the scans of the last order until a limit, a newer order, `stop` or `close`.

    How, and when maps are handed over: `OrderRunner`.
    """

    def __init__(
        self,
        config: SamplerConfig,
        poses: PosesConfig | None = None,
        *,
        odometry: OdometryAt | None = None,
        map_every_s: float = 1.0,
        state_file: Path | None = None,
        niceness: int = 0,
        samples: int = MOST_SAMPLES,
        log: Callable[[str], object] = lambda text: None,
        warn: Callable[[str], object] | None = None,
    ) -> None:
        self.niceness = niceness
        self.failure: BaseException | None = None
        self._log = log
        self._orders = Orders()
        self._state = StateFile(state_file, log, warn or log)
        settings = PosesConfig() if poses is None else poses
        self._beside = PosesBeside(settings.trajectory, odometry, self._orders.tell)
        self._runner = OrderRunner(
            self._orders,
            WarmChains(config, samples, self._state, log),
            KeptPoses(settings, log),
            self._beside,
            map_every_s=map_every_s,
            log=log,
            warn=warn or log,
        )
        self._thread = threading.Thread(target=self._run, name='refine', daemon=True)
        self._thread.start()

    # -- the node's side --------------------------------------------------------------------

    @property
    def status(self) -> WorkerStatus:
        """How it goes; nothing of what is yet to be forgotten."""
        return WorkerStatus() if self._orders.forget else self._runner.status

    @property
    def result(self) -> RefinedMap | None:
        """The map handed over last."""
        return self._runner.result

    def show_every(self, seconds: float) -> None:
        """Hand over a map no sooner than so long after the one before."""
        self._runner.map_every_s = seconds

    def refine(
        self,
        scans: Sequence[PlacedScan],
        stop: StopConfig,
        kept: Recording | None = None,
        *,
        settled: bool = True,
        drifting: bool = False,
    ) -> bool:
        """Sample these scans; return whether something else is stopped for it.

        Of their recording, `kept`, a copy lets scans go where an index of all has no room.
        Where poses are not `settled` none are estimated; `drifting` ones are those of odometry.
        """
        copy = None if kept is None else kept.copy()
        order = Order(scans, stop, copy, settled=settled, drifting=drifting)
        return self._orders.leave(order, 'refined again')

    def stop(self) -> bool:
        """End sampling, with a last map; return whether there was any."""
        return self._orders.leave(None, 'stopped')

    @property
    def unsaved(self) -> str:
        """Why the state file could not be written, the last time; empty if it could."""
        return self._state.unsaved

    @property
    def wanted(self) -> bool:
        """Whether somebody waits for a result: there is an order, and nobody ended it."""
        return self._orders.wanted

    def clear(self) -> None:
        """End sampling and forget scans, chains and map."""
        with self._orders.changed:
            self._orders.leave(None, 'cleared')
            self._orders.forget, self._runner.result = True, None

    def save_state(self) -> None:
        """Have the state file written at the next break."""
        self._orders.save = self._state.path is not None
        self._orders.tell()

    def close(self) -> None:
        """End sampling, with a last map and the state file, and end the thread.

        One that builds an index is left behind: it ends with the process.
        """
        with self._orders.changed:
            again, self._orders.closing = self._orders.closing, True
            self._orders.leave(None, 'shut down')
        began, patience_s = time.monotonic(), 0.0 if again else LEAVE_S
        while self.running and time.monotonic() - began < JOIN_S:
            self._thread.join(0.05)
            if self._runner.status.state == 'indexing' and time.monotonic() - began > patience_s:
                if not again:
                    self._log('stopped while the index was being built')
                return

    @property
    def running(self) -> bool:
        """Whether the thread is there."""
        return self._thread.is_alive()

    # -- the thread's side ------------------------------------------------------------------

    def _run(self) -> None:
        with contextlib.suppress(OSError, AttributeError):
            # On Linux it concerns this thread and those it starts, the chains'.
            os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), self.niceness)
        try:
            while self._take_order():
                self._carry_out()
                self._beside.end()
        except BaseException as error:  # the node raises it where it is seen
            self.failure = error
        self._beside.close(LEAVE_S)

    def _take_order(self) -> bool:
        """Wait for something to do; False: the end."""
        with self._orders.changed:
            self._orders.wait()
            if self._orders.forget:
                self._runner.forget()
                self._orders.forget = False
            return self._orders.take()

    def _carry_out(self) -> None:
        if self._orders.save:
            self._runner.write_state()
        if self._orders.at_work is not None:
            self._runner.run(self._orders.at_work)

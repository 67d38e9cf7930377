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
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from ogm_mcmc.config import PosesConfig, SamplerConfig, StopConfig
from ogm_mcmc.engine.handing_over import map_now
from ogm_mcmc.engine.kept_poses import KeptPoses
from ogm_mcmc.engine.kept_samples import MOST_SAMPLES, KeptSamples
from ogm_mcmc.engine.odometry import OdometryAt, said_odometry
from ogm_mcmc.engine.progress import Progress
from ogm_mcmc.engine.recording import Recording
from ogm_mcmc.engine.refined_map import RefinedMap, WorkerStatus
from ogm_mcmc.engine.refinement import Refinement
from ogm_mcmc.engine.state_file import StateFile
from ogm_mcmc.errors import OgmError, WindowFullError
from ogm_mcmc.geometry import PlacedScan

__all__ = ['RefineWorker']

JOIN_S = 60.0

# There is always time for a round of sampling.
LEAST_S = 0.01

# A run that is replaced after fewer counted sweeps leaves the map of before.
ENOUGH = 16
# Once scans were placed anew the map of before is worse than that of so many sweeps.
SOON = 5

# Building an index cannot be interrupted, and half of one is of no use: it is not waited for.
LEAVE_INDEXING_S = 1.0


class _Order(NamedTuple):
    """Scans to sample, and when to stop; what chooses among them where there is no room."""

    scans: Sequence[PlacedScan]
    stop: StopConfig
    kept: Recording | None = None


class RefineWorker:
    """Samples the scans of the last order until a limit, a newer order, `stop` or `close`.

    With joint poses these are refined first, for half of the time at most.
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
        self.config = config
        self.map_every_s = map_every_s
        self.niceness = niceness
        self.log = log
        self.warn = warn or log
        self.status = WorkerStatus()
        self.result: RefinedMap | None = None
        self.failure: BaseException | None = None
        self._refinement = Refinement(config)
        self._state = StateFile(state_file, self.log, self.warn)
        self._kept = KeptSamples(samples)
        self._poses = KeptPoses(PosesConfig() if poses is None else poses, odometry)
        self._handed_over = 0
        self._said_no_return: tuple[str, str] | None = None  # what was asked, what it came to
        self._said_joint: bool | None = None
        self._earlier_sweeps = 0  # of these chains with scans of before
        self._changed = threading.Condition()  # of a re-entrant lock
        # Guarded by the condition:
        self._order: _Order | None = None
        self._at_work: _Order | None = None
        self._cancel = ''  # why the order at work shall end
        self._save = False
        self._forget = False
        self._closing = False
        self._thread = threading.Thread(target=self._run, name='refine', daemon=True)
        self._thread.start()

    # -- the node's side --------------------------------------------------------------------

    def refine(
        self, scans: Sequence[PlacedScan], stop: StopConfig, kept: Recording | None = None
    ) -> bool:
        """Sample these scans; return whether something else is stopped for it.

        Of their recording, `kept`, a copy lets scans go where an index of all has no room.
        """
        copy = None if kept is None else kept.copy()
        return self._leave(_Order(scans, stop, copy), 'refined again')

    def stop(self) -> bool:
        """End sampling, with a last map; return whether there was any."""
        return self._leave(None, 'stopped')

    @property
    def unsaved(self) -> str:
        """Why the state file could not be written, the last time; empty if it could."""
        return self._state.unsaved

    @property
    def wanted(self) -> bool:
        """Whether somebody waits for a result: there is an order, and nobody ended it."""
        with self._changed:
            return self._order is not None or (self._at_work is not None and not self._cancel)

    def clear(self) -> None:
        """End sampling and forget scans, chains and map."""
        with self._changed:
            self._leave(None, 'cleared')
            self._forget, self.result = True, None

    def _leave(self, order: _Order | None, reason: str) -> bool:
        with self._changed:
            busy = self._at_work is not None
            some = busy or self._order is not None
            self._order = order
            if busy:
                self._cancel = reason
            self._changed.notify()
            return some

    def save_state(self) -> None:
        """Have the state file written at the next break."""
        with self._changed:
            self._save = self._state.path is not None
            self._changed.notify()

    def close(self) -> None:
        """End sampling, with a last map and the state file, and end the thread.

        One that builds an index is left behind: it ends with the process.
        """
        with self._changed:
            self._closing = True
            self._leave(None, 'shut down')
        began = time.monotonic()
        while self.running and time.monotonic() - began < JOIN_S:
            self._thread.join(0.05)
            if self.status.state == 'indexing' and time.monotonic() - began > LEAVE_INDEXING_S:
                self.log('stopped while the index was being built')
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
        except BaseException as error:  # the node raises it where it is seen
            self.failure = error

    def _take_order(self) -> bool:
        """Wait for something to do; False: the end."""
        with self._changed:
            self._at_work, self._cancel = None, ''
            self._changed.wait_for(
                lambda: self._order or self._save or self._forget or self._closing
            )
            if self._forget:
                self._forget = False
                self._refinement, self.status = Refinement(self.config), WorkerStatus()
                self._earlier_sweeps = 0
                self._poses.forget()
                self._kept.clear()
            self._at_work, self._order = self._order, None
            return self._at_work is not None or self._save or not self._closing

    def _carry_out(self) -> None:
        if self._save:
            self._write_state()
        order = self._at_work
        if order is None:
            return
        try:
            self._sample(order)
        except OgmError as error:
            self._failed(str(error))
        except MemoryError:
            # The index may be half grown.
            self._refinement, self._earlier_sweeps = Refinement(self.config), 0
            self._kept.clear()
            self.status = self.status._replace(chain_sweeps=0)
            self._failed(f'no memory to sample {len(order.scans)} scans: expected more')

    def _failed(self, text: str) -> None:
        self.warn(f'not refined: {text}')
        # The next window may be chosen by what was found of beams.
        found = self._refinement.no_return_found, self._refinement.model_found
        self.status = self.status._replace(no_return=found[0], model=found[1])
        self.status = self.status._replace(state='idle', stopped='error', error=text)

    def _sample(self, order: _Order) -> None:
        scans, stop = order.scans, order.stop
        self.status = WorkerStatus('indexing', scans=len(scans), chain_sweeps=self._sweeps())
        if self._are_joint(scans):
            began = time.monotonic()
            scans = self._refine_poses(order)
            if self._cancel not in ('', 'stopped'):
                self.status = self.status._replace(state='idle', stopped=self._cancel)
                return
            left = stop.max_time - (time.monotonic() - began)
            stop = replace(stop, max_time=max(left, LEAST_S))
        self.status = self.status._replace(state='indexing')
        refinement = self._refinement
        order = order._replace(scans=self._take_kept(scans, order.kept))
        left_out = len(scans) - len(order.scans)
        assert refinement.sampler is not None
        self.status = self.status._replace(
            state='sampling',
            scans=len(order.scans),
            left_out=left_out,
            rays=refinement.size.n_rays,
            merged=refinement.size.n_merged,
            sensor=refinement.sensor,
            no_return=refinement.no_return,
            # Who keeps scans lets the same go.
            model=order.kept.model if left_out and order.kept else refinement.model_found,
            n_bytes=refinement.size.n_bytes + refinement.sampler.n_bytes,
            chain_sweeps=self._sweeps(),
        )
        next_map_at = time.monotonic()
        for progress in refinement.run(stop, lambda: bool(self._cancel)):
            self.status = self.status._replace(progress=progress, chain_sweeps=self._sweeps())
            if progress.counted > 0:
                self._kept.add(refinement.sampler)
            if progress.reason:
                break
            if self._save:
                self._write_state()
            if time.monotonic() >= next_map_at:
                self._hand_over(order, progress, final=False)
                next_map_at = time.monotonic() + self.map_every_s
        self._end(order, progress)

    def _sweeps(self) -> int:
        sampler = self._refinement.sampler
        return self._earlier_sweeps + (0 if sampler is None else sampler.sweeps)

    def _are_joint(self, scans: Sequence[PlacedScan]) -> bool:
        """Return whether poses are estimated; where not, none are left from before."""
        choice = self._poses.choose(scans, self.config.window.resolution)
        if choice.why and choice.joint != self._said_joint:
            self.log(choice.why)
            self._said_joint = choice.joint
        return choice.joint

    def _refine_poses(self, order: _Order) -> Sequence[PlacedScan]:
        """Return the scans where they are after half of the time, or when all is done."""
        self.status = self.status._replace(state='refining poses')
        poses = self._poses
        refinement, moved = poses.take(order.scans), False
        for progress in refinement.run(0.5 * order.stop.max_time, lambda: bool(self._cancel)):
            self.status = self.status._replace(poses=progress)
            moved = True
        if moved:
            poses.keep()
            if refinement.finished and poses.config.trajectory.odometry:
                steps, scale = refinement.wheels, refinement.odometry_scale
                self.log(said_odometry('the robot', steps, len(order.scans), scale))
            if refinement.finished and (said := refinement.said_beam_times()):
                self.log(said)
        return poses.placed

    def _take_kept(
        self, scans: Sequence[PlacedScan], kept: Recording | None
    ) -> Sequence[PlacedScan]:
        """Take scans, or those of them that an index has room for; return these.

        They are kept by what beams were found to be like before: these may err more.
        """
        if kept is None:
            self._take(scans)
            return scans
        found, asked = self._refinement, len(scans)
        while True:
            try:
                self._take(scans, whole=True)
                break
            except WindowFullError:
                fewer = kept.fewer(scans, found.no_return_found, found.model_found)
                if len(fewer) == len(scans):
                    raise
                scans = fewer
        if len(scans) < asked:
            self.warn(f'{len(scans)} of {asked} scans sampled: window.max_memory_mb is too small')
        return scans

    def _take(self, scans: Sequence[PlacedScan], *, whole: bool = False) -> None:
        refinement = self._refinement
        if refinement.holds(scans):
            return  # the chains go on and what they counted stays
        fresh = refinement.sampler is None
        # No name is given to the sampler: its index may have to go before there is another one.
        earlier_sweeps = 0 if refinement.sampler is None else refinement.sampler.sweeps
        refinement.take(scans, whole=whole)
        # The share of beams in the text is another one with every scan.
        choice = refinement.no_return
        decided = choice.asked, choice.value
        if str(choice) and decided != self._said_no_return:
            self.log(str(choice))
            self._said_no_return = decided
        self._kept.clear()
        self._earlier_sweeps += earlier_sweeps
        if fresh:
            self._state.resume(refinement, scans, whole=whole)

    def _end(self, order: _Order, progress: Progress) -> None:
        reason = (self._cancel or 'stopped') if progress.reason == 'cancelled' else progress.reason
        replaced = reason == 'refined again'
        if not replaced or progress.counted >= ENOUGH or self.result is None:
            self._hand_over(order, progress, final=not replaced)
        if reason not in ('cleared', 'refined again'):
            self._write_state()
        if reason not in ('refined again', 'cleared', 'shut down'):
            self.log(f'{progress.said(len(order.scans))} ({reason})')
        self.status = self.status._replace(state='idle', stopped=reason)

    def _hand_over(self, order: _Order, progress: Progress, *, final: bool) -> None:
        wrong = self._refinement.corrected and progress.sweeps >= SOON
        if progress.counted == 0 and self.result is not None and not wrong:
            return  # a map from before is better than the first sweeps of new chains
        result = map_now(
            self._refinement,
            self._kept,
            order.scans,
            self._poses.trajectory,
            number=self._handed_over + 1,
            final=final,
        )
        with self._changed:
            if self._forget:
                return
            self._handed_over, self.result = result.number, result

    def _write_state(self) -> None:
        self._save = False
        self._state.write(self._refinement)

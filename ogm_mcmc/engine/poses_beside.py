"""Poses estimated in a thread of their own, while maps are sampled where scans lie by now.

The worker begins it, looks at what was found when it is told to, and may end it: the step in
progress is finished, and the next beginning with the same scans goes on from there. Poses are
handed over as soon as alignment is done; the draws of their standard deviations change none of
them. When time is up before that, they are handed over if they were aligned in squares of 0.4 m:
after coarser ones they may be worse than those given.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Sequence

from numpy.linalg import LinAlgError

from ogm_mcmc.config import TrajectoryConfig
from ogm_mcmc.engine.beam_times import BentScans
from ogm_mcmc.engine.joint_poses import PoseRefinement
from ogm_mcmc.engine.kept_poses import EstimatedPoses
from ogm_mcmc.engine.odometry import OdometryAt, said_odometry
from ogm_mcmc.errors import PoseError
from ogm_mcmc.geometry import PlacedScan
from ogm_mcmc.trajectory import TrajectoryProgress

__all__ = ['PosesBeside']


class _Task:
    """Scans whose poses are estimated, and how far that is."""

    def __init__(
        self, scans: Sequence[PlacedScan], before: _Task | None, drifting: bool = False
    ) -> None:
        self.drifting = drifting
        self.scans, self.until = scans, math.inf  # on the monotonic clock; 0: to be ended
        self.before = before  # which may still be at work
        self.refinement: PoseRefinement | None = None
        self.progress: TrajectoryProgress | None = None
        self.latest: EstimatedPoses | None = None
        self.taken: EstimatedPoses | None = None
        self.error: BaseException | None = None
        self.ended = False
        self.thread: threading.Thread | None = None  # once it began

    def is_of(self, scans: Sequence[PlacedScan], drifting: bool) -> bool:
        if drifting != self.drifting:
            return False
        pairs = zip(scans, self.scans, strict=False)
        return len(scans) == len(self.scans) and all(a is b for a, b in pairs)

    @property
    def done(self) -> bool:
        """Whether everything is done, and was taken."""
        finished = self.refinement is not None and self.refinement.finished
        return self.ended and finished and self.latest is self.taken


class PosesBeside:
    """Estimates poses of scans in a thread; of one set of scans at a time.

    `tell()` is called, in that thread, whenever there is something new to be seen. All else is
    for one other thread.
    """

    def __init__(
        self, config: TrajectoryConfig, odometry: OdometryAt | None, tell: Callable[[], None]
    ) -> None:
        self.config, self.odometry = config, odometry
        self._tell = tell
        self._bent = BentScans()
        self._task: _Task | None = None

    def want(self, scans: Sequence[PlacedScan], drifting: bool = False) -> None:
        """Have poses of scans estimated once it begins, from where these were left.

        Those that are `drifting` are of odometry.

        Where all was done with the same scans, and taken, there is nothing to do.
        """
        self.end()
        before = self._task
        if before is not None and before.thread is None:  # it never began
            before = before.before
        if before is not None and before.is_of(scans, drifting) and before.done:
            self._task = before
            return
        self._task = _Task(scans, before, drifting)
        if before is not None and before.is_of(scans, drifting):
            self._task.taken = before.taken

    def begin(self, max_time_s: float) -> None:
        """Estimate what is wanted, for so long at most."""
        task = self._task
        if task is None or task.until != math.inf:
            return
        task.until = time.monotonic() + max_time_s
        task.thread = threading.Thread(target=self._work, args=(task,), name='poses', daemon=True)
        task.thread.start()

    def end(self) -> None:
        """Have it end after the step in progress; what it found stays to go on from."""
        if self._task is not None:
            self._task.until = 0.0

    def forget(self) -> None:
        """Have it end, and leave nothing to go on from."""
        self.end()
        self._task, self._bent = None, BentScans()

    def close(self, timeout_s: float) -> None:
        """Have it end, and wait for that so long at most: a step may take seconds."""
        self.end()
        if self._task is not None and self._task.thread is not None:
            self._task.thread.join(timeout_s)

    @property
    def progress(self) -> TrajectoryProgress | None:
        """How far it is; None before the first step."""
        return None if self._task is None else self._task.progress

    @property
    def found(self) -> bool:
        """Whether there is something new to take."""
        task = self._task
        if task is None or task.until == 0.0:
            return False
        new = task.latest is not None and task.latest is not task.taken
        return new or task.error is not None

    @property
    def awaited(self) -> bool:
        """Whether something is found, or may yet be."""
        task = self._task
        return task is not None and task.until > 0.0 and (not task.ended or self.found)

    @property
    def moves(self) -> bool:
        """Whether poses may yet be others than those taken last."""
        task = self._task
        taken = None if task is None else task.taken
        return self.awaited and (taken is None or not taken.aligned)

    def take(self) -> EstimatedPoses | None:
        """Return what is new; raises what ended the thread, and nothing is left then."""
        task = self._task
        if task is None:
            return None
        if task.error is not None:
            self._task = None
            raise task.error
        task.taken = task.latest
        return task.taken

    # -- in the thread ----------------------------------------------------------------------

    def _work(self, task: _Task) -> None:
        before, task.before = task.before, None
        if before is not None and before.thread is not None:
            before.thread.join()
        try:
            same = before is not None and before.is_of(task.scans, task.drifting)
            if before is not None and same and before.error is None:
                task.refinement = before.refinement
            del before
            self._estimate(task)
        except MemoryError:
            task.error = PoseError('no memory')
        except LinAlgError as error:
            task.error = PoseError(str(error))
        except BaseException as error:  # the worker raises it
            task.error = error
        task.ended = True
        self._tell()

    def _estimate(self, task: _Task) -> None:
        if task.refinement is None:
            if task.until == 0.0:  # ended while it waited for another one
                return
            found = PoseRefinement(
                task.scans, self.config, self.odometry, self._bent, drifting=task.drifting
            )
            task.refinement = found
        refinement, told = task.refinement, False
        left_s = task.until - time.monotonic()
        if left_s > 0.0 and not refinement.finished:
            for progress in refinement.run(left_s, lambda: task.until == 0.0):
                task.progress = progress
                if refinement.aligned and not told:
                    self._hand_over(task, refinement)
                    told = True
        # With covariances now, or as they are when time is up.
        if refinement.usable:
            self._hand_over(task, refinement)

    def _hand_over(self, task: _Task, refinement: PoseRefinement) -> None:
        if torn := refinement.said_torn():
            raise PoseError(torn)
        said = []
        if refinement.aligned:
            if self.config.odometry:
                steps, scale = refinement.wheels, refinement.odometry_scale
                said.append(said_odometry('the robot', steps, len(task.scans), scale))
            said.append(refinement.said_beam_times())
        lines = tuple(line for line in said if line)
        placed, trajectory = refinement.placed(), refinement.trajectory()
        task.latest = EstimatedPoses(task.scans, placed, trajectory, refinement.aligned, lines)
        self._tell()

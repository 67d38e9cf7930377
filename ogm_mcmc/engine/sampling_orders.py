"""What a worker is ordered to sample: recorded scans, and again where a trajectory moved them."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

from ogm_mcmc.config import StopConfig
from ogm_mcmc.engine.correction_rhythm import CorrectionRhythm
from ogm_mcmc.engine.corrections import Corrected, Corrector, Nodes
from ogm_mcmc.engine.recording import Recording
from ogm_mcmc.engine.worker import RefineWorker
from ogm_mcmc.geometry import PlacedScan

__all__ = ['SamplingOrders']


class SamplingOrders:
    """Orders scans of a recording, which `scans` returns as they are to be sampled.

    `limits` are those asked for last; their time holds, however often scans are corrected.
    `drifts` says whether scans were recorded at poses of odometry; corrected ones are not.
    """

    def __init__(
        self,
        worker: RefineWorker,
        recording: Recording,
        scans: Callable[[], list[PlacedScan]],
        limits: StopConfig,
        drifts: Callable[[], bool] = lambda: False,
    ) -> None:
        self.worker, self.recording, self.scans, self.limits = worker, recording, scans, limits
        self.drifts = drifts
        self.corrector = Corrector()
        self._corrected = False
        self._rhythm = CorrectionRhythm()
        self._until_s = 0.0  # on the monotonic clock: corrections start nothing after that

    def sample(self, limits: StopConfig) -> bool:
        """Have what is recorded sampled; return whether something else is stopped for it."""
        now = time.monotonic()
        self.limits, self._until_s = limits, now + limits.max_time
        return self._order(limits, now)

    def correct(self, nodes: Nodes, resolution_m: float) -> Corrected:
        """Place the recorded scans anew; sampling in progress goes on with them, warm."""
        corrected = self.corrector.applied(self.recording.snapshot(), nodes, resolution_m)
        if corrected.moved:
            self._corrected = True
            self.recording.replace(corrected.scans)
            self._rhythm.moved(time.monotonic(), sampling=self.worker.wanted)
            self.sample_corrected()
        return corrected

    def sample_corrected(self) -> None:
        """Go on with corrected scans, not more often than leaves time to sample."""
        now = time.monotonic()
        left_s = self._until_s - now
        if self._rhythm.due(now) and self.worker.wanted and left_s > 0.0:
            self._rhythm.goes_on(now)
            self._order(replace(self.limits, max_time=left_s), now)

    def stop(self) -> bool:
        """Have sampling end; return whether there was any."""
        self._rhythm.end()
        return self.worker.stop()

    def clear(self) -> None:
        """Have chains and their map forgotten, and what was corrected."""
        self.worker.clear()
        self._corrected = False
        self._rhythm.clear()
        self.corrector.clear()

    def _order(self, limits: StopConfig, now_s: float) -> bool:
        settled = self._rhythm.ordered(now_s)
        drifting = self.drifts() and not self._corrected
        return self.worker.refine(
            self.scans(), limits, self.recording, settled=settled, drifting=drifting
        )

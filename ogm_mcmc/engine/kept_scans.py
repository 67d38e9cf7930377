"""The scans a live map was made of, and the thread that makes it anew at corrected poses."""

from __future__ import annotations

import threading
import time
from typing import NamedTuple

from ogm_mcmc.config import MapperConfig, RecordingConfig
from ogm_mcmc.engine.corrections import Corrected, Corrector, Nodes
from ogm_mcmc.engine.recording import Recording
from ogm_mcmc.errors import GridError
from ogm_mcmc.geometry import PlacedScan
from ogm_mcmc.pipeline import MappingPipeline

__all__ = ['KeptScans', 'Remade']

BYTES_A_BEAM = 4
MOST_SCANS = 10_000_000


class Remade(NamedTuple):
    """A map made anew, of how many scans, and how long that took."""

    pipeline: MappingPipeline
    scans: int
    seconds: float


class KeptScans:
    """Keeps what was mapped; `correct` makes the map anew in a thread, `taken` hands it over.

    The thread works on scans of its own; those that are mapped meanwhile are added when the map
    is taken. A trajectory that comes meanwhile waits: a system that tells one every second would
    else keep a large map from ever being ready. When the memory is used up scans
    that others cover go first (see `Recording`): they stay in the map until it is made anew.
    """

    def __init__(self, megabytes: float) -> None:
        beams = max(1, int(megabytes * 1e6 / BYTES_A_BEAM))
        self.recording = Recording(RecordingConfig(max_scans=MOST_SCANS, max_rays=beams))
        self.corrector = Corrector()
        self._late: list[PlacedScan] = []
        self._making: _Making | None = None
        self._waits = False  # a correction that no map in the making has

    def add(self, placed: PlacedScan) -> None:
        """Keep a scan that was mapped."""
        self.corrector.note(placed)
        self.recording.add(placed)
        if self._making is not None:
            self._late.append(placed)

    def correct(self, nodes: Nodes, config: MapperConfig) -> Corrected:
        """Place scans anew; where any moved the map is made anew with these settings."""
        kept = self.recording.snapshot()
        corrected = self.corrector.applied(kept, nodes, config.resolution)
        if corrected.moved:
            self.recording.replace(corrected.scans)
            self._waits = True
            self._make(config)
        return corrected

    def _make(self, config: MapperConfig) -> None:
        """Begin to make the map anew, if a correction waits for that and none is in the making."""
        if self._waits and self._making is None:
            self._making, self._late = _Making(self.recording.snapshot(), config), []
            self._waits = False

    @property
    def busy(self) -> bool:
        """Whether a map is being made."""
        return self._making is not None

    def taken(self) -> Remade | None:
        """Return a map that is ready, with the scans that came meanwhile; None: not yet.

        Raises what went wrong in the thread.
        """
        making = self._making
        if making is None or making.thread.is_alive():
            return None
        self._making = None
        if making.failure is not None:
            raise making.failure
        for placed in self._late:
            making.use(placed)
        scans, self._late = making.pipeline.scans_used, []
        self._make(making.pipeline.config)
        return Remade(making.pipeline, scans, time.monotonic() - making.started)

    def clear(self) -> None:
        """Forget all scans and poses; a map that is being made is not taken."""
        if self._making is not None:
            self._making.cancelled = True
            self._making = None
        self.recording.clear()
        self.corrector.clear()
        self._late, self._waits = [], False


class _Making:
    """A map in the making, in a thread of its own."""

    def __init__(self, scans: list[PlacedScan], config: MapperConfig) -> None:
        self.pipeline = MappingPipeline(config)
        self.cancelled = False
        self.failure: BaseException | None = None
        self.started = time.monotonic()
        self._scans = scans
        self.thread = threading.Thread(target=self._run, name='remap', daemon=True)
        self.thread.start()

    def _run(self) -> None:
        try:
            self.pipeline.update_all(self._scans, lambda: self.cancelled)
        except BaseException as error:  # the node raises it where it is seen
            self.failure = error

    def use(self, placed: PlacedScan) -> None:
        """Map a scan; one that leads too far away is left out, as it would be when it comes."""
        try:
            self.pipeline.update(placed)
        except GridError:
            return

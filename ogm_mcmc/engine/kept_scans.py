"""The scans a live map was made of, and the thread that makes it anew at corrected poses."""

from __future__ import annotations

import contextlib
import threading
import time
from collections import deque
from typing import NamedTuple

from ogm_mcmc.config import MapperConfig, RecordingConfig
from ogm_mcmc.engine.corrections import Corrected, Corrector, Nodes
from ogm_mcmc.engine.recording import Recording
from ogm_mcmc.engine.robot_track import POSE_BYTES
from ogm_mcmc.errors import GridError
from ogm_mcmc.geometry import PlacedScan
from ogm_mcmc.pipeline import MappingPipeline

__all__ = ['KeptScans', 'Remade']

# As many as settings may say: the limit of kept scans is their memory.
MOST_SCANS, MOST_BEAMS = 10_000_000, 1_000_000_000

FEW = 10
"""The thread stops when no more scans than this are left; `taken` maps those, and any that came
since."""

TRACK_SHARE = 0.25
"""Of the memory so much at most is for what was said of the robot's pose."""


class Remade(NamedTuple):
    """What a correction did, of how many scans there are, and how long it took.

    `pipeline`: the map made anew, None where no scan moved. `corrected` is what the last of the
    trajectories did that were applied; its scans are left out.
    """

    pipeline: MappingPipeline | None
    corrected: Corrected
    scans: int
    seconds: float


class KeptScans:
    """Keeps what was mapped; `correct` places scans and makes the map anew, `taken` hands it over.

    All of that is done in a thread, with a list of scans of its own; what is mapped meanwhile is
    added when the map is taken. A trajectory that comes meanwhile waits: a system that tells one
    every second would else keep a large map from ever being ready. When the memory is used up
    scans that others cover go first (see `Recording`): they stay in the map until it is made anew.

    A map is made with the settings that held when it was begun. Where others hold when it is
    taken, it is made once more.
    """

    def __init__(self, megabytes: float) -> None:
        limits = RecordingConfig(max_scans=MOST_SCANS, max_rays=MOST_BEAMS)
        self.most_bytes = 1e6 * megabytes
        self.recording = Recording(limits, most_bytes=self.most_bytes)
        self.corrector = Corrector(int(TRACK_SHARE * self.most_bytes) // POSE_BYTES)
        self._making: _Making | None = None
        self._waiting: list[Nodes] = []  # trajectories that no map in the making knows

    def add(self, placed: PlacedScan) -> None:
        """Keep a scan that was mapped."""
        self.corrector.note(placed)
        self.recording.most_bytes = self.most_bytes - self.corrector.track.n_bytes
        self.recording.add(placed)
        if self._making is not None:
            self._making.late.append(placed)

    def correct(self, nodes: Nodes, config: MapperConfig) -> None:
        """Have scans placed anew and, where any moves, the map made anew with these settings."""
        self._waiting = [one for one in self._waiting if not _covers(nodes, one)] + [nodes]
        self._make(config)

    def _make(self, config: MapperConfig, outdated: Corrected | None = None) -> None:
        """Begin with the trajectories that wait, if there are any and no map is in the making.

        Also without any where the last map, made by `outdated`, is of other settings.
        """
        if (self._waiting or outdated) and self._making is None:
            here = self.recording.copy(), self.corrector.copy()
            self._making = _Making(*here, self._waiting, config, outdated)
            self._waiting = []

    @property
    def n_bytes(self) -> int:
        """Memory of the scans and of what was said of the robot's pose, about."""
        return self.recording.n_bytes + self.corrector.track.n_bytes

    @property
    def busy(self) -> bool:
        """Whether scans are being placed, or a map is being made."""
        return self._making is not None

    def taken(self, config: MapperConfig) -> Remade | None:
        """Return what is ready, with the scans that came meanwhile; None: not yet.

        `config`: the settings that hold now. Raises what went wrong in the thread; what waits is
        begun nevertheless.
        """
        making = self._making
        if making is None or making.thread.is_alive():
            return None
        self._making = None
        if making.failure is not None:
            self._make(config)
            raise making.failure
        corrected = making.corrected._replace(scans=[])
        pipeline = outdated = None
        if making.moved:
            pipeline, self.recording = making.pipeline, making.recording
            if pipeline.config != config:
                pipeline.configure(config)
                outdated = corrected
            making.catch_up(0)
        seconds = time.monotonic() - making.started
        self._make(config, outdated)
        return Remade(pipeline, corrected, making.pipeline.scans_used, seconds)

    def clear(self) -> None:
        """Forget all scans and poses; a map that is being made is not taken."""
        if self._making is not None:
            self._making.cancelled = True
            self._making = None
        self.recording.clear()
        self.corrector.clear()
        self._waiting = []


def _covers(one: Nodes, other: Nodes) -> bool:
    """Whether a trajectory says something of all scans that another one speaks of."""
    if other.stamps_ns.size == 0 or one.stamps_ns.size == 0:
        return other.stamps_ns.size == 0
    inside = one.stamps_ns[0] <= other.stamps_ns[0], other.stamps_ns[-1] <= one.stamps_ns[-1]
    return bool(all(inside))


class _Making:
    """Scans being placed and a map in the making, in a thread of its own.

    With `outdated`, what the trajectory of a map with other settings did, one is made anyway.
    """

    def __init__(
        self,
        recording: Recording,
        corrector: Corrector,
        trajectories: list[Nodes],
        config: MapperConfig,
        outdated: Corrected | None = None,
    ) -> None:
        self.pipeline = MappingPipeline(config)
        self.recording = recording
        self.corrected = outdated or Corrected([], 0, 0, 0.0)  # by the last trajectory
        self.moved = outdated is not None
        self.late: deque[PlacedScan] = deque()
        self.cancelled = False
        self.failure: BaseException | None = None
        self.started = time.monotonic()
        self._corrector, self._trajectories = corrector, trajectories
        self.thread = threading.Thread(target=self._run, name='remap', daemon=True)
        self.thread.start()

    def _run(self) -> None:
        try:
            scans = self.recording.snapshot()
            for nodes in self._trajectories:
                resolution_m = self.pipeline.config.resolution
                self.corrected = self._corrector.applied(scans, nodes, resolution_m)
                scans = self.corrected.scans
                self.moved |= self.corrected.moved > 0
            if self.moved:
                self.recording.replace(scans)
                self.pipeline.update_all(scans, lambda: self.cancelled)
                self.catch_up(FEW)
        except BaseException as error:  # the node raises it where it is seen
            self.failure = error

    def catch_up(self, left: int) -> None:
        """Map scans that came meanwhile, but for so many.

        One that leads too far away is left out, as it would be when it comes.
        """
        while len(self.late) > left and not self.cancelled:
            placed = self.late.popleft()
            self.recording.add(placed)
            with contextlib.suppress(GridError):
                self.pipeline.update(placed)

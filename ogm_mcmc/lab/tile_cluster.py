"""Tiles of a map on the workers of a Dask cluster; see `ogm_mcmc.sampling.tiles`.

Design note: what a worker keeps
--------------------------------
A task is a function of its arguments alone, as in `cluster`: a job names the cells of a tile and
what lies outside of it. A worker keeps what follows from the scans, the rays of its tiles, and
makes it again where it is missing. So jobs of a tile are bound to one worker: were they stolen by
an idle one, this would make the tile, too, and every worker would hold everything in the end.
When a worker is gone, its tiles are bound to others. Jobs that it had not answered are done again,
and give what they would have given.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from concurrent.futures import CancelledError, Executor, Future
from typing import Any, NamedTuple

from ogm_mcmc.config import SamplerConfig
from ogm_mcmc.engine.tiled_refinement import Held, tile_sampler
from ogm_mcmc.errors import ClusterError
from ogm_mcmc.geometry import PlacedScan
from ogm_mcmc.lab.cluster import digest, pack_problem
from ogm_mcmc.lab.memory import peak_mb
from ogm_mcmc.lab.parcels import unpack
from ogm_mcmc.lab.workers import RETRIES, Workers
from ogm_mcmc.sampling.tile_gibbs import Drawn, TileJob, TileReport, TileSampler
from ogm_mcmc.sampling.tiles import Tiling

__all__ = ['ClusterTiles', 'Traffic']

# How long a job is waited for before it is asked whether its worker is still there.
LOOK_S = 2.0


class Traffic(NamedTuple):
    """Jobs, and bytes of what they were told and of what they answered."""

    jobs: int = 0
    told: int = 0
    answered: int = 0


class ClusterTiles:
    """Tiles bound to workers, in turn; both the holders and what is held."""

    def __init__(self, workers: Workers) -> None:
        self._workers = workers
        self._lock = threading.Lock()
        self._parcel, self._shared = b'', None
        self._token = ''
        self._tiling: Tiling | None = None
        self._holder: list[str] = []
        self._pools: dict[str, Executor] = {}
        self.traffic = Traffic()

    def hold(self, config: SamplerConfig, scans: Sequence[PlacedScan], tiling: Tiling) -> Held:
        """Let every tile be made by the worker that is to hold it."""
        self._parcel, self._tiling = pack_problem(config, scans), tiling
        self._token = digest(self._parcel)
        self._share()
        there = self._present()
        self._holder = [there[tile % len(there)] for tile in range(len(tiling.tiles))]
        waiting = [_Waiting(self, report_tile, tile) for tile in range(len(tiling.tiles))]
        return Held(self, [each.result() for each in waiting])

    def draw(self, tile: int, job: TileJob) -> _Waiting:
        """Let the worker that holds a tile do a job."""
        arrays = job.cells, job.behind, job.mask, job.corners
        told = sum(0 if array is None else array.nbytes for array in arrays)
        with self._lock:
            jobs, before, answered = self.traffic
            self.traffic = Traffic(jobs + 1, before + told, answered)
        return _Waiting(self, draw_tile, tile, job, received=self._drawn)

    def figures(self) -> dict[str, Any]:
        """Return what was sent, and by worker which tiles it holds and its memory at the most.

        Workers that are gone by now are left out.
        """
        held = self._workers.asked(peak_mb)
        return {
            'parcel_bytes': len(self._parcel),
            **self.traffic._asdict(),
            'workers': {
                worker: {
                    'tiles': [i + 1 for i, at in enumerate(self._holder) if at == worker],
                    'peak_mb': peak,
                }
                for worker, peak in sorted(held.items())
            },
        }

    # -- what waiting jobs ask for ------------------------------------------------------------

    def submit(self, task: Any, tile: int, *more: Any) -> tuple[Future[Any], str]:
        """Send a task about a tile to its worker; return what comes of it, and the worker."""
        with self._lock:
            holder, shared = self._holder[tile], self._shared
            pool = self._pools.get(holder)
            if pool is None:
                pool = self._pools[holder] = self._workers.at(holder)
        return pool.submit(task, self._token, shared, self._tiling, tile, *more), holder

    def gone(self, worker: str, tile: int) -> bool:
        """Whether a worker is gone; then its tile is bound to another one."""
        with self._lock:
            there = self._present()
            if self._holder[tile] not in there:
                self._holder[tile] = min(there, key=self._holder.count)
            return worker not in there

    def lost(self) -> None:
        """Send the scans again: no worker has them any more."""
        with self._lock:
            self._share()

    def _drawn(self, found: Drawn) -> None:
        """Count an answer."""
        with self._lock:
            jobs, told, before = self.traffic
            answered = before + found.cells.nbytes + found.hits.nbytes
            self.traffic = Traffic(jobs, told, answered)

    def _share(self) -> None:
        self._shared = self._workers.share(self._parcel)

    def _present(self) -> list[str]:
        there = sorted(self._workers.threads())
        if not there:
            raise ClusterError('no worker is left to hold tiles: expected at least one')
        return there


class _Waiting:
    """A task about a tile that is under way."""

    def __init__(
        self,
        tiles: ClusterTiles,
        task: Any,
        tile: int,
        *more: Any,
        received: Callable[[Any], None] | None = None,
    ) -> None:
        self._tiles, self._what, self._received = tiles, (task, tile, *more), received
        self._future, self._worker = tiles.submit(*self._what)

    def result(self) -> Any:
        """Wait for the answer, by another worker if need be."""
        left = RETRIES
        while True:
            try:
                found = self._future.result(timeout=LOOK_S)
            except TimeoutError:
                if not self._tiles.gone(self._worker, self._what[1]):
                    continue
                self._future.cancel()
            except CancelledError:
                left -= 1
                if left < 0:
                    raise
                if not self._tiles.gone(self._worker, self._what[1]):
                    self._tiles.lost()
            else:
                if self._received is not None:
                    self._received(found)
                return found
            self._future, self._worker = self._tiles.submit(*self._what)


# -- on workers -----------------------------------------------------------------------------------

_lock = threading.Lock()
_held: dict[tuple[str, int], TileSampler] = {}


def _sampler_of(token: str, parcel: bytes, tiling: Tiling, tile: int) -> TileSampler:
    """Return what holds a tile in this process, made when it is first asked for."""
    with _lock:
        key = token, tile
        if key not in _held:
            for other in [other for other in _held if other[0] != token]:
                del _held[other]
            scans, (config, table) = unpack(parcel)
            _held[key] = tile_sampler(config, table, scans, tiling, tile)
        return _held[key]


def report_tile(token: str, parcel: bytes, tiling: Tiling, tile: int) -> TileReport:
    """Hold a tile, and say what it is like."""
    return _sampler_of(token, parcel, tiling, tile).report()


def draw_tile(token: str, parcel: bytes, tiling: Tiling, tile: int, job: TileJob) -> Drawn:
    """Do a job of a tile."""
    return _sampler_of(token, parcel, tiling, tile).draw(job)

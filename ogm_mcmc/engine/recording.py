"""The most recent placed scans, kept for sampling."""

from __future__ import annotations

import hashlib
from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ogm_mcmc.config import RecordingConfig, SamplerConfig
from ogm_mcmc.errors import GridError
from ogm_mcmc.geometry import CellBox, PlacedScan
from ogm_mcmc.sampling import RayWindow, WindowSize

__all__ = ['Recording', 'fingerprint']

NS_PER_S = 1_000_000_000

NOTHING = WindowSize(0, 0, CellBox(0, 0, 0, 0))


class _Kept(NamedTuple):
    placement: PlacedScan
    size: WindowSize

    @property
    def beams(self) -> int:
        return int(self.placement.scan.ranges_m.size)


class Recording:
    """The most recent placed scans, within limits: the oldest go.

    With a `sampler` the memory that its window would need is a limit like the others.
    """

    def __init__(self, config: RecordingConfig, sampler: SamplerConfig | None = None) -> None:
        self.config = config
        self.n_rays = 0  # beams, whether they say anything or not
        self.size = NOTHING  # of the window of these scans
        self.let_go = 0  # scans
        self._window: RayWindow | None = None
        if sampler is not None:
            margin = sampler.patch.window_margin
            self._window = RayWindow(sampler.window, sampler.model, margin=margin)
        self._scans: deque[_Kept] = deque()

    def __len__(self) -> int:
        """Return the number of scans."""
        return len(self._scans)

    def add(self, placement: PlacedScan) -> None:
        """Keep a scan with the belief about its sensor's pose.

        Raises GridError, with nothing changed, when no window can hold it together with the scan
        before it: a pose gone astray does not drive out all the others.
        """
        new = _Kept(placement, self._size_of(placement))
        before = self._scans[-1].size if self._scans else NOTHING
        self._refuse_stray(before.with_more(new.size))
        self._scans.append(new)
        self.n_rays += new.beams
        self.size = self.size.with_more(new.size)
        oldest_ns = placement.scan.stamp_ns - round(self.config.max_seconds * NS_PER_S)
        while len(self._scans) > 1 and self._beyond_limits(oldest_ns):
            self._let_go()

    def _size_of(self, placement: PlacedScan) -> WindowSize:
        if self._window is None:
            return NOTHING
        return self._window.size_of(placement)

    def _refuse_stray(self, size: WindowSize) -> None:
        if self._window is None or size.n_bytes <= self._window.most_bytes:
            return
        raise GridError(
            f'this scan and the one before it need a window of {size.n_bytes / 1e6:.0f} MB: '
            f'expected at most max_memory_mb = {self._window.most_bytes / 1e6:g}'
        )

    def _beyond_limits(self, oldest_ns: int) -> bool:
        config = self.config
        return (
            len(self._scans) > config.max_scans
            or self.n_rays > config.max_rays
            or (config.max_seconds > 0.0 and self._scans[0].placement.scan.stamp_ns < oldest_ns)
            or (self._window is not None and self.size.n_bytes > self._window.most_bytes)
        )

    def _let_go(self) -> None:
        gone = self._scans.popleft()
        self.n_rays -= gone.beams
        self.let_go += 1
        rays, pairs, box = self.size
        if _on_border(gone.size.box, box):
            box = NOTHING.box
            for kept in self._scans:
                box = box.union(kept.size.box)
        self.size = WindowSize(rays - gone.size.rays, pairs - gone.size.pairs, box)

    def snapshot(self) -> list[PlacedScan]:
        """Return the scans as they are now."""
        return [kept.placement for kept in self._scans]

    def clear(self) -> None:
        """Forget all scans."""
        self._scans.clear()
        self.n_rays = self.let_go = 0
        self.size = NOTHING


def _on_border(inner: CellBox, outer: CellBox) -> bool:
    """Whether a box might be smaller without another one in it."""
    return not inner.empty and any(a == b for a, b in zip(inner, outer, strict=True))


def fingerprint(scans: Sequence[PlacedScan]) -> str:
    """Return a digest of everything in the scans and poses that decides the posterior."""
    digest = hashlib.sha256()
    for scan, belief in scans:
        pose = belief.mean
        numbers = (
            scan.angle_min_rad,
            scan.angle_increment_rad,
            scan.range_min_m,
            scan.range_max_m,
            pose.x_m,
            pose.y_m,
            pose.yaw_rad,
        )
        digest.update(np.array(numbers, np.float64).tobytes())
        digest.update(scan.ranges_m.tobytes())
        if scan.bearings_rad is not None:
            digest.update(scan.bearings_rad.tobytes())
    return digest.hexdigest()

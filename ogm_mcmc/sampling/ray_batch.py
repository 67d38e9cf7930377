"""Scans on their way into an index of rays: cast when they are needed, a few of them held."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence

import numpy as np

from ogm_mcmc.arrays import AnyArray
from ogm_mcmc.geometry import PlacedScan
from ogm_mcmc.sampling.beam_rays import BeamRays
from ogm_mcmc.sampling.ray_merging import Joining, Shared

__all__ = ['Batch', 'in_blocks']

# Rays that are filed at a time.
BLOCK = 8_000

# Rays that are cast once and held while they are filed, 72 bytes each; others are cast again.
MOST_HELD = 200_000


class Batch:
    """The beams of scans, `n_beams` of them; those that run along together are joined."""

    def __init__(
        self,
        scans: Sequence[PlacedScan],
        cast: Callable[[PlacedScan], BeamRays],
        joining: Joining | None,
    ) -> None:
        self._scans, self._cast, self._joining = scans, cast, joining
        self._held: list[BeamRays] = []
        self._shared: list[Shared | None] = []
        self.n_beams = 0
        for scan in scans:
            rays = cast(scan)
            self.n_beams += rays.length.size
            if self.n_beams <= MOST_HELD:
                self._held.append(rays)
            self._shared.append(None if joining is None else joining.take(scan, rays))

    def rays(self) -> Iterator[BeamRays]:
        """Yield the new rays of each scan: of its own beams, or lines alone."""
        for i, shared in enumerate(self._shared):
            if shared is None:
                yield self._of(i)
            elif self._joining is not None and shared.began.size:
                yield self._joining.lines_alone(shared, self._of(i))

    def more_said(self) -> Iterator[tuple[BeamRays, AnyArray]]:
        """Yield beams that say more of rays, and the number of the ray of each."""
        for i, shared in enumerate(self._shared):
            if shared is not None and shared.ray.size:
                yield self._of(i), shared.ray

    def _of(self, i: int) -> BeamRays:
        return self._held[i] if i < len(self._held) else self._cast(self._scans[i])


def in_blocks(parts: Iterable[BeamRays]) -> Iterator[BeamRays]:
    """Yield the rays of a few scans at a time."""
    held: list[BeamRays] = []
    size = 0
    for part in parts:
        held.append(part)
        size += part.length.size
        if size >= BLOCK:
            yield BeamRays(*(np.concatenate(arrays) for arrays in zip(*held, strict=True)))
            held, size = [], 0
    if held:
        yield BeamRays(*(np.concatenate(arrays) for arrays in zip(*held, strict=True)))

"""Rays of many scans, cast once where memory allows, else again."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

from ogm_mcmc.geometry.placed_scan import PlacedScan
from ogm_mcmc.geometry.pose import Pose2D
from ogm_mcmc.geometry.rays import Rays
from ogm_mcmc.geometry.scan import Scan

__all__ = ['HeldRays']

# Beams whose rays are held, 17 bytes each.
MOST_HELD = 1_000_000


class HeldRays:
    """The rays of scans at the means of their beliefs, in order, as often as they are asked for.

    Those of the first `most` beams are held, the others are cast each time. `cast` says how; what
    it raises comes out of the loop.
    """

    def __init__(
        self,
        scans: Sequence[PlacedScan],
        cast: Callable[[Scan, Pose2D], Rays],
        most: int = MOST_HELD,
    ) -> None:
        self._scans, self._cast, self._left = scans, cast, most
        self._held: list[Rays] = []

    def __iter__(self) -> Iterator[Rays]:
        """Yield the rays of one scan after the other, also where there are none."""
        for number, placed in enumerate(self._scans):
            if number < len(self._held):
                yield self._held[number]
                continue
            rays = self._cast(placed.scan, placed.pose)
            beams = placed.scan.ranges_m.size
            if number == len(self._held) and beams <= self._left:
                self._left -= beams
                self._held.append(rays)
            yield rays

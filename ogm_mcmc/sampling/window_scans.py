"""Which rays of a window are of which scan: what has to go when a scan goes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import BoolArray
from ogm_mcmc.geometry import CellBox, PlacedScan
from ogm_mcmc.sampling.ray_merging import Lines, Places, Pose, numbers_of
from ogm_mcmc.sampling.ray_stands import Stands

__all__ = ['NOTHING', 'Leaving', 'WindowScans', 'WindowSize']


class WindowSize(NamedTuple):
    """Rays, the most pairs of a ray and a cell, a box around all cells, pairs that are near.

    zones  bytes of what is kept of rays beside the index, and by chains, where all pairs are near:
           see `kept_odds`
    """

    rays: int
    pairs: int
    box: CellBox
    near: int = 0
    zones: int = 0

    def with_more(self, other: WindowSize) -> WindowSize:
        """Return the size of a window of both."""
        return WindowSize(
            self.rays + other.rays,
            self.pairs + other.pairs,
            self.box.union(other.box),
            self.near + other.near,
            self.zones + other.zones,
        )

    def without(self, other: WindowSize, box: CellBox) -> WindowSize:
        """Return the size of a window without a part of it; `box` is around the others."""
        return WindowSize(
            self.rays - other.rays,
            self.pairs - other.pairs,
            box,
            self.near - other.near,
            self.zones - other.zones,
        )

    @property
    def n_bytes(self) -> int:
        """Memory that an index of this size takes, about; measured windows took less."""
        lists = 13 * min(self.near, self.box.n_cells)
        in_front = self.pairs - self.near
        index = 40 * self.rays + 8 * self.near + lists + in_front + self.box.n_cells // 2
        return index + (self.zones if in_front == 0 else 0)


NOTHING = WindowSize(0, 0, CellBox(0, 0, 0, 0))


class _Member(NamedTuple):
    """A scan of a window, with the pose that its rays begin at.

    size, beams  of the rays that it began, and how many beams it has
    left_out     nats that these leave out, see `RayIndex`
    """

    placed: PlacedScan
    pose: Pose
    size: WindowSize
    beams: int
    left_out: float


class Leaving(NamedTuple):
    """What goes with some scans: the others of their places go, too, and come in `again`.

    staying   (N,) rays that stay; size: of the window then
    beams: of all that go; left_out: of those that stay, nats
    """

    again: list[PlacedScan]
    staying: BoolArray
    size: WindowSize
    beams: int
    left_out: float


class WindowScans:
    """The scans of a window whose rays are merged, in the order they came in."""

    def __init__(self) -> None:
        self._members: dict[int, _Member] = {}

    def add(
        self,
        placed: Sequence[PlacedScan],
        taken: Sequence[PlacedScan],
        sizes: Sequence[WindowSize],
        beams: Sequence[int],
        left_out: Sequence[float],
    ) -> None:
        """Note scans that came in, and from where their beams were taken."""
        poses = [numbers_of(scan.pose) for scan in taken]
        for member in map(_Member, placed, poses, sizes, beams, left_out):
            self._members[id(member.placed)] = member

    def leave(
        self, gone: Iterable[PlacedScan], places: Places, stands: Stands, n_rays: int
    ) -> Leaving:
        """Forget scans and all others of their places; these are taken out of `places`, too.

        Raises KeyError for a scan that is not of the window.
        """
        names = {id(one) for one in gone}
        left = {self._members[name].pose for name in names}
        staying = np.ones(n_rays, np.bool_)
        again: list[PlacedScan] = []
        kept: dict[int, _Member] = {}
        size, beams, left_out = NOTHING, 0, 0.0
        for name, member in self._members.items():
            if member.pose not in left:
                kept[name] = member
                size = size.with_more(member.size)
                left_out += member.left_out
                continue
            if name not in names:
                again.append(member.placed)
            beams += member.beams
            known = places.get(member.pose)
            if isinstance(known, Lines):
                staying[known.ray] = False
            elif known is not None:
                staying[known.first_ray : known.first_ray + member.beams] = False
        self._members = kept
        number = np.zeros(n_rays + 1, np.int64)
        np.cumsum(staying, out=number[1:])
        for pose in left:
            places.pop(pose, None)
        for pose, known in places.items():
            places[pose] = known.numbered(number)
        for place in [place for place, pose in stands.items() if numbers_of(pose) in left]:
            del stands[place]
        return Leaving(again, staying, size, beams, left_out)

"""Beams that say the same thing twice are one ray: which beams run along together.

Design note: what a robot that stands costs
-------------------------------------------
Context. A robot that stands for a minute sees the same walls hundreds of times. A reading is made
by the first hit on its ray, so beams through the same cells say together
sum_i log p(z_i | first hit k) of each of them, k, whatever their readings: one table for all.

Decision. Beams from bit-equal poses in bit-equal directions run along one line. Each is level up
to nine sigma before its reading, and level again behind its end: where these stretches overlap,
beams share one ray of the index, which is near to cells from the first to the last of all, and
holds the sums, counted from the level of each beam. Readings that lie further apart (somebody
walks by) stay rays of their own. Rays of a window that grows keep their place, so a beam that
reaches beyond them begins a ray that takes in the whole stretch and sigma more in front; such
records get rare. Samplers see rays as before.

Consequence. Exact, but for rounding of the sums: the tests compare whole chains with those of
the beams one by one. Poses that differ in the last bit do not merge, so those that differ by
next to nothing are made equal before (`ray_stands`). Figures: `docs/whole_drive.md`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import AnyArray, Float64Array
from ogm_mcmc.geometry import PlacedScan, Pose2D
from ogm_mcmc.sampling.beam_rays import BeamRays, most_cells
from ogm_mcmc.sampling.ray_filing_kernels import nearest_of
from ogm_mcmc.sensors.forward_model import ForwardModel

__all__ = ['Joining', 'Lines', 'Places', 'Pose', 'Shared', 'numbers_of']

Pose = tuple[float, float, float]


class Lines(NamedTuple):
    """L rays from one place, by rising direction (L,) complex128.

    nearest, length  from how many m on each is near to cells, and up to where, cells
    cells            (L,) int64, how many it crosses
    ray              (L,) int64, its number in the index
    """

    direction: AnyArray
    nearest: Float64Array
    length: Float64Array
    cells: AnyArray
    ray: AnyArray

    def numbered(self, number: AnyArray) -> Lines:
        """Return the same lines, ray n under `number[n]`."""
        return self._replace(ray=number[self.ray])


class Alone(NamedTuple):
    """The only scan of its place so far; its beams are the rays from `first_ray` on."""

    scan: PlacedScan
    first_ray: int

    def numbered(self, number: AnyArray) -> Alone:
        """Return the same scan, ray n under `number[n]`."""
        return self._replace(first_ray=int(number[self.first_ray]))


Places = dict[Pose, Alone | Lines]
"""What a window has seen from where."""


class Shared(NamedTuple):
    """A scan from where there are others: the ray of each beam (n,) int64, and which began one."""

    ray: AnyArray
    began: AnyArray


class Joining:
    """Scans on their way into a window of `n_rays` rays; nothing of the window changes.

    `places` are those of the window, `cast` makes rays of a scan. After all scans were taken, in
    order, `places` are those to come and `n_rays` the rays.
    """

    def __init__(
        self,
        places: Places,
        n_rays: int,
        scans: Sequence[PlacedScan],
        cast: Callable[[PlacedScan], BeamRays],
        model: ForwardModel,
        resolution_m: float,
    ) -> None:
        self._known, self._cast, self._model = places, cast, model
        self._resolution_m = resolution_m
        self._times = Counter(numbers_of(scan.pose) for scan in scans)
        self._n_before = n_rays
        self._extents: Float64Array | None = None
        self.n_rays = n_rays
        self.places: Places = {}

    def take(self, scan: PlacedScan, rays: BeamRays) -> Shared | None:
        """Return which rays the beams of a scan are, None for one each, new and in order."""
        pose = numbers_of(scan.pose)
        if self._times[pose] == 1 and pose not in self._known:
            self.places[pose] = Alone(scan, self.n_rays)
            self.n_rays += rays.length.size
            return None
        lines = self.places.get(pose)
        if lines is None:
            lines = self._lines_of(self._known.get(pose))
        assert isinstance(lines, Lines)
        beams = self._lines(rays, self.n_rays)
        found, self.places[pose] = joined(
            lines, beams, self._n_before, self._resolution_m, self._model.sigma_m
        )
        began = np.flatnonzero(found >= self.n_rays)
        self.n_rays += began.size
        return Shared(found, began)

    def lines_alone(self, shared: Shared, rays: BeamRays) -> BeamRays:
        """Return the lines that beams of a scan began, of all that will lie along them."""
        extents = self._extents
        if extents is None:
            # Kept once it is whole: chains may ask at once, each in its thread.
            self._extents = extents = self._new_extents()
        chosen = BeamRays(*(array[shared.began] for array in rays))
        nearest, length = extents[shared.ray[shared.began] - self._n_before].T
        return chosen._replace(
            length=length.copy(), reading=np.full(length.size, np.nan), reach=nearest.copy()
        )

    def _new_extents(self) -> Float64Array:
        """Return from where (m) to where (cells) each new ray is near to cells (n, 2)."""
        extents = np.empty((self.n_rays - self._n_before, 2))
        for lines in self.places.values():
            if isinstance(lines, Lines):
                new = lines.ray >= self._n_before
                at = lines.ray[new] - self._n_before
                extents[at, 0] = lines.nearest[new]
                extents[at, 1] = lines.length[new]
        return extents

    def _lines_of(self, known: Alone | Lines | None) -> Lines:
        if known is None:
            none = np.empty(0, np.int64)
            return Lines(np.empty(0, np.complex128), np.empty(0), np.empty(0), none, none)
        if isinstance(known, Alone):
            return _sorted(self._lines(self._cast(known.scan), known.first_ray))
        return Lines(*(array.copy() for array in known))

    def _lines(self, rays: BeamRays, first_ray: int) -> Lines:
        nearest = np.empty(rays.length.size)
        nearest_of(self._model, rays.reading, rays.reach, rays.sigma, nearest)
        np.maximum(nearest, 0.0, out=nearest)
        numbers = first_ray + np.arange(nearest.size)
        direction = rays.ux + 1j * rays.uy
        return Lines(direction, nearest, rays.length.copy(), most_cells(rays), numbers)


def joined(
    lines: Lines,
    beams: Lines,
    n_laid: int,
    resolution_m: float,
    room_m: float,
) -> tuple[AnyArray, Lines]:
    """Return the ray of each beam (n,) int64, and the lines with those that beams begin.

    beams   of one scan, in any order, `ray` the numbers of those that begin lines, in turn
    n_laid  rays from this number on are not laid yet: they can still grow (`lines` is used up)
    room_m  what a line that takes in more than an earlier one has to spare in front; at its end
            it has none, so that the cells of all lines are those of all beams
    """
    number = np.full(beams.ray.size, -1, np.int64)
    nearest, length, cells = beams.nearest.copy(), beams.length.copy(), beams.cells.copy()
    again = np.zeros(beams.ray.size, np.bool_)
    begin = np.searchsorted(lines.direction, beams.direction, 'left')
    end = np.searchsorted(lines.direction, beams.direction, 'right')
    for step in range(int((end - begin).max(initial=0))):
        beam = np.flatnonzero((begin + step < end) & (number < 0))
        at = begin[beam] + step
        overlaps = (beams.nearest[beam] <= lines.length[at] * resolution_m) & (
            lines.nearest[at] <= beams.length[beam] * resolution_m
        )
        fits = (beams.nearest[beam] >= lines.nearest[at]) & (beams.cells[beam] <= lines.cells[at])
        mine = fits | (overlaps & (lines.ray[at] >= n_laid))
        number[beam[mine]] = lines.ray[at[mine]]
        np.minimum.at(lines.nearest, at[mine], beams.nearest[beam[mine]])
        np.maximum.at(lines.length, at[mine], beams.length[beam[mine]])
        np.maximum.at(lines.cells, at[mine], beams.cells[beam[mine]])
        wider = overlaps & ~mine
        nearest[beam[wider]] = np.minimum(nearest[beam[wider]], lines.nearest[at[wider]])
        length[beam[wider]] = np.maximum(length[beam[wider]], lines.length[at[wider]])
        cells[beam[wider]] = np.maximum(cells[beam[wider]], lines.cells[at[wider]])
        again[beam[wider]] = True
    new = np.flatnonzero(number < 0)
    roomy = new[again[new]]
    nearest[roomy] -= room_m
    number[new] = beams.ray[: new.size]
    more = Lines(beams.direction[new], nearest[new], length[new], cells[new], number[new])
    if new.size == 0:
        return number, lines
    both = Lines(*(np.concatenate(arrays) for arrays in zip(lines, more, strict=True)))
    return number, _sorted(both)


def _sorted(lines: Lines) -> Lines:
    order = np.argsort(lines.direction, kind='stable')
    return Lines(*(array[order] for array in lines))


def numbers_of(pose: Pose2D) -> Pose:
    """Return the numbers of a pose, which name a place."""
    return pose.x_m, pose.y_m, pose.yaw_rad

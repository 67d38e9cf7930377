"""Scans with the memory that a window would need for them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import NamedTuple

from ogm_mcmc.config import SamplerConfig
from ogm_mcmc.geometry import CellBox, PlacedScan
from ogm_mcmc.sampling import RayWindow, WindowSize

__all__ = ['MeasuredScan', 'box_around', 'measuring', 'on_border']


class MeasuredScan(NamedTuple):
    """A placed scan and what it adds to a window."""

    placement: PlacedScan
    size: WindowSize

    @property
    def beams(self) -> int:
        """How many there are, whether they say anything or not."""
        return int(self.placement.scan.ranges_m.size)


def measuring(sampler: SamplerConfig, no_return: str) -> RayWindow:
    """Return a window that tells how much memory scans need."""
    window, chains = replace(sampler.window, no_return=no_return), sampler.chains_of_cells
    return RayWindow(window, sampler.model, margin=sampler.patch.window_margin, chains=chains)


def box_around(scans: Iterable[MeasuredScan]) -> CellBox:
    """Return a box around all cells of scans."""
    box = CellBox(0, 0, 0, 0)
    for kept in scans:
        box = box.union(kept.size.box)
    return box


def on_border(inner: CellBox, outer: CellBox) -> bool:
    """Whether a box might be smaller without another one in it."""
    return not inner.empty and any(a == b for a, b in zip(inner, outer, strict=True))

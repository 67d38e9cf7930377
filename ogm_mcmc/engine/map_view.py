"""Maps as they are shown: whole percents or three values, kept up to date by what changed."""

from __future__ import annotations

import numpy as np

from ogm_mcmc.arrays import Float32Array, Int8Array
from ogm_mcmc.config import OutputConfig
from ogm_mcmc.geometry import CellBox, GridSpec
from ogm_mcmc.geometry.grid_map import entropy_bits, occupancy_values, trinary_values
from ogm_mcmc.pipeline import MappingPipeline

__all__ = ['KINDS', 'MapView', 'rendered']

# What may be shown of a map: three values, whole percents, or the entropy in percent of a bit.
KINDS = ('trinary', 'probability', 'entropy')

# Changes far apart are brought up to date one by one: the box around both may be the whole map.
MAX_STALE_BOXES = 16


def rendered(probability: Float32Array, kind: str, output: OutputConfig) -> Int8Array:
    """Return probabilities as values of nav_msgs/OccupancyGrid: 0..100, -1 for nan.

    `kind` is one of `KINDS`; the thresholds of `output` count for `trinary`.
    """
    if kind == 'entropy':
        return occupancy_values(entropy_bits(probability).astype(np.float32))
    if kind == 'trinary':
        return trinary_values(probability, output.occupied_thresh, output.free_thresh)
    return occupancy_values(probability)


class MapView:
    """The values of a map, kept up to date by work proportional to the change.

    `values` (height, width) int8 as in nav_msgs/OccupancyGrid: 0..100, -1 unknown. A subclass
    may decide where they live (`_allocate`), so that a message needs no further copy.
    """

    def __init__(self, pipeline: MappingPipeline, output: OutputConfig, kind: str = '') -> None:
        self.pipeline = pipeline
        self.output = output
        self.kind = kind
        self.spec: GridSpec | None = None
        self.values: Int8Array = np.empty((0, 0), np.int8)
        self._stale: list[CellBox] = []
        self.mark(pipeline.changed)

    def mark(self, changed: CellBox) -> None:
        """Note that cells changed; every change since the view was made has to be marked."""
        if changed.empty:
            return
        for index, box in enumerate(self._stale):
            both = box.union(changed)
            if both.n_cells <= 2 * (box.n_cells + changed.n_cells):
                self._stale[index] = both
                return
        if len(self._stale) < MAX_STALE_BOXES:
            self._stale.append(changed)
        else:
            self._stale[-1] = self._stale[-1].union(changed)

    def restart(self) -> None:
        """Forget what was shown (after a reset)."""
        self.spec = None
        self._stale = []
        self.mark(self.pipeline.changed)

    @property
    def stale(self) -> bool:
        """Whether `refresh` has anything to do."""
        return bool(self._stale) or self.spec != self.pipeline.method.spec

    def refresh(self) -> list[CellBox]:
        """Bring `values` up to date; return the boxes that were written."""
        spec = self.pipeline.method.spec
        if spec != self.spec:
            before, values = self.spec, self._allocate(spec)
            values.fill(-1)
            # After a reset the window may have moved: nothing of the old one is true any more.
            if before is not None and spec.box.covers(before.box):
                values[spec.slices(before.box)] = self.values
            self.spec, self.values = spec, values
        written, self._stale = self._stale, []
        for box in written:
            probability = self.pipeline.method.probabilities(box)
            self.values[spec.slices(box)] = rendered(
                probability, self.kind or self.output.output, self.output
            )
        return written

    def _allocate(self, spec: GridSpec) -> Int8Array:
        return np.empty((spec.height, spec.width), np.int8)

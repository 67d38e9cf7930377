"""Maps drawn from a posterior, kept as bits: a cell's value in 64 of them is one word."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import AnyArray, BoolArray, UInt8Array
from ogm_mcmc.errors import ConfigError
from ogm_mcmc.geometry.grid_map import GridMap
from ogm_mcmc.geometry.grid_spec import GridSpec

__all__ = ['WORD', 'SampleBits']

WORD = 64


class SampleBits(NamedTuple):
    """`draws` maps as bits: `words` (height, width, L) uint64, bit s % 64 of word s // 64.

    `known` (height, width): the cells that were sampled.
    """

    spec: GridSpec
    words: AnyArray
    known: BoolArray
    draws: int

    def known_in(self, grid_map: GridMap) -> SampleBits:
        """Return these samples, known only where a map of the same cells is."""
        return self._replace(known=self.known & np.isfinite(grid_map.probability))

    @classmethod
    def of_maps(cls, spec: GridSpec, maps: UInt8Array, known: BoolArray) -> SampleBits:
        """Pack maps (S, height, width) of 0 and 1. Raises ConfigError without any."""
        if len(maps) == 0:
            raise ConfigError('no map sample: expected at least 1')
        n_words = -(-len(maps) // WORD)
        words = np.zeros((spec.height, spec.width, n_words), np.uint64)
        for s, cells in enumerate(maps):
            words[:, :, s // WORD] |= cells.astype(np.uint64) << np.uint64(s % WORD)
        return cls(spec, words, known, len(maps))

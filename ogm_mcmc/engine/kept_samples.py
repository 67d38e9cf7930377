"""Maps kept while chains go on, for questions about whole maps.

64 at most: one word a cell, a bit for each. They are taken from all chains after a round of
sampling, about 0.1 s; when all bits are taken every other round is forgotten and every other
one is taken from then on, so that they lie evenly over all that was sampled.
"""

from __future__ import annotations

from weakref import ReferenceType, ref

import numpy as np

from ogm_mcmc.arrays import AnyArray
from ogm_mcmc.geometry import GridSpec, SampleBits
from ogm_mcmc.sampling import PosteriorSampler

__all__ = ['MOST_SAMPLES', 'KeptSamples']

MOST_SAMPLES = 64


class KeptSamples:
    """Keeps maps of one sampler, not the sampler itself; those of another take their place.

    `most`: so many in all, 0 to 64; where there are more chains, of the first ones.
    """

    def __init__(self, most: int = MOST_SAMPLES) -> None:
        self.most = most
        self._sampler: ReferenceType[PosteriorSampler] | None = None
        self._words: AnyArray = np.zeros(0, np.uint64)  # (C,) of the touched cells
        self._slots: dict[int, int] = {}  # by round: where its bits begin
        self._rounds, self._every, self._chains = 0, 1, 0

    def add(self, sampler: PosteriorSampler) -> None:
        """Take the present map of every chain, if it is the turn of this round."""
        if self.most == 0:
            return
        if not self._is_of(sampler):
            self._sampler = ref(sampler)
            self._words = np.zeros(sampler.model.touched.size, np.uint64)
            self._chains = min(len(sampler.states), self.most)
            self._slots, self._rounds, self._every = {}, 0, 1
        at, self._rounds = self._rounds, self._rounds + 1
        if at % self._every != 0:
            return
        if len(self._slots) == self.most // self._chains:
            self._forget_every_other()
            if at % self._every != 0:
                return
        taken = set(self._slots.values())
        first = next(slot for slot in range(0, self.most, self._chains) if slot not in taken)
        self._slots[at] = first
        for j, state in enumerate(sampler.states[: self._chains]):
            cells = state.cells[sampler.model.touched].astype(np.uint64)
            self._words |= cells << np.uint64(first + j)

    def clear(self) -> None:
        """Forget all samples."""
        self._sampler, self._words, self._slots = None, np.zeros(0, np.uint64), {}

    def _is_of(self, sampler: PosteriorSampler) -> bool:
        return self._sampler is not None and self._sampler() is sampler

    def _forget_every_other(self) -> None:
        self._every *= 2
        mask = 0
        for at in [at for at in self._slots if at % self._every != 0]:
            mask |= ((1 << self._chains) - 1) << self._slots.pop(at)
        self._words &= ~np.uint64(mask)

    def bits(self, sampler: PosteriorSampler, spec: GridSpec) -> SampleBits | None:
        """Return what was kept of a sampler, on its window; None while nothing was."""
        if not self._is_of(sampler) or not self._slots:
            return None
        words = np.zeros(spec.width * spec.height, np.uint64)
        known = np.zeros(spec.width * spec.height, np.bool_)
        words[sampler.model.touched] = self._words
        known[sampler.model.touched] = True
        shape = (spec.height, spec.width)
        draws = len(self._slots) * self._chains
        return SampleBits(spec, words.reshape(*shape, 1), known.reshape(shape), draws)

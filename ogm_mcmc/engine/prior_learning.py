"""Patch priors learned from maps ([patch] section III), and judged by maps left out."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

from ogm_mcmc.arrays import Int8Array
from ogm_mcmc.config import LearningConfig, PatchTableConfig, flatten
from ogm_mcmc.engine.prior_files import Prior
from ogm_mcmc.errors import PriorError, require
from ogm_mcmc.io.training_maps import MapSource, TrainingMap
from ogm_mcmc.sampling.patch_learning import PatchCounts, count_map, rescaled, total_of
from ogm_mcmc.sampling.patch_prior import make_table, nats_per_window
from ogm_mcmc.sampling.patch_statistics import PUBLISHED, patch_statistics

__all__ = ['PUBLISHED', 'CountedMaps', 'count_maps', 'patch_statistics']


class CountedMaps(NamedTuple):
    """Patch counts of each map, where the maps come from, and which were left out as coarser."""

    counts: dict[Path, PatchCounts]
    sources: list[MapSource]
    skipped: list[str]
    config: LearningConfig

    def prior(self, least: int) -> Prior:
        """Return the prior of all maps, without 5 x 5 windows seen less often than `least`.

        Raises ConfigError when no window was seen so often.
        """
        counts = total_of(self.counts.values()).without_rare(least)
        seen = counts.squares.patterns.size > 0
        require(seen, 'least', least, 'no 5 x 5 window was seen so often')
        return Prior(counts, {**flatten(self.config), 'least': least}, tuple(self.sources))

    def scores_left_out(self, table: PatchTableConfig, least: int) -> Iterator[tuple[Path, float]]:
        """Yield each map and -log p(patch | border) of its 3 x 3 patches given the others, nats.

        Mean over its windows; there have to be two maps at least.
        """
        for path, counts in self.counts.items():
            others = total_of(each for other, each in self.counts.items() if other != path)
            made = make_table('border', 9, others.without_rare(least), table)
            yield path, nats_per_window(made, counts)


def count_maps(maps: Iterable[tuple[Path, TrainingMap]], config: LearningConfig) -> CountedMaps:
    """Count the patches of maps at the resolution of the settings.

    Raises PriorError for a map that comes twice or cannot be counted, and when none is left.
    """
    counted = CountedMaps({}, [], [], config)
    for path, training in maps:
        if config.coarser == 'skip' and _coarser(training, config):
            counted.skipped.append(str(path))
            continue
        if path in counted.counts:
            raise PriorError(f'{path}: given twice: expected each map once')
        try:
            counted.counts[path] = count_map(_at_resolution(training, config), config)
        except PriorError as error:
            raise PriorError(f'{path}: {error}') from error
        counted.sources.append(training.source)
    if not counted.counts:
        raise PriorError(f'all maps are coarser than {config.resolution:g} m: expected finer ones')
    return counted


def _coarser(training: TrainingMap, config: LearningConfig) -> bool:
    return training.resolution_m > config.resolution * (1.0 + 1e-6)


def _at_resolution(training: TrainingMap, config: LearningConfig) -> Int8Array:
    if config.coarser == 'as_is' and _coarser(training, config):
        return training.states
    return rescaled(training.states, training.resolution_m, config.resolution)

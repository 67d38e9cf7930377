"""The mappers of the leaderboard, and what each takes of the machine."""

from __future__ import annotations

import gc
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple, Protocol

from ogm_mcmc.config import (
    MapperConfig,
    PatchConfig,
    StopConfig,
)
from ogm_mcmc.config.nodes import NodeWindowConfig, RefineSamplerConfig
from ogm_mcmc.engine.live_map import map_of
from ogm_mcmc.engine.refinement import Refinement
from ogm_mcmc.engine.warm_up import warm_up_sampling
from ogm_mcmc.geometry import GridMap, PlacedScan
from ogm_mcmc.lab.memory import PROC, give_back_free_memory, memory_mb

__all__ = [
    'FOR_EXACT_POSES',
    'FOR_PARTICLES',
    'MAPPERS',
    'WITH_JOINT_POSES',
    'Mapped',
    'Mapper',
    'Resources',
    'Used',
]

SWEEPS, BURN_IN = 60, 20


class Used(NamedTuple):
    """Seconds of processors; the rise of memory, MB, None where the system does not tell."""

    seconds: float
    megabytes: float | None


class Mapped(NamedTuple):
    """A map, what it cost, and of how many chains it is the mean: none of a live map."""

    grid_map: GridMap
    used: Used
    chains: int = 0


class Lattice(Protocol):
    """What a mapper has to know of a data set."""

    @property
    def cell_m(self) -> float:
        """Side of a cell."""
        ...

    @property
    def no_return(self) -> str:
        """What beams without a return say."""
        ...


Mapper = Callable[[Sequence[PlacedScan], Lattice, int], Mapped]


class Resources:
    """Measures from its making to `stop`: seconds of processors and the highest memory.

    Memory needs Linux, whose kernel forgets the highest resident set when asked to.
    """

    def __init__(self) -> None:
        gc.collect()
        give_back_free_memory()
        try:
            (PROC / 'clear_refs').write_text('5', encoding='ascii')
            self._before_mb = memory_mb('VmRSS')
        except OSError:
            self._before_mb = None
        self._began = time.process_time()

    def stop(self) -> Used:
        """Return what was used."""
        seconds = time.process_time() - self._began
        most_mb = memory_mb('VmHWM')
        if self._before_mb is None or most_mb is None:
            return Used(seconds, None)
        return Used(seconds, round(most_mb - self._before_mb, 1))


def _method(config: MapperConfig) -> Mapper:
    """Return the mapper of a live method."""

    def made(scans: Sequence[PlacedScan], lattice: Lattice, _seed: int) -> Mapped:
        settings = replace(config, resolution=lattice.cell_m, no_return=lattice.no_return)
        map_of(scans[:2], settings)  # compiled before the clock starts
        watch = Resources()
        found = map_of(scans, settings)
        return Mapped(found, watch.stop())

    return made


def _sampler(patch: PatchConfig) -> Mapper:
    """Return the mapper that samples with a prior; otherwise the defaults of `sample`."""

    def made(scans: Sequence[PlacedScan], lattice: Lattice, seed: int) -> Mapped:
        defaults = RefineSamplerConfig()
        config = replace(
            defaults,
            window=NodeWindowConfig(resolution=lattice.cell_m, no_return=lattice.no_return),
            chain=replace(defaults.chain, burn_in=BURN_IN, seed=seed),
            patch=patch,
        )
        warm_up_sampling(config)
        watch = Resources()
        refinement = Refinement(config)
        refinement.take(scans)
        for _ in refinement.run(StopConfig(max_sweeps=SWEEPS, max_time=1e6, r_hat=0.0)):
            pass
        found = refinement.map()
        used = watch.stop()
        assert refinement.sampler is not None
        return Mapped(found, used, len(refinement.sampler.states))

    return made


MAPPERS: dict[str, Mapper] = {
    'two_assumption': _method(MapperConfig()),
    'two_assumption, gaussian': _method(MapperConfig(inverse_model='gaussian')),
    'counting': _method(MapperConfig(method='counting')),
    'adaptive': _method(MapperConfig(method='adaptive')),
    'random_field': _method(MapperConfig(method='random_field')),
    'pose_uncertain': _method(MapperConfig(method='pose_uncertain')),
    'sampled, single cells': _sampler(PatchConfig()),
    'sampled, patch prior': _sampler(PatchConfig(prior='patch', size=9)),
    'sampled, border prior': _sampler(RefineSamplerConfig().patch),
}

# Where poses are exact, averaging over them is `two_assumption`.
FOR_EXACT_POSES = tuple(name for name in MAPPERS if name != 'pose_uncertain')
FOR_PARTICLES = tuple(MAPPERS)
WITH_JOINT_POSES = ('two_assumption', 'sampled, border prior')

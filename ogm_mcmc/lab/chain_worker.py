"""Chains on a worker of a cluster: what it is asked to do, and what it keeps; see `cluster`."""

from __future__ import annotations

import threading
import uuid
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from ogm_mcmc.arrays import AnyArray, BoolArray, UInt8Array
from ogm_mcmc.engine.posterior import posterior_of
from ogm_mcmc.errors import WindowError
from ogm_mcmc.lab.chain_parcels import (
    AddedCounts,
    PackedCounts,
    PackedRow,
    pack_bits,
    pack_counts,
    pack_rows,
    unpack_bits,
    unpack_counts,
)
from ogm_mcmc.lab.parcels import unpack
from ogm_mcmc.lab.workers import this_worker
from ogm_mcmc.sampling import PosteriorModel, PosteriorSampler
from ogm_mcmc.sampling.diagnostics import BatchCounts

__all__ = [
    'Advanced',
    'ChainJob',
    'ChainState',
    'Looks',
    'Problem',
    'Unknown',
    'advance_chain',
]


class Problem(NamedTuple):
    """What a worker builds a model from: `token` is the digest of its parcel.

    `n_rays` and `n_cells` are those of the window at home: all rays, those that merge included.
    """

    token: str
    n_rays: int
    n_cells: int


class Looks(NamedTuple):
    """Where a chain looks most, as bits of (2, C) cells: decided `after` so many sweeps."""

    after: int
    cells: bytes

    @classmethod
    def of(cls, sampler: PosteriorSampler, j: int) -> Looks | None:
        """Return where a chain of a sampler looks most, None for nowhere."""
        focus = sampler.focus.get(j)
        return None if focus is None else cls(focus.after, pack_bits(focus.cells))

    def into(self, sampler: PosteriorSampler, j: int) -> None:
        """Let a chain of a sampler look there."""
        cells = unpack_bits(self.cells, 2 * sampler.model.touched.size)
        sampler.look_at(j, self.after, cells.reshape(2, -1).view(np.bool_))


class ChainState(NamedTuple):
    """All that a chain is, but for counts from which nothing follows any more.

    cells      bits of its map (K,)
    generator  the state of its generator
    settling   counts of the burn-in, None after it: where to look most follows from them
    counted    how far the batches of sweeps that count are: `batch_length`, `full`, `in_last`
    """

    cells: bytes
    generator: Mapping[str, Any]
    sweeps: int
    settling: PackedCounts | None
    counted: tuple[int, int, int]
    looks: Looks | None

    @classmethod
    def of(cls, sampler: PosteriorSampler, j: int) -> ChainState:
        """Return what a chain of a sampler is."""
        cells, counts, settling = sampler.maps()[j], sampler.counts[j], None
        if sampler.sweeps < sampler.burn_in:
            settling = pack_counts(sampler.settling[j], _occupied(sampler.model, cells))
        return cls(
            pack_bits(cells),
            sampler.rngs[j].bit_generator.state,
            sampler.sweeps,
            settling,
            (counts.batch_length, counts.full, counts.in_last),
            Looks.of(sampler, j),
        )

    @property
    def n_bytes(self) -> int:
        """How much there is to send."""
        rows = () if self.settling is None else self.settling.rows
        looks = 0 if self.looks is None else len(self.looks.cells)
        return len(self.cells) + looks + sum(len(row.coded) for row in rows)

    def begun(self, model: PosteriorModel, burn_in: int) -> PosteriorSampler:
        """Return a sampler of this chain alone, which keeps what it adds to counts."""
        sampler = PosteriorSampler(model, [], seed=0, burn_in=burn_in)
        sampler.sweeps = self.sweeps
        cells = unpack_bits(self.cells, model.n_cells)
        sampler.states = [model.start(cells)]
        rng = np.random.default_rng()
        rng.bit_generator.state = self.generator
        sampler.rngs = [rng]
        n_cells = model.touched.size
        counted = BatchCounts(0, batch_length=self.counted[0])
        counted.full, counted.in_last = self.counted[1:]
        sampler.counts = [AddedCounts(counted, n_cells, whole=False)]
        if self.settling is not None:
            told = unpack_counts(self.settling, _occupied(model, cells))
            sampler.settling = [AddedCounts(told, n_cells, whole=True)]
        if self.looks is not None:
            self.looks.into(sampler, 0)
        return sampler


class ChainJob(NamedTuple):
    """What is to be done: a chain of this number does so many sweeps.

    mark   of the chain where it stands now, by whoever advanced it last
    state  where it stands; None: whoever gave the mark has it
    """

    chain: int
    mark: str
    burn_in: int
    n_sweeps: int
    state: ChainState | None

    @property
    def n_bytes(self) -> int:
        """How much there is to send."""
        return 0 if self.state is None else self.state.n_bytes


class Advanced(NamedTuple):
    """What a chain became: its new `mark`, its map and generator, what it added to its counts.

    looks           where it looks most, if that was decided now
    log_likelihood  of its map, nats
    worker          that did it, see `this_worker`
    """

    mark: str
    cells: bytes
    generator: Mapping[str, Any]
    settling: list[PackedRow]
    counted: list[PackedRow]
    looks: Looks | None
    flips: int
    log_likelihood: float
    worker: str

    @property
    def n_bytes(self) -> int:
        """How much there is to send."""
        looks = 0 if self.looks is None else len(self.looks.cells)
        rows = (*self.settling, *self.counted)
        return len(self.cells) + looks + sum(len(row.coded) for row in rows)


class Unknown(NamedTuple):
    """What a worker says that does not keep a chain: it has to be told its state."""

    worker: str


def advance_chain(problem: Problem, parcel: bytes, job: ChainJob) -> Advanced | Unknown:
    """Advance a chain, if this process keeps it or is told its state."""
    with _lock:
        mark, sampler = _kept.pop((problem.token, job.chain), ('', None))
    if sampler is None or mark != job.mark:
        if job.state is None:
            return Unknown(this_worker())
        sampler = job.state.begun(_model_of(problem, parcel), job.burn_in)
    sampler.burn_in = job.burn_in
    before = sampler.focus.get(0)
    flips = sampler.advance(job.n_sweeps)
    answer = _answer(sampler, flips, looked=sampler.focus.get(0) is not before)
    if sampler.sweeps >= sampler.burn_in:
        sampler.settling = []  # nothing follows from it any more
    with _lock:
        if problem.token in _models:
            _kept[problem.token, job.chain] = answer.mark, sampler
    return answer


def _answer(sampler: PosteriorSampler, flips: int, *, looked: bool) -> Advanced:
    cells = sampler.maps()[0]
    occupied = _occupied(sampler.model, cells)
    settling, counted = (
        [row for counts in every for row in _added(counts)]
        for every in (sampler.settling, sampler.counts)
    )
    return Advanced(
        uuid.uuid4().hex,
        pack_bits(cells),
        sampler.rngs[0].bit_generator.state,
        pack_rows(settling, occupied),
        pack_rows(counted, occupied),
        Looks.of(sampler, 0) if looked else None,
        flips,
        sampler.log_likelihoods()[0],
        this_worker(),
    )


def _added(counts: BatchCounts) -> list[tuple[AnyArray, int]]:
    assert isinstance(counts, AddedCounts)
    return counts.take_added()


def _occupied(model: PosteriorModel, cells: UInt8Array) -> BoolArray:
    occupied: BoolArray = cells[model.touched] != 0
    return occupied


_lock = threading.Lock()
_models: dict[str, PosteriorModel] = {}
# By problem and number of the chain: its mark, and the chain.
_kept: dict[tuple[str, int], tuple[str, PosteriorSampler]] = {}


def _model_of(problem: Problem, parcel: bytes) -> PosteriorModel:
    """Return the model of a problem, built when it is first asked for in this process."""
    with _lock:
        model = _models.get(problem.token)
        if model is None:
            _models.clear()
            _kept.clear()
            model = _models[problem.token] = _built(problem, parcel)
    return model


def _built(problem: Problem, parcel: bytes) -> PosteriorModel:
    scans, (config, table) = unpack(parcel)
    window, model = posterior_of(config, scans, table)
    found = window.n_beams, model.n_cells
    if found != (problem.n_rays, problem.n_cells):
        raise WindowError(
            f'{found[0]} rays in {found[1]} cells on a worker: expected the '
            f'{problem.n_rays} in {problem.n_cells} of the window at home'
        )
    return model

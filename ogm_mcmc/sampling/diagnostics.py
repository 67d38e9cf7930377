"""How far chains of binary cells can be trusted: R-hat, effective sample size, standard error.

Everything is computed from how often a cell was occupied in each of several batches of sweeps: a
0/1 cell is known by its counts, so no chain has to be kept.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import AnyArray, BoolArray, Float32Array, Float64Array, Int64Array
from ogm_mcmc.sampling.gibbs_kernels import PARTS

__all__ = [
    'TURNS',
    'BatchCounts',
    'ChainQuality',
    'agreeing_share',
    'assess',
    'in_groups',
    'judged_in_groups',
    'later_halves',
    'later_mean',
    'split_r_hat',
]

MAX_BATCHES = 16
LARGEST_UINT16 = 65_535

# Chains in a turn, two for each group: dispersed starts are four (see `over_dispersed_starts`).
TURNS = 4

# A cell this near to 0 or 1 is decided; the others say how well chains mix.
DECIDED = 0.01


class BatchCounts:
    """How often each of C cells was occupied in batches of sweeps of one chain.

    There are at most 16 batches. When all are full each two become one, and a batch takes twice
    as many sweeps from then on: memory stays the same however long a chain runs. What is added for
    a sweep is whether a cell was occupied or with what probability it was drawn, in `PARTS`.
    """

    def __init__(self, n_cells: int, *, batch_length: int = 1) -> None:
        narrow = batch_length * PARTS <= LARGEST_UINT16
        dtype = np.uint16 if narrow else np.uint32
        self.counts: AnyArray = np.zeros((MAX_BATCHES, n_cells), dtype)
        self.batch_length = batch_length
        self.full = 0  # batches
        self.in_last = 0  # sweeps in the batch being filled

    @property
    def n_sweeps(self) -> int:
        """Sweeps counted."""
        return self.full * self.batch_length + self.in_last

    @property
    def row(self) -> AnyArray:
        """Counts (C,), in `PARTS`, to add the next sweep to; call `sweep_added` afterwards."""
        row: AnyArray = self.counts[self.full]
        return row

    def sweep_added(self) -> None:
        """Note that a sweep was added to `row`."""
        self._have_added(1)

    def add(self, row: AnyArray, n_sweeps: int) -> None:
        """Add what so many sweeps counted (C,), in `PARTS`: of the batch being filled, no more."""
        mine = self.row
        mine += row.astype(mine.dtype, copy=False)
        self._have_added(n_sweeps)

    def _have_added(self, n_sweeps: int) -> None:
        self.in_last += n_sweeps
        if self.in_last < self.batch_length:
            return
        self.full, self.in_last = self.full + 1, 0
        if self.full == MAX_BATCHES:
            self._merge()

    def _merge(self) -> None:
        self.batch_length *= 2
        if self.batch_length * PARTS > LARGEST_UINT16 and self.counts.dtype == np.uint16:
            self.counts = self.counts.astype(np.uint32)
        half = MAX_BATCHES // 2
        for batch in range(half):
            self.counts[batch] = self.counts[2 * batch] + self.counts[2 * batch + 1]
        self.counts[half:] = 0
        self.full = half

    @property
    def merged(self) -> AnyArray | None:
        """Counts (8, C), in `PARTS`, of batches when two last became one; None before that."""
        return None if self.batch_length == 1 else self.counts[: MAX_BATCHES // 2]

    def total(self) -> Float64Array:
        """How often (C,) cells were occupied in all sweeps."""
        total: Float64Array = self.counts.sum(axis=0, dtype=np.int64) / PARTS
        return total

    @property
    def n_recent(self) -> int:
        """Sweeps that `recent` counts."""
        return (self.full - self.full // 2) * self.batch_length + self.in_last

    def recent(self) -> Float64Array:
        """How often (C,), in the later half of the batches and the one being filled."""
        rows = self.counts[self.full // 2 : self.full + 1]
        recent: Float64Array = rows.sum(axis=0, dtype=np.int64) / PARTS
        return recent

    def batches(self) -> AnyArray:
        """Counts (B, C) of the full batches, in `PARTS`."""
        return self.counts[: self.full]


class ChainQuality(NamedTuple):
    """Per cell (C,) float32: `r_hat`, `ess` (effective samples) and `mcse` of the mean.

    `mean` (C,) and all else come from the `sweeps` of all `chains` in full batches.
    """

    r_hat: Float32Array
    ess: Float32Array
    mcse: Float32Array
    mean: Float32Array
    sweeps: int
    chains: int

    def of(self, cells: BoolArray) -> ChainQuality:
        """Return the quality of some of the cells: `cells` (C,)."""
        return self._replace(
            r_hat=self.r_hat[cells],
            ess=self.ess[cells],
            mcse=self.mcse[cells],
            mean=self.mean[cells],
        )

    def agreeing_share(self, limit: float) -> float:
        """Share of cells whose R-hat is below a limit."""
        return agreeing_share(self.r_hat, limit)

    def summary(self) -> dict[str, float]:
        """Return overall figures; ESS over cells that are not decided, in the median."""
        open_cells = (self.mean > DECIDED) & (self.mean < 1.0 - DECIDED)
        some = bool(open_cells.any())
        return {
            'r_hat_p99': _quantile(self.r_hat, 0.99) if self.r_hat.size else 1.0,
            'ess_median': float(np.median(self.ess[open_cells])) if some else float(self.sweeps),
            'mcse_max': float(self.mcse.max()) if self.mcse.size else 0.0,
            'undecided_cells': int(open_cells.sum()),
        }


def split_r_hat(means: Float64Array, length: int) -> Float32Array:
    """Gelman-Rubin R-hat of 0/1 cells from the means (S, C) of S sequences of `length` sweeps.

    With W the mean of the variances inside the sequences and B/n that of their means,
    R-hat^2 = ((n - 1) / n W + B / n) / W. 1 where all are the same constant, inf where they are
    different constants.

    Where probabilities were counted in place of draws B/n is the variance of their means, so of
    the estimates themselves; W is p (1 - p) still, that of a cell drawn with them. Probabilities
    vary less than draws: the same limit is then easier to pass than it is by draws.
    """
    within = (means * (1.0 - means)).mean(axis=0) * (length / (length - 1.0))
    between = means.var(axis=0, ddof=1)
    with np.errstate(divide='ignore', invalid='ignore'):
        r_hat = np.sqrt((length - 1.0) / length + between / within)
    r_hat[(within == 0.0) & (between == 0.0)] = 1.0
    result: Float32Array = r_hat.astype(np.float32)
    return result


def assess(chains: Sequence[BatchCounts]) -> ChainQuality | None:
    """Judge chains of equal length; None while a batch is one sweep (fewer than 16 sweeps).

    R-hat compares the first and the last half of every chain, of many chains those of two groups
    (see `in_groups`). The variance of the mean is the larger of two estimates: from the batches,
    which is steady but knows nothing of what stays correlated for longer than a batch, and from
    the half chains, which also sees chains that disagree. ESS is what independent draws would have
    that variance, at most the draws there are, and all of them for a cell that never flipped.

    The standard error is that of ESS draws with two more of either kind (Agresti and Coull 1998),
    mcse^2 = q (1 - q) / ess with q = (ess mean + 2) / (ess + 4): a cell that never flipped has
    sqrt(2) / draws, as nothing is known of how often it would. How far to trust it: see the
    design note of `ogm_mcmc.sampling`.
    """
    first = chains[0]
    n_batches, length = first.full, first.batch_length
    if length == 1:
        return None
    draws, n_cells = n_batches * len(chains) * length, first.counts.shape[1]
    # Most cells are the same in all maps: what is known of one such cell serves them all.
    lowest, highest = _extremes(chains)
    moved = np.flatnonzero((lowest < length * PARTS) & (highest > 0))
    r_hat, ess = np.ones(n_cells, np.float32), np.full(n_cells, draws, np.float32)
    mean = (lowest > 0).astype(np.float32)
    mcse = np.full(n_cells, _errors(np.zeros(1), np.array([float(draws)]))[0], np.float32)
    found = _assessed([chain.batches()[:, moved] for chain in chains], length)
    for whole, part in zip((r_hat, ess, mcse, mean), found, strict=True):
        whole[moved] = part
    return ChainQuality(r_hat, ess, mcse, mean, draws, len(chains))


def _extremes(chains: Sequence[BatchCounts]) -> tuple[AnyArray, AnyArray]:
    """Return the lowest and the highest count (C,) of all full batches."""
    lowest = np.min([chain.batches().min(axis=0) for chain in chains], axis=0)
    highest = np.max([chain.batches().max(axis=0) for chain in chains], axis=0)
    return lowest, highest


def _assessed(chains: list[AnyArray], length: int) -> tuple[AnyArray, ...]:
    """Return R-hat, ESS, standard error and mean (C,) from batches (B, C) of each chain."""
    n_batches, n_cells = chains[0].shape
    half = n_batches // 2
    halves = np.empty((2 * len(chains), n_cells))
    total, squares = np.zeros(n_cells), np.zeros(n_cells)
    for j, counts in enumerate(chains):
        halves[2 * j] = counts[:half].sum(axis=0, dtype=np.float64)
        halves[2 * j + 1] = counts[n_batches - half :].sum(axis=0, dtype=np.float64)
        for batch in counts:
            mean = batch / (length * PARTS)
            total += mean
            squares += mean * mean
    halves /= half * length * PARTS
    n_means = n_batches * len(chains)
    mean = total / n_means
    # Variance of the mean of all: that of one batch, or half chain, by how many there are.
    variance = np.maximum(squares - n_means * mean * mean, 0.0) / (n_means - 1) / n_means
    variance = np.maximum(variance, halves.var(axis=0, ddof=1) / len(halves))
    draws = n_means * length
    with np.errstate(divide='ignore', invalid='ignore'):
        ess = mean * (1.0 - mean) / variance
    ess = np.clip(np.nan_to_num(ess, nan=draws, posinf=draws), 1.0, draws)
    means, together = in_groups(halves)
    return split_r_hat(means, half * length * together), ess, _errors(mean, ess), mean


def judged_in_groups(n_chains: int) -> bool:
    """Return whether R-hat compares two groups of so many chains, see `in_groups`."""
    return n_chains >= TURNS and n_chains % TURNS == 0


def in_groups(halves: Float64Array) -> tuple[Float64Array, int]:
    """Return means (4, C) of the halves of two groups of chains, and how many are in a group.

    halves  (2 n, C) means of the first and the last half of each of n chains in turn
    The more chains there are the fewer sweeps of each their common mean needs, but R-hat of single
    chains asks of each that it is long, and of more that none of them differs. So of every four
    the first two belong to one group and the last two to the other, and a group counts as one
    long chain (after nested R-hat, Margossian et al. 2024). What differs within a group and not
    between them does not show: R-hat speaks of the means of groups, `ChainQuality.mcse` of all
    chains. Numbers of chains that are no multiple of four stay alone.

    Dispersed chains start from the live map and occupied in one group, free and from the prior in
    the other, so a start that is still there sets groups apart. Single cells alone need that. Of
    patches all starts are `forgotten`, of whatever kind they are: groups then differ by the draws
    of their chains, from what readings ask for on, and by nothing that is known beforehand.
    """
    n_chains, n_cells = len(halves) // 2, halves.shape[1]
    if not judged_in_groups(n_chains):
        return halves, 1
    means = halves.reshape(n_chains // TURNS, 2, TURNS // 2, 2, n_cells).mean(axis=(0, 2))
    return means.reshape(4, n_cells), n_chains // 2


def _errors(mean: Float64Array, ess: Float64Array) -> Float64Array:
    likely = (ess * mean + 2.0) / (ess + 4.0)
    errors: Float64Array = np.sqrt(likely * (1.0 - likely) / ess)
    return errors


def later_mean(chains: Sequence[BatchCounts]) -> Float32Array:
    """Return the mean (C,) of the later two thirds of chains, see `later_halves`."""
    half = _half(chains[0])
    total = np.zeros(chains[0].counts.shape[1])
    for chain in chains:
        total += chain.batches()[-2 * half :].sum(axis=0, dtype=np.uint32)
    total /= 2 * half * chains[0].batch_length * PARTS * len(chains)
    return total.astype(np.float32)


def later_halves(chains: Sequence[BatchCounts], cells: Int64Array) -> tuple[Float64Array, int]:
    """Return means (2 n, S) of two halves of the later two thirds of n chains, and their length.

    Of some `cells` (S,), all there are would take much memory. The chains are of equal length, of
    at least 3 full batches.
    """
    half = _half(chains[0])
    length = half * chains[0].batch_length
    means = np.empty((2 * len(chains), cells.size))
    for j, chain in enumerate(chains):
        rows = chain.batches()[-2 * half :, cells]
        means[2 * j] = rows[:half].sum(axis=0, dtype=np.int64)
        means[2 * j + 1] = rows[half:].sum(axis=0, dtype=np.int64)
    means /= length * PARTS
    return means, length


def _half(chain: BatchCounts) -> int:
    """Return half of the batches in the later two thirds of a chain."""
    return (chain.full - chain.full // 3) // 2


def agreeing_share(r_hat: Float32Array, limit: float) -> float:
    """Return the share of cells whose R-hat is below a limit; 1 without any cell."""
    return float(np.mean(r_hat < limit)) if r_hat.size else 1.0


def _quantile(values: Float32Array, share: float) -> float:
    """Return a quantile that is one of the values, some of which may be inf."""
    rank = min(int(share * values.size), values.size - 1)
    return float(np.partition(values, rank)[rank])

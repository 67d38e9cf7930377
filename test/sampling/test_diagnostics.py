"""What is said of chains, against formulas applied to the stored chains themselves."""

import tracemalloc

import numpy as np
import pytest
from support.strategies import fan

from ogm_mcmc.config import ForwardModelConfig, WindowConfig
from ogm_mcmc.geometry import PlacedScan, Pose2D
from ogm_mcmc.lab.exact import enumerate_maps
from ogm_mcmc.sampling import CellModel, PosteriorSampler, RayWindow, over_dispersed_starts
from ogm_mcmc.sampling.diagnostics import (
    BatchCounts,
    assess,
    later_halves,
    later_mean,
    split_r_hat,
)
from ogm_mcmc.sampling.gibbs_kernels import PARTS

approx = pytest.approx


def filled(draws):
    """Batch counts of a stored chain (n, C)."""
    counts = BatchCounts(draws.shape[1])
    for draw in draws:
        counts.row[:] += draw.astype(counts.counts.dtype) * PARTS
        counts.sweep_added()
    return counts


@pytest.mark.parametrize('n', [1, 2, 3, 15, 16, 17, 50, 131])
def test_recent_sweeps_are_the_later_half_in_whole_batches(n):
    draws = np.random.default_rng(n).integers(0, 2, (n, 5)).astype(np.uint8)
    counts = filled(draws)
    assert n / 2 <= counts.n_recent <= n / 2 + counts.batch_length
    assert counts.recent().tolist() == draws[n - counts.n_recent :].sum(axis=0).tolist()


@pytest.mark.parametrize('n', [3, 11, 16, 37, 198])
def test_later_halves_are_of_the_later_two_thirds_in_whole_batches(n):
    draws = np.random.default_rng(n).integers(0, 2, (2, n, 7)).astype(np.uint8)
    chains = [filled(of_chain) for of_chain in draws]
    whole = chains[0].full * chains[0].batch_length
    some = np.array([1, 4, 5])
    found, length = later_halves(chains, some)
    assert n / 4 < length <= n / 3 + chains[0].batch_length
    later = draws[:, whole - 2 * length : whole].reshape(4, length, 7).mean(axis=1)
    assert found == approx(later[:, some])
    assert later_mean(chains) == approx(later.mean(axis=0))


def test_a_look_at_chains_takes_little_memory():
    chains = [filled(np.zeros((3, 200_000), np.uint8)) for _ in range(3)]
    tracemalloc.start()
    later_mean(chains)
    later_halves(chains, np.arange(1000))
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most < 17 * 200_000  # bytes a cell, for whatever number of chains


def switching(rng, n, to_one, to_zero, n_cells=1):
    """Binary Markov chains (n, C): mean a / (a + b), lag-1 correlation 1 - a - b."""
    state = (rng.random(n_cells) < to_one / (to_one + to_zero)).astype(np.uint8)
    draws = np.empty((n, n_cells), np.uint8)
    for i in range(n):
        u = rng.random(n_cells)
        state = np.where(state == 1, u >= to_zero, u < to_one).astype(np.uint8)
        draws[i] = state
    return draws


def gelman_rubin(sequences):
    """R-hat of sequences (S, n) of draws, straight from the definition."""
    n = sequences.shape[1]
    within = np.mean([np.var(sequence, ddof=1) for sequence in sequences])
    between = n * np.var([np.mean(sequence) for sequence in sequences], ddof=1)
    return np.sqrt(((n - 1) / n * within + between / n) / within)


# -- counts ---------------------------------------------------------------------------------------


@pytest.mark.parametrize('n', [0, 1, 15, 16, 17, 40, 100, 1000])
def test_merging_keeps_totals(n):
    draws = (np.random.default_rng(n).random((n, 5)) < [0.0, 0.1, 0.5, 0.9, 1.0]).astype(np.uint8)
    counts = filled(draws)
    assert counts.n_sweeps == n
    assert counts.total().tolist() == draws.sum(axis=0, dtype=np.int64).tolist()
    # Each full batch is the sum of its own stretch of the chain.
    length = counts.batch_length
    batches = counts.batches() / PARTS
    assert batches.shape[0] == n // length < 16
    for b, batch in enumerate(batches):
        assert batch.tolist() == draws[b * length : (b + 1) * length].sum(axis=0).tolist()
    assert n < 16 or batches.shape[0] >= 8


def test_counts_do_not_overflow():
    """Batches as long as a uint16 can count, all of them full of ones."""
    counts = BatchCounts(2)
    counts.batch_length = 2**15 // PARTS
    counts.counts[:, 0] = 2**15
    counts.full, counts.in_last = 15, counts.batch_length - 1
    counts.counts[15, 0] -= PARTS
    counts.row[0] += PARTS
    counts.sweep_added()
    assert counts.batch_length == 2**16 // PARTS
    assert counts.total().tolist() == [2**19 / PARTS, 0]
    assert counts.batches()[:, 0].tolist() == [2**16] * 8
    counts.row[0] += PARTS
    counts.sweep_added()
    assert counts.n_sweeps == 2**19 // PARTS + 1
    assert counts.total()[0] == 2**19 / PARTS + 1


# -- R-hat ----------------------------------------------------------------------------------------


@pytest.mark.parametrize('n_chains', [1, 2, 3])
def test_r_hat_is_that_of_the_half_chains(n_chains):
    rng = np.random.default_rng(6)
    n = 64
    chains = [switching(rng, n, 0.1, 0.2, n_cells=30) for _ in range(n_chains)]
    quality = assess([filled(chain) for chain in chains])
    halves = np.array([half for chain in chains for half in (chain[: n // 2], chain[n // 2 :])])
    expected = [gelman_rubin(halves[:, :, c]) for c in range(30) if np.ptp(halves[:, :, c])]
    moving = [c for c in range(30) if np.ptp(halves[:, :, c])]
    assert len(moving) > 20
    assert quality.r_hat[moving] == approx(expected, rel=1e-5)


def test_r_hat_of_an_odd_number_of_batches_leaves_out_the_middle():
    chain = switching(np.random.default_rng(3), 36, 0.3, 0.4, n_cells=4)
    counts = filled(chain)
    assert (counts.full, counts.batch_length) == (9, 4)
    found = assess([counts]).r_hat
    halves = np.array([chain[:16], chain[20:36]])
    assert found == approx([gelman_rubin(halves[:, :, c]) for c in range(4)], rel=1e-5)


@pytest.mark.parametrize('n_chains', [4, 8, 5, 6])
def test_many_chains_are_judged_as_two_long_ones(n_chains):
    """Two of every four after the other, halves for themselves; other numbers as they are."""
    n = 64
    rng = np.random.default_rng(n_chains)
    chains = [switching(rng, n, 0.1, 0.2, n_cells=20) for _ in range(n_chains)]
    found = assess([filled(chain) for chain in chains]).r_hat
    grouped = n_chains % 4 == 0
    pairs = [chains[j : j + 2] for j in range(0, n_chains, 2)]
    groups = [[one] for one in chains]
    if grouped:
        groups = [[one for pair in pairs[j::2] for one in pair] for j in (0, 1)]
    halves = np.array(
        [
            np.concatenate([one[part] for one in group])
            for group in groups
            for part in (slice(0, n // 2), slice(n // 2, n))
        ]
    )
    length = halves.shape[1]
    assert length == n // 2 * (n_chains // 2 if grouped else 1)
    within = (halves.mean(axis=1) * (1.0 - halves.mean(axis=1))).mean(axis=0)
    within *= length / (length - 1.0)
    expected = np.sqrt((length - 1.0) / length + halves.mean(axis=1).var(axis=0, ddof=1) / within)
    assert found == approx(expected, rel=1e-5)


@pytest.mark.parametrize('n_chains', [4, 6, 8, 16])
@pytest.mark.parametrize('live', [0, 1])
def test_chains_that_never_leave_dispersed_starts_do_not_agree(n_chains, live):
    """But for cells where draws of the prior (0.2) make up for the occupied start."""
    cells = np.full(40, live, np.uint8)
    starts = over_dispersed_starts(
        'dispersed', n_chains, cells, 0.2, 1, free=np.zeros(cells.size, np.bool_)
    )
    quality = assess([filled(np.tile(start, (32, 1))) for start in starts])
    assert quality.agreeing_share(1.05) < 0.5


def test_chains_that_are_stuck():
    """Apart: no agreement whatsoever. Together: nothing to disagree about."""
    zeros, ones = np.zeros((64, 1), np.uint8), np.ones((64, 1), np.uint8)
    apart = assess([filled(zeros), filled(ones)])
    assert apart.r_hat.tolist() == [np.inf]
    assert apart.agreeing_share(1e9) == 0.0
    assert apart.mean == approx([0.5])
    # The means of the four half chains, 0, 0, 1 and 1, have a variance of 1/3: their mean 1/12.
    assert apart.ess == approx([3.0])
    assert apart.mcse == approx([0.5 / np.sqrt(3.0)])
    together = assess([filled(ones), filled(ones)])
    assert together.r_hat.tolist() == [1.0]
    assert together.mcse == approx([np.sqrt(2.0 / 132.0 * 130.0 / 132.0 / 128.0)])
    assert together.ess.tolist() == [128.0]
    assert together.agreeing_share(1.05) == 1.0
    moved_once = np.concatenate((zeros, ones))
    assert assess([filled(moved_once)]).r_hat.tolist() == [np.inf]


def test_chains_of_another_mean_disagree():
    rng = np.random.default_rng(1)
    apart = [(rng.random((512, 50)) < p).astype(np.uint8) for p in (0.2, 0.8)]
    assert assess([filled(chain) for chain in apart]).r_hat.min() > 1.2
    alike = [(rng.random((512, 50)) < 0.3).astype(np.uint8) for _ in range(2)]
    assert assess([filled(chain) for chain in alike]).r_hat.max() < 1.05


def test_r_hat_by_hand():
    """Means 1/4 and 3/4 of sequences of 4: W = 1/4, B/n = 1/8."""
    found = split_r_hat(np.array([[0.25], [0.75]]), 4)
    assert found == approx([np.sqrt(0.75 + 0.5)])


# -- effective samples and standard error ---------------------------------------------------------


@pytest.mark.parametrize(('to_one', 'to_zero'), [(0.5, 0.5), (0.05, 0.15), (0.02, 0.02)])
def test_effective_samples_of_chains_whose_correlation_is_known(to_one, to_zero):
    """Binary Markov chain: autocorrelation time (1 + r) / (1 - r) with r = 1 - a - b."""
    rng = np.random.default_rng(9)
    n, n_cells = 8192, 400
    chains = [switching(rng, n, to_one, to_zero, n_cells) for _ in range(2)]
    quality = assess([filled(chain) for chain in chains])
    r = 1.0 - to_one - to_zero
    expected = 2 * n * (1.0 - r) / (1.0 + r)
    # The larger of two estimates of a variance makes little of the draws, by 15 % in the median.
    assert 0.75 < np.median(quality.ess) / expected < 1.0
    p = to_one / (to_one + to_zero)
    assert 1.0 < np.median(quality.mcse) / np.sqrt(p * (1.0 - p) / expected) < 1.15
    # That is about the error there is.
    error = (quality.mean - p) / quality.mcse
    assert 0.8 < error.std() < 1.1
    assert abs(error.mean()) < 0.2
    assert (quality.sweeps, quality.chains) == (2 * n, 2)


@pytest.mark.parametrize('n', [16, 37, 64, 200])
def test_effective_samples_are_those_of_the_larger_variance(n):
    """From the definition: means of batches and of half chains, and the larger of two errors."""
    chains = [switching(np.random.default_rng(j), n, 0.1, 0.3, n_cells=40) for j in range(3)]
    counted = [filled(chain) for chain in chains]
    length, full = counted[0].batch_length, counted[0].full
    draws, half = length * full, full // 2 * length
    quality = assess(counted)
    for c in range(40):
        stored = [chain[:draws, c].astype(float) for chain in chains]
        batches = np.concatenate([chain.reshape(full, length).mean(axis=1) for chain in stored])
        halves = [part.mean() for chain in stored for part in (chain[:half], chain[-half:])]
        variance = max(np.var(batches, ddof=1) / batches.size, np.var(halves, ddof=1) / 6)
        mean, ess = np.mean(stored), 3.0 * draws
        if variance > 0.0:
            ess = np.clip(mean * (1.0 - mean) / variance, 1.0, 3.0 * draws)
        q = (ess * mean + 2.0) / (ess + 4.0)
        assert quality.mean[c] == approx(mean)
        assert quality.ess[c] == approx(ess, rel=1e-4)
        assert quality.mcse[c] == approx(np.sqrt(q * (1.0 - q) / ess), rel=1e-4)


def one_scan():
    """15 cells: free ones, walls, and those that nobody knows, all of which mix well."""
    return PlacedScan.at(fan(1.6, 1.1, increment=0.5, range_max_m=3.0), Pose2D(0.3, 0.4))


def between_two_cells():
    """Three readings between two cells: one is occupied, and seldom the other one instead."""
    return PlacedScan.at(
        fan(1.72, 1.72, 1.72, increment=0.001, range_max_m=3.0), Pose2D(0.3, 0.25)
    )


CLEAR = {'scan': one_scan, 'sigma': 0.15, 'prior': 0.15}
STICKY = {'scan': between_two_cells, 'sigma': 0.25, 'prior': 0.03}


@pytest.mark.parametrize(
    ('problem', 'sweeps', 'low', 'high', 'at_least'),
    [
        (CLEAR, 16, 0.0, 1.0, 0.94),
        (CLEAR, 64, 0.01, 0.99, 0.94),
        # An error of 0 where a cell never flipped would be right for 31 of 100.
        (CLEAR, 64, 0.0, 0.01, 0.98),
        # Correlated for more than half of the chain: the batches alone, 62 of 100.
        (STICKY, 64, 0.2, 0.8, 0.72),
    ],
)
def test_the_exact_mean_lies_within_two_standard_errors(problem, sweeps, low, high, at_least):
    """So often, among 150 seeds, of the cells whose exact probability is in some bounds."""
    window = RayWindow(
        WindowConfig(resolution=0.5, cut_sigma=0.0),
        ForwardModelConfig(sigma=problem['sigma'], clutter=0.02),
    )
    window.add([problem['scan']()])
    prior = float(np.log(problem['prior'] / (1.0 - problem['prior'])))
    exact = enumerate_maps(window.index, prior).marginals
    judged = (exact >= low) & (exact <= high)
    assert judged.sum() >= 2
    model = CellModel(window.index, prior, window.spec.width)
    starts = [np.full(model.n_cells, occupied, np.uint8) for occupied in (0, 1)]
    inside = []
    for seed in range(150):
        sampler = PosteriorSampler(model, starts, seed=seed, burn_in=20)
        sampler.advance(20 + sweeps)
        quality = sampler.quality()
        inside.append(np.abs(quality.mean - exact)[judged] <= 2.0 * quality.mcse[judged])
    assert np.mean(inside) >= at_least


def test_short_chains_are_not_judged():
    """Where a batch is one sweep nothing tells how much sweeps know of each other."""
    draws = np.random.default_rng(1).integers(0, 2, (15, 4)).astype(np.uint8)
    assert assess([filled(draws), filled(draws)]) is None
    assert assess([filled(np.zeros((16, 4), np.uint8))]) is not None


def test_summary():
    """Decided cells do not count for the effective samples; R-hat is a quantile of all."""
    rng = np.random.default_rng(2)
    open_cells = switching(rng, 1024, 0.1, 0.1, n_cells=9)
    decided = np.zeros((1024, 91), np.uint8)
    quality = assess([filled(np.hstack((open_cells, decided))) for _ in range(1)])
    summary = quality.summary()
    assert summary['undecided_cells'] == 9
    assert summary['ess_median'] == approx(float(np.median(quality.ess[:9])))
    assert summary['mcse_max'] == approx(float(quality.mcse[:9].max()))
    assert summary['r_hat_p99'] == float(np.sort(quality.r_hat)[99])
    assert quality.agreeing_share(1.001) >= 0.91


def test_summary_when_all_is_decided_or_nothing_is_there():
    quality = assess([filled(np.ones((32, 3), np.uint8))] * 2)
    assert quality.summary() == {
        'r_hat_p99': 1.0,
        'ess_median': 64.0,
        'mcse_max': approx(np.sqrt(2.0 / 68.0 * 66.0 / 68.0 / 64.0)),
        'undecided_cells': 0,
    }
    nothing = assess([filled(np.ones((32, 0), np.uint8))])
    assert nothing.agreeing_share(1.05) == 1.0
    assert nothing.summary()['r_hat_p99'] == 1.0

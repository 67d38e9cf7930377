"""What is said of chains, against formulas applied to the stored chains themselves."""

import numpy as np
import pytest

from ogm_mcmc.sampling.diagnostics import BatchCounts, assess, split_r_hat

approx = pytest.approx


def filled(draws):
    """Batch counts of a stored chain (n, C)."""
    counts = BatchCounts(draws.shape[1])
    for draw in draws:
        counts.row[:] += draw.astype(counts.counts.dtype)
        counts.sweep_added()
    return counts


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
    batches = counts.batches()
    assert batches.shape[0] == n // length < 16
    for b, batch in enumerate(batches):
        assert batch.tolist() == draws[b * length : (b + 1) * length].sum(axis=0).tolist()
    assert n < 16 or batches.shape[0] >= 8


def test_counts_do_not_overflow():
    """Batches as long as a uint16 can count, all of them full of ones."""
    counts = BatchCounts(2)
    counts.batch_length = 2**15
    counts.counts[:, 0] = 2**15
    counts.full, counts.in_last = 15, 2**15 - 1
    counts.counts[15, 0] -= 1
    counts.row[0] += 1
    counts.sweep_added()
    assert counts.batch_length == 2**16
    assert counts.total().tolist() == [2**19, 0]
    assert counts.batches()[:, 0].tolist() == [2**16] * 8
    counts.row[0] += 1
    counts.sweep_added()
    assert counts.n_sweeps == 2**19 + 1
    assert counts.total()[0] == 2**19 + 1


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


def test_chains_that_are_stuck():
    """Apart: no agreement whatsoever. Together: nothing to disagree about."""
    zeros, ones = np.zeros((64, 1), np.uint8), np.ones((64, 1), np.uint8)
    apart = assess([filled(zeros), filled(ones)])
    assert apart.r_hat.tolist() == [np.inf]
    assert apart.agreeing_share(1e9) == 0.0
    assert apart.mean == approx([0.5])
    together = assess([filled(ones), filled(ones)])
    assert together.r_hat.tolist() == [1.0]
    assert together.mcse.tolist() == [0.0]
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
    # Each estimate comes from 16 batches; their median lies within some per cent.
    assert np.median(quality.ess) == approx(expected, rel=0.12)
    p = to_one / (to_one + to_zero)
    assert np.median(quality.mcse) == approx(np.sqrt(p * (1.0 - p) / expected), rel=0.08)
    # That is the error there is.
    error = (quality.mean - p) / quality.mcse
    assert 0.85 < error.std() < 1.25
    assert abs(error.mean()) < 0.2
    assert (quality.sweeps, quality.chains) == (2 * n, 2)


def test_short_chains_are_not_judged():
    draws = np.random.default_rng(1).integers(0, 2, (3, 4)).astype(np.uint8)
    assert assess([filled(draws), filled(draws)]) is None
    assert assess([filled(np.zeros((4, 4), np.uint8))]) is not None


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
        'mcse_max': 0.0,
        'undecided_cells': 0,
    }
    nothing = assess([filled(np.ones((32, 0), np.uint8))])
    assert nothing.agreeing_share(1.05) == 1.0
    assert nothing.summary()['r_hat_p99'] == 1.0

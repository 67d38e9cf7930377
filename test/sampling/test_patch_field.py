"""The joint prior: conditionals against enumerated maps, the fit against its own optimum."""

import itertools
import math

import numpy as np
import pytest
from support import naive_patches

from ogm_mcmc.config import LearningConfig
from ogm_mcmc.errors import ConfigError
from ogm_mcmc.sampling.patch_field import (
    PatchField,
    cell_log_odds,
    conditional_log_odds,
    fit_field,
    log_joint,
    nats_per_cell,
)
from ogm_mcmc.sampling.patch_learning import count_map
from ogm_mcmc.sampling.patch_patterns import canonical, cells_of, images


@pytest.fixture(scope='module')
def field():
    """Any potentials will do, as long as nothing is alike by accident."""
    return PatchField(np.random.default_rng(1).normal(size=512))


def naive_log_joint(field, cells):
    height, width = cells.shape
    total = 0.0
    for row, column in itertools.product(range(height - 2), range(width - 2)):
        window = cells[row : row + 3, column : column + 3].tolist()
        total += field.potentials[naive_patches.number_of(tuple(map(tuple, window)))]
    return total


def test_conditionals_equal_the_enumerated_joint(field):
    """All 65 536 maps of 4 x 4 cells, every cell: edges and corners, too."""
    every = (np.arange(2**16)[:, None] >> np.arange(16)) & 1
    maps = every.reshape(-1, 4, 4).astype(np.uint8)
    joint = np.zeros(2**16)
    for row, column in itertools.product(range(2), range(2)):
        windows = maps[:, row : row + 3, column : column + 3].reshape(-1, 9)
        joint += field.potentials[windows @ (1 << np.arange(9))]
    for number in np.random.default_rng(2).integers(0, 2**16, 60).tolist():
        assert log_joint(field, maps[number]) == pytest.approx(joint[number], abs=1e-12)
        assert naive_log_joint(field, maps[number]) == pytest.approx(joint[number], abs=1e-12)
        for cell in range(16):
            expected = joint[number | 1 << cell] - joint[number & ~(1 << cell)]
            got = conditional_log_odds(field, maps[number], cell // 4, cell % 4)
            assert got == pytest.approx(expected, abs=1e-12)


def test_gibbs_steps_leave_the_joint_invariant(field):
    """pi P = pi for all maps of 3 x 4 cells, one cell after the other."""
    cells = 12
    maps = [cells_of(number, 4)[:3] for number in range(2**cells)]
    joint = np.exp([naive_log_joint(field, each) for each in maps])
    joint /= joint.sum()
    for cell in (0, 5, 11):
        after = np.zeros_like(joint)
        for number, each in enumerate(maps):
            log_odds = conditional_log_odds(field, each, cell // 4, cell % 4)
            occupied = 1.0 / (1.0 + math.exp(-log_odds))
            after[number | 1 << cell] += joint[number] * occupied
            after[number & ~(1 << cell)] += joint[number] * (1.0 - occupied)
        assert after == pytest.approx(joint, rel=1e-9)


def test_the_middle_of_a_square_has_all_nine_windows(field):
    squares = np.random.default_rng(3).integers(0, 2**25, 50)
    for square, log_odds in zip(squares.tolist(), cell_log_odds(field, squares), strict=True):
        cells = cells_of(square, 5)
        expected = conditional_log_odds(field, cells, 2, 2)
        assert log_odds == pytest.approx(expected, abs=1e-12)
        # Cells further away do not matter.
        wide = np.pad(cells, 2, constant_values=1)
        assert conditional_log_odds(field, wide, 4, 4) == pytest.approx(expected, abs=1e-12)


@pytest.fixture(scope='module')
def counts():
    return count_map(blobs(4), LearningConfig())


def blobs(seed):
    """Occupied where smoothed noise is high: cells that resemble their neighbours."""
    noise = np.random.default_rng(seed).normal(size=(44, 54))
    parts = [noise[r : r + 40, c : c + 50] for r in range(5) for c in range(5)]
    return (sum(parts) > 4.0).astype(np.int8)


def test_the_fit_is_the_maximum(counts):
    """Pseudo-likelihood with its penalty falls whichever class of patterns is changed."""
    penalty, names = 0.5, np.unique(canonical(np.arange(512), 3))
    classes = canonical(np.arange(512), 3)
    windows = counts.squares.windows.sum()

    def objective(potentials):
        squared = (potentials[names] ** 2).sum()
        return -windows * nats_per_cell(PatchField(potentials), counts) - penalty / 2 * squared

    best = fit_field(counts, penalty=penalty).potentials
    assert best[0] == 0.0
    assert np.array_equal(best, best[classes])
    top = objective(best)
    for name in names[1:].tolist():
        for change in (-0.01, 0.01):
            moved = best + change * (classes == name)
            assert objective(moved) < top


def test_conditionals_are_alike_for_images(counts):
    field = fit_field(counts)
    squares = np.random.default_rng(5).integers(0, 2**25, 40)
    here = cell_log_odds(field, squares)
    for turned in images(squares, 5):
        assert cell_log_odds(field, turned) == pytest.approx(here, abs=1e-9)


def test_nats_per_cell_one_by_one(counts):
    field = fit_field(counts)
    total, states = 0.0, blobs(4)
    for row, column in itertools.product(range(2, 38), range(2, 48)):
        log_odds = conditional_log_odds(field, states, row, column)
        total += math.log1p(math.exp(-log_odds if states[row, column] else log_odds))
    assert nats_per_cell(field, counts) == pytest.approx(total / (36 * 46), rel=1e-9)


def test_another_map_is_predicted_better_than_by_the_share_of_occupied_cells(counts):
    other = count_map(blobs(6), LearningConfig())
    p = counts.p_occupied
    alone = -other.p_occupied * math.log(p) - (1.0 - other.p_occupied) * math.log(1.0 - p)
    assert nats_per_cell(fit_field(counts), other) < 0.5 * alone


def test_without_a_penalty_nothing_is_fitted(counts):
    with pytest.raises(ConfigError, match=r'penalty is 0\.0'):
        fit_field(counts, penalty=0.0)

"""Maps and poses together: a tiny world in which every map and every pose can be counted."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from ogm_mcmc.config import ChainConfig, ForwardModelConfig, WindowConfig
from ogm_mcmc.errors import ConfigError, WindowError
from ogm_mcmc.geometry import CellBox, Pose2D, PoseBelief, Scan
from ogm_mcmc.sensors.forward_model import ForwardModel
from ogm_mcmc.trajectory.factors import PoseFactors
from ogm_mcmc.trajectory.joint_sampler import (
    JointPosterior,
    RigidStretches,
    ShareLadder,
    split_r_hat,
)
from ogm_mcmc.trajectory.moves import Moves
from ogm_mcmc.trajectory.points import wrapped

CELL, WIDTH, HEIGHT = 0.25, 5, 1
BOX = CellBox(0, 0, WIDTH, HEIGHT)
# Where either scan may be: at the rim of a cell, a step moves what its beam ends in.
PLACES = np.array([0.06, 0.19, 0.31])
READINGS = (0.8, 0.6)
MODEL = ForwardModelConfig(sigma=0.15, clutter=0.2, missing=0.05)
# Rays end in the box from every place.
WINDOW = WindowConfig(resolution=CELL, no_return='ignore', max_range=0.9, cut_sigma=0.0)
CHAIN = ChainConfig(prior=0.3)
REACH = 0.9
# Clutter and missing returns; the prior says little, so that all steps are visited.
LADDER = ShareLadder((0.05, 0.2, 0.45), seen_before=3.0)


class Jumps:
    """From any of the places to any of them."""

    def length(self, rng: np.random.Generator) -> int:
        return 1

    def moved(
        self, rng: np.random.Generator, poses: np.ndarray, stretch: np.ndarray
    ) -> np.ndarray:
        proposed = poses.copy()
        proposed[:, 0] = rng.choice(PLACES, len(poses))
        return proposed


def scan(reading: float) -> Scan:
    return Scan.checked(
        np.array([reading], np.float32),
        angle_min_rad=0.0,
        angle_increment_rad=0.1,
        range_min_m=0.0,
        range_max_m=5.0,
    )


def factors(*, with_move: bool) -> PoseFactors:
    beliefs = [
        PoseBelief(Pose2D(0.1, 0.1), np.diag([0.02, 0.01, 0.01])),
        PoseBelief(Pose2D(0.25, 0.1), np.diag([0.01, 0.01, 0.01])),
    ]
    moves = None
    if with_move:
        moves = Moves(
            np.array([0]), np.array([1]), np.array([(0.1, 0.0, 0.0)]),
            np.diag([60.0, 1.0, 1.0])[None], np.array([0]), 2.0,
        )  # fmt: skip
    return PoseFactors.of(beliefs, (1.0, 1.0, 1.0), moves)


def posterior(*, with_move: bool, ladder: ShareLadder | None = None) -> JointPosterior:
    return JointPosterior(
        [scan(reading) for reading in READINGS],
        factors(with_move=with_move),
        BOX,
        window=WINDOW,
        model=MODEL,
        chain=CHAIN,
        proposal=Jumps(),
        ladder=ladder,
    )


def first_hit(cells: tuple[int, ...], x: float) -> float:
    """Return the distance of the first occupied cell from x, half way through it, by hand."""
    for c in range(int(x / CELL), WIDTH):
        begin, end = max(c * CELL, x), min((c + 1) * CELL, x + REACH)
        if begin < end and cells[c]:
            return 0.5 * (begin - x + (c + 1) * CELL - x)
    return np.inf


def enumerated(known: PoseFactors) -> dict[tuple[tuple[int, ...], tuple[int, int]], float]:
    forward = ForwardModel.from_config(MODEL)
    weights = {}
    for cells in itertools.product((0, 1), repeat=WIDTH):
        for places in itertools.product(range(len(PLACES)), repeat=2):
            poses = np.array([(PLACES[place], 0.1, 0.0) for place in places])
            log_p = CHAIN.prior_log_odds * sum(cells) + known.log_density(poses)
            for pose, reading in zip(poses, READINGS, strict=True):
                hit = first_hit(cells, pose[0])
                log_p += forward.log_likelihood(float(np.float32(reading)), REACH, hit)
            weights[cells, places] = float(np.exp(log_p))
    total = sum(weights.values())
    return {state: weight / total for state, weight in weights.items()}


@pytest.mark.parametrize('with_move', [False, True])
def test_chains_visit_maps_and_poses_as_often_as_they_are_probable(with_move: bool) -> None:
    model, rng = posterior(with_move=with_move), np.random.default_rng(1)
    exact = enumerated(model.factors)
    poses = np.array([(PLACES[0], 0.1, 0.0), (PLACES[1], 0.1, 0.0)])
    state = model.start(np.zeros(WIDTH * HEIGHT, np.uint8), poses)
    rounds, places, cells = 1000, np.zeros((3, 3)), np.zeros(WIDTH)
    for now, _ in model.chain_of(rng, state, rounds):
        at = [int(np.argmin(np.abs(PLACES - x))) for x in now.poses[:, 0]]
        places[at[0], at[1]] += 1.0
        cells += now.cells
    expected_places, expected_cells = np.zeros((3, 3)), np.zeros(WIDTH)
    for (occupied, at_), p in exact.items():
        expected_places[at_] += p
        expected_cells += p * np.array(occupied)
    np.testing.assert_allclose(places / rounds, expected_places, atol=0.05)
    np.testing.assert_allclose(cells / rounds, expected_cells, atol=0.06)


@pytest.mark.parametrize('with_move', [False, True])
def test_ratios_of_moves_are_those_of_the_enumerated_posterior(with_move: bool) -> None:
    model, rng = posterior(with_move=with_move), np.random.default_rng(2)
    exact = enumerated(model.factors)
    states = list(exact)
    for k in rng.choice(len(states), 40):
        cells, places = states[k]
        other = (int(rng.integers(3)), places[1])
        one, two = (
            model.start(
                np.array(cells, np.uint8), np.array([(PLACES[at], 0.1, 0.0) for at in pair])
            )
            for pair in (places, other)
        )
        ratio = model._log_ratios(
            one, two.poses, two.log_likelihoods, np.array([0, 1]), np.array([True, False])
        )
        expected = np.log(exact[cells, other] / exact[cells, places])
        assert ratio[0] == pytest.approx(expected, abs=1e-5)
        assert model.log_posterior(two) - model.log_posterior(one) == pytest.approx(
            expected, abs=1e-5
        )


def test_what_a_state_says_of_its_scans_stays_true() -> None:
    model, rng = posterior(with_move=True), np.random.default_rng(3)
    state = model.start(np.zeros(WIDTH, np.uint8), model.factors.mean)
    for now, _ in model.chain_of(rng, state, 20):
        expected = model.log_likelihoods(now.cells, now.poses)
        np.testing.assert_allclose(now.log_likelihoods, expected, atol=1e-6)


def test_a_pose_whose_rays_leave_the_box_is_impossible() -> None:
    model = posterior(with_move=False)
    away = model.factors.mean + np.array([0.4, 0.0, 0.0])
    found = model.log_likelihoods(np.zeros(WIDTH, np.uint8), away)
    assert (found == -np.inf).all()


def test_rigid_stretches_go_back_as_they_came() -> None:
    rng, proposal = np.random.default_rng(4), RigidStretches(0.3, 0.5, (3,), (1.0,))
    poses = rng.normal(size=(7, 3))
    stretch = np.array([0, 0, 0, 1, 1, 1, 2])
    moved = proposal.moved(rng, poses, stretch)

    class Same:
        """The steps back: those that led there, with the other sign."""

        def __init__(self) -> None:
            middle = [moved[stretch == s].mean(axis=0) - poses[stretch == s].mean(axis=0)
                      for s in range(3)]  # fmt: skip
            turns = wrapped(moved - poses)[[0, 3, 6], 2]
            steps = np.column_stack((np.array(middle)[:, :2], turns))
            scale = np.array([0.3, 0.3, 0.5]) / np.sqrt([[3.0], [3.0], [1.0]])
            self.white = -steps / scale

        def standard_normal(self, shape: tuple[int, ...]) -> np.ndarray:
            return self.white

        def choice(self, values: tuple[float, ...]) -> float:
            return values[0]

    back = proposal.moved(Same(), moved, stretch)  # type: ignore[arg-type]
    np.testing.assert_allclose(wrapped(back - poses), 0.0, atol=1e-9)


def test_chains_that_differ_have_a_large_r_hat() -> None:
    rng = np.random.default_rng(5)
    draws = rng.normal(size=(2, 400, 2))
    draws[1, :, 1] += 3.0
    r_hat = split_r_hat(draws)
    assert r_hat[0] < 1.02
    assert r_hat[1] > 1.5


def test_what_cannot_be_sampled_is_refused() -> None:
    with pytest.raises(WindowError, match='expected to hold all rays'):
        JointPosterior(
            [scan(0.5)], PoseFactors.of([PoseBelief(Pose2D(0.5, 0.1))], (1, 1, 1)), BOX,
            window=WINDOW, model=MODEL, chain=CHAIN,
        )  # fmt: skip
    with pytest.raises(ConfigError, match='expected to rise'):
        ShareLadder((0.1, 0.1))
    with pytest.raises(ConfigError, match=r'expected below 0\.5'):
        ShareLadder((0.1, 0.5))
    with pytest.raises(ConfigError, match='expected at least 4'):
        split_r_hat(np.zeros((2, 3)))


def with_shares(
    known: PoseFactors,
) -> dict[tuple[tuple[int, ...], tuple[int, int], int, int], float]:
    """Enumerate maps, places of both scans, and steps of clutter and of missing."""
    weights = {}
    for steps in itertools.product(range(3), repeat=2):
        clutter, missing = (LADDER.values[step] for step in steps)
        forward = ForwardModel.from_config(replace(MODEL, clutter=clutter, missing=missing))
        prior = LADDER.log_priors()[list(steps)].sum()
        hits = {
            (x, reading, hit): forward.log_likelihood(float(np.float32(reading)), REACH, hit)
            for x in PLACES
            for reading in READINGS
            for hit in {first_hit(c, x) for c in itertools.product((0, 1), repeat=WIDTH)}
        }
        for cells in itertools.product((0, 1), repeat=WIDTH):
            for places in itertools.product(range(len(PLACES)), repeat=2):
                poses = np.array([(PLACES[place], 0.1, 0.0) for place in places])
                log_p = CHAIN.prior_log_odds * sum(cells) + known.log_density(poses) + prior
                for (x, _, _), reading in zip(poses, READINGS, strict=True):
                    log_p += hits[x, reading, first_hit(cells, x)]
                weights[cells, places, *steps] = float(np.exp(log_p))
    total = sum(weights.values())
    return {state: weight / total for state, weight in weights.items()}


def test_steps_of_sensor_shares_leave_the_enumerated_posterior_as_it_is(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Ratios are those of the enumerated posterior, and steps visit the ladder as it says."""
    model = posterior(with_move=True, ladder=LADDER)
    exact = with_shares(model.factors)
    rng = np.random.default_rng(6)
    states = sorted({key[:2] for key in exact})
    for k in rng.choice(len(states), 4):
        cells, places = states[k]
        poses = np.array([(PLACES[at], 0.1, 0.0) for at in places])
        grid = list(itertools.product(range(3), repeat=2))
        found = [
            model.log_posterior(model.start(np.array(cells, np.uint8), poses, steps))
            for steps in grid
        ]
        pi = np.array([exact[(cells, places, *steps)] for steps in grid])
        np.testing.assert_allclose(np.diff(found), np.diff(np.log(pi)), atol=1e-5)
    draws = 8000
    counts = np.zeros((3, 3))
    known = {steps: model.start(np.array(cells, np.uint8), poses, steps) for steps in grid}
    density = {steps: model.log_posterior(one) for steps, one in known.items()}
    monkeypatch.setattr(model, 'start', lambda cells, poses, steps: known[steps])
    monkeypatch.setattr(model, 'log_posterior', lambda state: density[state.shares])
    state = known[0, 2]
    for _ in range(draws):
        state = model.move_shares(rng, state)
        counts[state.shares] += 1.0 / draws
    np.testing.assert_allclose(counts, pi.reshape(3, 3) / pi.sum(), atol=0.05)


def test_shares_stay_where_they_are_given() -> None:
    model, rng = posterior(with_move=False), np.random.default_rng(7)
    state = model.start(np.zeros(WIDTH, np.uint8), model.factors.mean)
    assert model.move_shares(rng, state) is state
    assert model.model_at((2, 1)) == MODEL

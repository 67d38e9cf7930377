"""Maps and poses together: a tiny world in which every map and every pose can be counted."""

import itertools
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from ogm_mcmc.config import ChainConfig, ForwardModelConfig, WindowConfig
from ogm_mcmc.errors import ConfigError, WindowError
from ogm_mcmc.geometry import CellBox, Pose2D, PoseBelief, Scan
from ogm_mcmc.sensors.forward_model import ForwardModel
from ogm_mcmc.trajectory.alike import Alike
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
# Clutter and missing returns.
LADDER = ShareLadder((0.05, 0.2, 0.45), seen_before=3.0)
# Beta(1, 2) times half way to the neighbours on either side, by hand.
LADDER_PRIOR = (0.95 * 0.075, 0.8 * 0.2, 0.55 * 0.125)


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


def factors(*, with_move: bool, alike: bool = False) -> PoseFactors:
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
    found = PoseFactors.of(beliefs, (1.0, 1.0, 1.0), moves)
    if not alike:
        return found
    return found._replace(alike=Alike(np.array([0]), np.array([1]), np.full(3, 0.8), 0.05))


def posterior(
    *, with_move: bool, alike: bool = False, ladder: ShareLadder | None = None
) -> JointPosterior:
    return JointPosterior(
        [scan(reading) for reading in READINGS],
        factors(with_move=with_move, alike=alike),
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


NEIGHBOURS = pytest.mark.parametrize(
    ('with_move', 'alike'), [(False, False), (True, False), (False, True)]
)


@NEIGHBOURS
def test_chains_visit_maps_and_poses_as_often_as_they_are_probable(
    with_move: bool, alike: bool
) -> None:
    model = posterior(with_move=with_move, alike=alike)
    rng = np.random.default_rng(1)
    exact = enumerated(model.factors)
    poses = np.array([(PLACES[0], 0.1, 0.0), (PLACES[1], 0.1, 0.0)])
    state = model.start(np.zeros(WIDTH * HEIGHT, np.uint8), poses)
    rounds, places, cells = 1000, np.zeros((3, 3)), np.zeros(WIDTH)
    for _ in range(rounds):
        state, _ = model.advance(rng, state)
        at = [int(np.argmin(np.abs(PLACES - x))) for x in state.poses[:, 0]]
        places[at[0], at[1]] += 1.0
        cells += state.cells
    expected_places, expected_cells = np.zeros((3, 3)), np.zeros(WIDTH)
    for (occupied, at_), p in exact.items():
        expected_places[at_] += p
        expected_cells += p * np.array(occupied)
    np.testing.assert_allclose(places / rounds, expected_places, atol=0.05)
    np.testing.assert_allclose(cells / rounds, expected_cells, atol=0.06)


@NEIGHBOURS
def test_ratios_of_moves_are_those_of_the_enumerated_posterior(
    with_move: bool, alike: bool
) -> None:
    model = posterior(with_move=with_move, alike=alike)
    rng = np.random.default_rng(2)
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
    for _ in range(20):
        state, _ = model.advance(rng, state)
        expected = model.log_likelihoods(state.cells, state.poses)
        np.testing.assert_allclose(state.log_likelihoods, expected, atol=1e-6)


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
    of_places = {
        places: known.log_density(np.array([(PLACES[at], 0.1, 0.0) for at in places]))
        for places in itertools.product(range(len(PLACES)), repeat=2)
    }
    for steps in itertools.product(range(3), repeat=2):
        clutter, missing = (LADDER.values[step] for step in steps)
        forward = ForwardModel.from_config(replace(MODEL, clutter=clutter, missing=missing))
        prior = sum(np.log(LADDER_PRIOR[step]) for step in steps)
        hits = {
            (x, reading, hit): forward.log_likelihood(float(np.float32(reading)), REACH, hit)
            for x in PLACES
            for reading in READINGS
            for hit in {first_hit(c, x) for c in itertools.product((0, 1), repeat=WIDTH)}
        }
        for cells in itertools.product((0, 1), repeat=WIDTH):
            for places, of_poses in of_places.items():
                log_p = CHAIN.prior_log_odds * sum(cells) + of_poses + prior
                for x, reading in zip(PLACES[list(places)], READINGS, strict=True):
                    log_p += hits[x, reading, first_hit(cells, x)]
                weights[cells, places, *steps] = float(np.exp(log_p))
    total = sum(weights.values())
    return {state: weight / total for state, weight in weights.items()}


def test_a_value_of_the_ladder_stands_for_what_lies_half_way_to_its_neighbours() -> None:
    found = LADDER.log_priors()
    np.testing.assert_allclose(found - found[0], np.log(LADDER_PRIOR) - np.log(LADDER_PRIOR[0]))


GRID = list(itertools.product(range(3), repeat=2))  # steps of clutter, of missing


class Scripted:
    """Numbers that are drawn one after the other, all of them."""

    def __init__(self, numbers: list[float]) -> None:
        self.numbers = numbers

    def random(self) -> float:
        return self.numbers.pop(0)


def branches(
    start: tuple[int, int], weight: dict[tuple[int, int], float]
) -> Iterator[tuple[list[float], tuple[int, int], float]]:
    """Yield all that Metropolis steps of clutter, then of missing, can do, by hand.

    The numbers to draw for it, where it ends, and how probable it is. What decides lies within a
    thousandth of where the acceptance turns.
    """
    for ways in itertools.product((1, -1), repeat=2):
        paths: list[tuple[list[float], tuple[int, int], float]] = [([], start, 1.0)]
        for which, way in enumerate(ways):
            longer = []
            for numbers, at, p in paths:
                drawn = [*numbers, 0.4999 if way > 0 else 0.5]
                to = (at[0] + way, at[1]) if which == 0 else (at[0], at[1] + way)
                if to not in weight:
                    longer.append((drawn, at, 0.5 * p))
                    continue
                accepted = min(1.0, weight[to] / weight[at])
                longer.append(([*drawn, 1.0 - 0.999 * accepted], to, 0.5 * p * accepted))
                if accepted < 1.0:
                    refused = 1.0 - min(1.001 * accepted, 0.5 + 0.5 * accepted)
                    longer.append(([*drawn, refused], at, 0.5 * p * (1.0 - accepted)))
            paths = longer
        yield from paths


def test_steps_of_sensor_shares_leave_the_enumerated_posterior_as_it_is() -> None:
    """Ratios are those of the enumerated posterior, and pi P = pi of the steps, all of them."""
    model = posterior(with_move=True, ladder=LADDER)
    exact = with_shares(model.factors)
    rng = np.random.default_rng(6)
    states = sorted({key[:2] for key in exact})
    for k in rng.choice(len(states), 4):
        cells, places = states[k]
        poses = np.array([(PLACES[at], 0.1, 0.0) for at in places])
        known = [model.start(np.array(cells, np.uint8), poses, steps) for steps in GRID]
        pi = np.array([exact[(cells, places, *steps)] for steps in GRID])
        found = [model.log_posterior(one) for one in known]
        np.testing.assert_allclose(np.diff(found), np.diff(np.log(pi)), atol=1e-5)
    weight = dict(zip(GRID, pi, strict=True))
    transitions = np.zeros((9, 9))
    for row, one in enumerate(known):
        for numbers, end, p in branches(one.shares, weight):
            script = Scripted(list(numbers))
            moved = model.move_shares(script, one)  # type: ignore[arg-type]
            assert (moved.shares, script.numbers) == (end, [])
            transitions[row, GRID.index(moved.shares)] += p
    np.testing.assert_allclose(transitions.sum(axis=1), 1.0)
    np.testing.assert_allclose(pi @ transitions, pi)
    assert (np.linalg.matrix_power(transitions, 4) > 0.0).all()  # and come everywhere


def test_shares_stay_where_they_are_given() -> None:
    model, rng = posterior(with_move=False), np.random.default_rng(7)
    state = model.start(np.zeros(WIDTH, np.uint8), model.factors.mean)
    assert model.move_shares(rng, state) is state
    assert model.model_at((2, 1)) == MODEL

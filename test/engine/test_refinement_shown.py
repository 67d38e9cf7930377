"""The map of what was drawn, and what of it is shown."""

import math
from dataclasses import replace

import numpy as np
import pytest
from support.refinements import FIRST, SECOND, THIRD, lattice_map, maps, run, taken
from support.strategies import fan

from ogm_mcmc.config import (
    ChainConfig,
    ForwardModelConfig,
    PatchConfig,
    SamplerConfig,
    WindowConfig,
)
from ogm_mcmc.config.nodes import RefineSamplerConfig
from ogm_mcmc.engine.grazing import Grazing
from ogm_mcmc.engine.live_map import DOUBTED, live_map, reflection_map
from ogm_mcmc.engine.range_spread import Spread, blur_of
from ogm_mcmc.engine.refined_map import RefinedMap
from ogm_mcmc.engine.refinement import Refinement
from ogm_mcmc.engine.sensor_fit import SensorNumbers
from ogm_mcmc.geometry import PlacedScan, Pose2D
from ogm_mcmc.sampling.estimates import (
    hide_uncertain,
    with_neighbours,
    with_one_more_draw,
    with_share_of,
)
from ogm_mcmc.sampling.informed import known_cells
from ogm_mcmc.sampling.posterior import ARRIVES

approx = pytest.approx


def test_a_result_is_of_counted_sweeps_alone():
    """Shown while sampling goes on is the burn-in, too, and it says so."""
    refinement = taken(FIRST, SECOND, chains=2)
    sampler = refinement.sampler
    sampler.advance(10)
    found = []
    for _ in range(2):
        sampler.advance(1)
        found += [state.cells[sampler.model.touched] for state in sampler.states]
    mean = np.mean(found, axis=0).astype(np.float32)
    assert np.array_equal(sampler.estimate().mean, mean)
    spec = refinement.window.spec
    live = live_map([FIRST, SECOND], refinement.config.window).windowed(spec.box).probability

    def with_live(mean, draws):
        p = refinement.grid_map(mean).probability
        return np.where(np.isnan(live), p, (draws * p + live) / (draws + 1))

    present = sampler.present_estimate()
    assert (sampler.estimate().draws, present.draws) == (4, 14)
    assert not np.array_equal(present.mean, mean)
    for of, expected in ((None, with_live(mean, 4)), (present, with_live(present.mean, 14))):
        assert np.isfinite(expected).sum() == sampler.model.touched.size
        np.testing.assert_allclose(refinement.map(of).probability, expected, atol=1e-6)
        drawn = mean if of is None else of.mean
        assert np.array_equal(
            refinement.drawn_map(of).probability,
            refinement.grid_map(drawn).probability,
            equal_nan=True,
        )
        arrives = (sampler.arrival(drawn) >= ARRIVES).reshape(live.shape)
        drawn = refinement.grid_map(drawn).probability
        inside = known_cells(drawn, arrives, refinement.config.patch.margin)
        assert inside.sum() > 0
        known = np.where(inside, expected, math.nan)
        np.testing.assert_allclose(refinement.known_map(of).probability, known, atol=1e-6)


def test_cells_that_are_free_in_all_draws_are_in_the_order_of_the_live_map():
    refinement = taken(FIRST, SECOND, model={'sigma': 0.05, 'clutter': 1e-6})
    run(refinement, max_sweeps=30)
    estimate = refinement.sampler.estimate()
    spec, touched = refinement.window.spec, refinement.sampler.model.touched
    live = live_map([FIRST, SECOND], refinement.config.window).windowed(spec.box)
    known = live.probability.reshape(-1)[touched]
    tied = (estimate.mean == 0.0) & np.isfinite(known)
    found = refinement.map().probability.reshape(-1)[touched]
    assert np.unique(known[tied]).size > 1
    assert found[tied] == approx(known[tied] / (estimate.draws + 1))
    # Hidden is what would be if they were tied at zero.
    drawn, whole = refinement.drawn_map(), refinement.map()
    for draws in (3, 10, estimate.draws):
        before = hide_uncertain(drawn, 0.3, 0.02, draws).probability
        now = hide_uncertain(whole, 0.3, 0.02, draws, drawn).probability
        assert np.array_equal(np.isnan(before), np.isnan(now))
        assert np.array_equal(now, np.where(np.isnan(before), before, whole.probability), True)


def test_the_share_of_beams_that_a_cell_reflected_has_its_weight():
    of_draws, mixed = taken(FIRST, SECOND), taken(FIRST, SECOND, reflecting=0.1)
    for refinement in (of_draws, mixed):
        run(refinement, max_sweeps=12)
    plain, found = (one.map().probability for one in (of_draws, mixed))
    spec = mixed.window.spec
    counted = reflection_map([FIRST, SECOND], mixed.config.window, spec.box)
    blur = blur_of(mixed.beams.model.sigma, mixed.config.window.resolution)
    reflected, least = counted.share.probability, counted.least(blur).probability
    known = np.isfinite(reflected) & np.isfinite(plain)
    assert {0.0, 1.0} <= set(reflected[known])
    weight = np.where((reflected > 0.0) & (reflected < plain), 0.1 * blur, 0.1)
    expected = np.maximum((1.0 - weight) * plain + weight * reflected, least)
    assert found[known] == approx(expected[known], abs=1e-6)
    assert np.array_equal(found[~known], plain[~known], equal_nan=True)
    # Scans that come later have their share, too.
    mixed.take([FIRST, SECOND, THIRD])
    run(mixed, max_sweeps=12)
    assert np.isfinite(mixed.map().probability).sum() > np.isfinite(found).sum()


def test_neighbours_weigh_as_far_as_readings_may_be_of_them():
    refinement = taken(FIRST, SECOND)
    run(refinement, max_sweeps=12)
    drawn, cell_m = refinement.drawn_map(), refinement.config.window.resolution
    draws = refinement.sampler.estimate().draws

    def at(cells, neighbours):
        chain = replace(refinement.config.chain, neighbours=neighbours)
        refinement.config = replace(refinement.config, chain=chain)
        model = replace(refinement.beams.model, sigma=cells * cell_m)
        refinement.beams = refinement.beams._replace(model=model)
        return refinement.map().probability

    for cells, blur in ((0.5, 0.0), (0.6, 0.5), (0.7, 1.0)):
        smeared = with_neighbours(drawn, 0.1 * blur)
        expected = with_one_more_draw(smeared, refinement.guess, draws).probability
        np.testing.assert_allclose(at(cells, 0.1), expected, atol=1e-6)
        assert np.array_equal(at(cells, 0.1), at(cells, 0.0), True) == (blur == 0.0)


def test_a_cell_that_reflected_many_beams_has_no_less_than_their_share():
    """80 beams end in a cell that 100 pass: to a sampler, that readings err is likelier."""
    ends, passes = (PlacedScan.at(fan(r), Pose2D(0.05, 0.05)) for r in (1.0, 1.1))
    scans = [*[ends] * 80, *[passes] * 100]
    maps = []
    for reflecting in (0.0, 0.2):
        window, beams = {'resolution': 0.1}, {'sigma': 0.1, 'clutter': 0.01, 'missing': 0.01}
        refinement = taken(*scans, reflecting=reflecting, window=window, model=beams)
        run(refinement, max_sweeps=12)
        maps.append(refinement.map())
    column, row = maps[0].spec.cell_of(1.05, 0.05)
    without, found = (one.probability[row, column] for one in maps)
    assert without < 0.1
    assert found == approx(80.0 / (180.0 + DOUBTED))


def test_what_cells_reflected_leaves_draws_alone_where_cells_are_walls():
    """Beams say that surfaces are not off: the weight goes along with what draws do not know."""
    refinement = taken(FIRST, SECOND, reflecting=0.2)
    run(refinement, max_sweeps=12)
    spec, window = refinement.window.spec, refinement.config.window
    plain = with_one_more_draw(
        refinement.drawn_map(), refinement.guess, refinement.sampler.estimate().draws
    ).probability
    q = reflection_map([FIRST, SECOND], window, spec.box).share.probability
    least = reflection_map([FIRST, SECOND], window, spec.box).least(0.0).probability
    told = Grazing(Spread(0.0, 0.0, 150, 0.0, 0.0), 0.0)  # 150 readings, 50 before them
    refinement.beams = refinement.beams._replace(
        sensor=SensorNumbers(None, None, None, told),
        model=replace(refinement.beams.model, sigma=0.4 * window.resolution),
    )
    found = refinement.map().probability
    seen = np.isfinite(q) & np.isfinite(plain)
    assert seen.sum() > 10
    for p, share, at_least, is_now in zip(
        plain[seen].tolist(), q[seen].tolist(), least[seen].tolist(), found[seen], strict=True
    ):
        weight = 0.2 * (0.25 + 0.75 * 2.0 * math.sqrt(p * (1.0 - p)))
        mixed = p if 0.0 < share < p else (1.0 - weight) * p + weight * share
        assert is_now == approx(max(mixed, 0.25 * at_least), abs=1e-5)


@pytest.mark.filterwarnings('ignore:.*prior learned at')
def test_the_map_of_a_burn_in_is_made_as_that_of_counted_draws():
    refinement = Refinement(learned(reflecting=0.2))
    scans = [room()] * 3
    refinement.take(scans)
    window, spec = refinement.config.window, refinement.window.spec
    live = live_map(scans, window).windowed(spec.box).probability
    counted = reflection_map(scans, window, spec.box)
    reflected, least = counted.share.probability, counted.least(0.0).probability
    for sweeps, draws in ((0, 2), (1, 2), (4, 6)):
        refinement.sampler.advance(sweeps)
        of = refinement.sampler.present_estimate()
        assert (of.sweeps, of.draws) == (0, draws)
        p = refinement.drawn_map(of).probability
        p = np.where(np.isnan(live), p, (draws * p + live) / (draws + 1))
        mixes = (reflected > p) | (reflected == 0.0)
        p = np.fmax(np.where(mixes, 0.8 * p + 0.2 * reflected, p), least)
        found = refinement.map(of).probability
        seen = np.isfinite(found)
        assert found[seen] == approx(p[seen], abs=1e-6)
    assert np.array_equal(refinement.guess.probability, live, equal_nan=True)


@pytest.mark.filterwarnings('ignore:.*prior learned at')
def test_the_first_map_is_there_after_one_sweep_and_as_crisp_as_later_ones():
    refinement = Refinement(learned())
    refinement.take([room()])
    shown = []
    for sweeps in (1, 99):
        refinement.sampler.advance(sweeps)
        of = refinement.sampler.present_estimate()
        known, drawn = refinement.known_map(of), refinement.drawn_map(of)
        handed = RefinedMap(
            1, known, drawn, refinement.prior, of.draws, 1, 0, final=False, guess=refinement.guess
        )
        shown.append(np.isfinite(handed.shown(0.02).probability))
        without = np.isfinite(handed._replace(guess=None).shown(0.02).probability)
    # Draws enough; but walls that the live map has, too, need not be as sure as free space is.
    more = shown[1] & ~without
    assert (without <= shown[1]).all()
    assert (refinement.guess.probability[more] > 0.5).all()
    assert shown[0].sum() > 0.9 * shown[1].sum()
    assert (shown[0] & ~shown[1]).sum() < 0.01 * shown[1].sum()


def test_few_draws_show_what_another_map_of_the_same_beams_says_too():
    drawn = lattice_map([[0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 0.5, 0.5]])
    guess = lattice_map([[0.1, 0.9, math.nan, 0.9, 0.1, math.nan, 0.0, 1.0]])
    mixed = lattice_map([[0.1, 0.2, 0.3, 0.9, 0.8, 0.7, 0.4, 0.6]])
    shown = hide_uncertain(mixed, 0.3, 0.02, 2, drawn, guess).probability[0]
    assert np.isfinite(shown).tolist() == [True, False, False, True, False, False, False, False]
    assert shown[[0, 3]] == approx([0.1, 0.9])
    assert np.isnan(hide_uncertain(mixed, 0.3, 0.02, 2, drawn).probability).all()
    # Nine draws tell by themselves.
    nine = [hide_uncertain(mixed, 0.3, 0.02, 9, drawn, *more) for more in ((), (guess,))]
    assert np.array_equal(nine[0].probability, nine[1].probability, equal_nan=True)
    assert np.isfinite(nine[0].probability[0, :6]).all()


@pytest.mark.parametrize(('prior', 'margin', 'least'), [(0.3, 0.02, 0.52), (0.6, 0.1, 0.7)])
def test_a_wall_that_the_live_map_has_is_shown_when_most_draws_have_it(prior, margin, least):
    p = least + np.array([-0.01, 0.01])
    drawn = lattice_map([[*p, *p, *p]])
    guess = lattice_map([[0.9, 0.9, 0.4, 0.4, math.nan, math.nan]])
    shown = np.isfinite(hide_uncertain(drawn, prior, margin, 100, drawn, guess).probability[0])
    assert shown.tolist() == [False, True, False, False, False, False]
    assert not np.isfinite(hide_uncertain(drawn, prior, margin, 100, drawn).probability).any()


def test_cells_no_more_certain_than_the_prior_are_hidden():
    grid = lattice_map([[0.2, 0.19, 0.81, 0.5, math.nan, 0.0, 0.14, 0.86]])
    shown = hide_uncertain(grid, prior=0.2, margin=0.05).probability[0]
    assert np.isnan(shown).tolist() == [True] * 5 + [False] * 3
    assert shown[5:] == approx([0.0, 0.14, 0.86])
    shown = hide_uncertain(grid, prior=0.8, margin=0.0).probability[0]
    assert np.isnan(shown).tolist() == [True, False, False, True, True, False, False, False]


@pytest.mark.parametrize(('prior', 'draws'), [(0.31, 16), (0.31, 32), (0.05, 64), (0.15, 99)])
def test_what_all_draws_show_is_shown_whatever_a_cell_reflected(prior, draws):
    """Walls that half of the beams passed, and free cells that reflected half of them."""
    drawn = lattice_map([[1.0, 1.0, 1.0, 0.0, 0.0, 0.0, prior, math.nan]])
    reflected = lattice_map([[0.0, 0.3, 0.5, 0.0, 0.3, 0.5, 1.0, 0.5]])
    mixed = with_share_of(drawn, reflected, 0.2)
    handed = RefinedMap(1, mixed, drawn, prior, draws, 1, 0, final=True)
    shown = handed.shown(0.02).probability[0]
    assert shown[:6] == approx([0.8, 0.86, 0.9, 0.0, 0.06, 0.1])
    assert np.isnan(shown[6:]).all()


def room(reach_m=2.0):
    """Scans in the middle of a square room whose walls are thin lines, seen from inside only."""
    bearings = np.arange(126) * 0.05 - 1.0
    far = np.maximum(np.abs(np.cos(bearings)), np.abs(np.sin(bearings)))
    scan = fan(*(reach_m / far), bearing=-1.0, increment=0.05, range_max_m=8.0)
    return PlacedScan.at(scan, Pose2D(0.02, 0.03))


def learned(**chain):
    return SamplerConfig(
        model=ForwardModelConfig(sigma=0.05),
        window=WindowConfig(resolution=0.1),
        chain=ChainConfig(**{'burn_in': 10, **chain}),
        patch=PatchConfig(prior='border', size=9),
    )


@pytest.mark.filterwarnings('ignore:.*prior learned at')
def test_a_refined_room_has_no_fur():
    """Known are the inside and the surface of its walls; nothing beyond, and every side of it.

    But for one seed of sixty, in which a pocket of three cells opens behind a wall.
    """
    refinement = Refinement(learned(seed=2))
    refinement.take([room()])
    run(refinement, max_sweeps=100)
    known = refinement.known_map()
    spec = known.spec
    rows, columns = np.indices(known.probability.shape)
    x = (columns + spec.column0 + 0.5) * 0.1 - 0.02
    y = (rows + spec.row0 + 0.5) * 0.1 - 0.03
    out = np.maximum(np.abs(x), np.abs(y))
    shown = np.isfinite(known.probability)
    assert not shown[out > 2.25].any()
    assert shown[(out < 1.9)].all()
    assert (known.probability[out < 1.8] < 0.2).all()
    assert shown.sum() < np.isfinite(refinement.map().probability).sum()


def hall(beams=8, side_m=8.0):
    """Scans of few beams in an empty square hall that begins at the origin."""
    placed = []
    places = ((2.05, 2.05), (6.05, 2.05), (2.05, 6.05), (6.05, 6.05), (4.05, 4.05))
    for number, (x, y) in enumerate(places):
        first, step = 0.1 + 0.2 * number, 2.0 * math.pi / beams
        bearings = first + step * np.arange(beams)
        ahead, aside = np.cos(bearings), np.sin(bearings)
        far = np.minimum(
            np.where(ahead > 0.0, side_m - x, -x) / ahead,
            np.where(aside > 0.0, side_m - y, -y) / aside,
        )
        placed.append(
            PlacedScan.at(fan(*far, bearing=first, increment=step), Pose2D(x, y)),
        )
    return placed


@pytest.mark.filterwarnings('ignore:.*prior learned at')
def test_space_between_few_beams_does_not_fill_with_specks():
    """Nothing stands in the hall: were patches not told apart, 5 % would be occupied by then."""
    config = RefineSamplerConfig()
    refinement = Refinement(
        replace(config, window=replace(config.window, resolution=0.1, no_return='ignore'))
    )
    refinement.take(hall())
    run(refinement, max_sweeps=200)
    inside = [
        sum(5 <= column < 75 and 5 <= row < 75 for column, row in cells)
        for cells in maps(refinement)
    ]
    assert max(inside) < 0.02 * 70 * 70


@pytest.mark.filterwarnings('ignore:.*prior learned at')
@pytest.mark.parametrize('start', ['free', 'occupied', 'live'])
def test_the_map_is_the_same_from_any_start(start):
    found = []
    for kind in ('dispersed', start):
        refinement = Refinement(learned(start=kind))
        refinement.take([room()])
        run(refinement, max_sweeps=150)
        found.append(refinement.known_map().probability)
    both = np.isfinite(found[0]) & np.isfinite(found[1])
    assert both.sum() > 0.95 * max(np.isfinite(p).sum() for p in found)
    assert np.abs(found[0] - found[1])[both].mean() < 0.01

"""Where chains start: from maps of before, a map that is given, or the live map."""

import math
from dataclasses import replace

import numpy as np
import pytest
from support.refinements import FIRST, SECOND, THIRD, lattice_map, maps, run, settings, taken
from support.strategies import fan

from ogm_mcmc.config import (
    ChainConfig,
    ForwardModelConfig,
    PatchConfig,
    SamplerConfig,
    StopConfig,
    WindowConfig,
)
from ogm_mcmc.engine.live_map import live_map
from ogm_mcmc.engine.no_returns import NoReturnChoice, NoReturns
from ogm_mcmc.engine.refinement import WARM_BURN_IN, Refinement
from ogm_mcmc.errors import GridError
from ogm_mcmc.geometry import PlacedScan, Pose2D, PoseBelief


def copied(scan):
    return PlacedScan(replace(scan.scan), scan.belief)


@pytest.mark.parametrize('scans', [[FIRST, SECOND, THIRD], [THIRD, FIRST]])
def test_a_warm_start_begins_with_the_last_maps(scans):
    refinement = taken(FIRST)
    run(refinement, max_sweeps=40)
    before = maps(refinement)
    assert before[0] != before[1] or before[0]
    refinement.take(scans)
    assert refinement.sampler.sweeps == 0
    spec = refinement.window.spec
    touched = {
        (k % spec.width + spec.column0, k // spec.width + spec.row0)
        for k in refinement.sampler.model.touched.tolist()
    }
    assert maps(refinement) == [cells & touched for cells in before]


def test_what_scans_newly_tell_of_begins_free_not_as_the_solid_around_patches():
    patch = PatchConfig(prior='uniform', size=9, margin=1)
    refinement = Refinement(replace(settings(), patch=patch))
    refinement.take([FIRST, THIRD])
    before, box = cells_of(refinement), refinement.window.spec.box
    refinement.take([FIRST, THIRD, SECOND])
    assert refinement.window.spec.box == box
    new = cells_of(refinement) - before
    assert new
    assert all(not cells & new for cells in maps(refinement))


def cells_of(refinement):
    """Return columns and rows on the lattice of the cells that are drawn."""
    spec, cells = refinement.window.spec, refinement.sampler.model.touched
    return {(k % spec.width + spec.column0, k // spec.width + spec.row0) for k in cells.tolist()}


def test_taking_the_same_again_draws_other_numbers():
    """Else every round would follow the last one's path, and what it adds would be nothing."""
    refinement = taken(FIRST, SECOND)
    runs = []
    for _ in range(3):
        refinement.sampler.states = [
            refinement.sampler.model.start(np.zeros(refinement.sampler.model.n_cells, np.uint8))
            for _ in refinement.sampler.states
        ]
        refinement.sampler.advance(30)
        runs.append(refinement.sampler.estimate().mean.tolist())
        refinement.take([FIRST, SECOND])
    assert runs[0] != runs[1]
    assert runs[1] != runs[2]
    assert runs[0] != runs[2]


def test_a_start_map_is_thresholded_where_it_lies():
    """A map of other bounds on the same lattice, nan in it."""
    grid = lattice_map([[0.9, 0.4], [math.nan, 0.6]], column0=1, row0=0)
    refinement = taken(FIRST, start=grid, start_threshold=0.6, prior=0.1)
    spec = refinement.window.spec
    sampled = {
        (k % spec.width + spec.column0, k // spec.width + spec.row0)
        for k in refinement.sampler.model.touched.tolist()
    }
    for cells in maps(refinement):
        # float32(0.6) is above 0.6.
        assert cells == {(1, 0), (2, 1)} & sampled
    assert {(1, 0)} <= sampled


@pytest.mark.parametrize(
    'other', [{'resolution_m': 0.25}, {'anchor_x_m': 0.1}, {'anchor_y_m': -0.25}]
)
@pytest.mark.parametrize('warm', [False, True])
def test_a_start_map_of_another_lattice_is_refused_before_anything_changes(other, warm):
    refinement = Refinement(settings())
    if warm:
        refinement.take([FIRST])
    before = refinement.window, refinement.window.index, refinement.sampler
    with pytest.raises(GridError, match=r'start map with cells of .* expected 0.5 m at'):
        refinement.take([FIRST, SECOND], lattice_map([[0.5]], **other))
    assert (refinement.window, refinement.window.index, refinement.sampler) == before
    assert refinement.settings()['scans'] == (1 if warm else 0)
    assert refinement.take([FIRST, SECOND]) == 7


def test_a_start_map_is_where_chains_begin_that_were_elsewhere():
    """Whoever names a start means it; the numbers drawn are new ones all the same."""
    refinement = taken(FIRST)
    first = refinement.sampler.rngs[0].bit_generator.state
    run(refinement, max_sweeps=40)
    before = maps(refinement)
    refinement.take([FIRST, SECOND], lattice_map([[0.0, 0.9]]))
    assert maps(refinement) == [{(1, 0)}] * 2
    assert before != [{(1, 0)}] * 2
    assert refinement.sampler.rngs[0].bit_generator.state != first
    assert refinement.sampler.sweeps == 0


def test_chains_start_from_the_live_map():
    grid = live_map([FIRST, SECOND], settings().window)
    rows, columns = np.nonzero(grid.probability >= 0.5)
    expected = set(zip(columns + grid.spec.column0, rows + grid.spec.row0, strict=True))
    assert len(expected) > 2
    refinement = Refinement(settings(start='live', chains=3, prior=0.2))
    refinement.take([FIRST, SECOND])
    assert maps(refinement) == [expected] * 3


@pytest.mark.filterwarnings('ignore:.*prior learned at')
def test_readings_behind_a_surface_are_where_chains_begin_solid():
    """A wall that most beams end at, and a few 0.3 m behind it."""
    circle = {'bearing': 0.0, 'increment': math.pi / 20.0}
    near, far = fan(*[2.0] * 40, **circle), fan(*[2.3] * 40, **circle)
    scans = [PlacedScan.at(scan, Pose2D(0.02, 0.03)) for scan in (near, near, near, far)]
    refinement = Refinement(
        SamplerConfig(
            model=ForwardModelConfig(sigma=0.05),
            window=WindowConfig(resolution=0.1),
            chain=ChainConfig(chains=2, start='free'),
            patch=PatchConfig(prior='border', size=9),
        )
    )
    refinement.take(scans)
    assert refinement.sampler.may_end  # what is forgotten is no start that is the same for all
    sampler, spec = refinement.sampler, refinement.window.spec
    drawn = np.array([state.cells for state in sampler.states])
    mean = drawn.mean(axis=0, dtype=np.float32)
    arrives = sampler.model.arrival(mean, 0.5) >= 0.5
    live = live_map(scans, refinement.config.window).windowed(spec.box)
    ended = live.probability.reshape(-1) >= 0.5
    assert (ended & ~arrives)[sampler.model.touched].sum() > 10
    assert drawn[:, ended & ~arrives].all()


def test_beams_that_are_left_out_are_in_no_part_of_a_map():
    """Neither in the start, nor as one more draw, nor in what cells reflected."""
    found = []
    for scans, stride in (([FIRST, SECOND], 2), ([one.thinned(2) for one in (FIRST, SECOND)], 1)):
        config = settings({'beam_stride': stride}, start='live', chains=2, reflecting=0.5)
        refinement = Refinement(config)
        refinement.take(scans)
        starts = maps(refinement)
        run(refinement, max_sweeps=12)
        found.append((starts, refinement.map()))
    assert found[0][0] == found[1][0]
    assert found[0][1].spec == found[1][1].spec
    assert np.array_equal(found[0][1].probability, found[1][1].probability, equal_nan=True)


@pytest.mark.parametrize(
    'patch',
    [PatchConfig(), pytest.param(PatchConfig(prior='uniform', size=9), marks=pytest.mark.jit)],
    ids=['cells', 'patches'],
)
def test_chains_begin_anew_where_scans_were_placed_anew_and_go_on_elsewhere(patch):
    """Two rooms, of which one turns out to lie 0.6 m aside."""
    config = SamplerConfig(
        model=ForwardModelConfig(sigma=0.05),
        window=WindowConfig(resolution=0.2),
        chain=ChainConfig(chains=2, burn_in=0),
        patch=patch,
    )
    circle = {'bearing': 0.0, 'increment': math.pi / 20.0}
    scans = [
        PlacedScan.at(fan(*[2.0] * 40, **circle), Pose2D(x + 0.05 * k, 0.0))
        for x in (0.0, 20.0)
        for k in range(5)
    ]
    refinement = Refinement(config)
    refinement.take(scans)
    assert not refinement.corrected
    list(refinement.run(StopConfig(max_sweeps=30)))
    before, old = list(refinement.sampler.states), refinement.window.spec
    placed = [
        one if one.pose.x_m < 10.0 else PlacedScan.at(one.scan, Pose2D(one.pose.x_m + 0.6, 0.0))
        for one in scans
    ]
    refinement.take(placed)
    assert refinement.corrected
    new, fresh = refinement.window.spec, Refinement(config)
    fresh.take(placed)
    middle = 50 - new.column0
    for now, state, first in zip(
        refinement.sampler.states, before, fresh.sampler.states, strict=True
    ):
        is_now, was = (c.reshape(new.height, -1) for c in (now.cells, state.cells))
        begins = first.cells.reshape(new.height, -1)
        assert np.array_equal(is_now[:, :middle], was[:, : 50 - old.column0])
        assert not np.array_equal(is_now[:, :middle], begins[:, :middle])
        # Patches forget their start by draws, here of fewer cells.
        share = np.mean(is_now[:, middle:] != begins[:, middle:])
        assert share <= (0.0 if patch.size == 1 else 0.1)


def test_all_begins_anew_where_wrong_poses_told_of_a_wrong_sensor(monkeypatch):
    """Whichever scans moved; as every scan is known the burn-in is short all the same."""
    here, there = [FIRST] * 5, [PlacedScan.at(FIRST.scan, Pose2D(20.0, 0.0)) for _ in range(4)]
    refinement = taken(*here, *there, burn_in=30)
    run(refinement, max_sweeps=31)
    wrong = replace(refinement.beams.model, sigma=1.5 * refinement.beams.model.sigma)
    placed = [*here, *(PlacedScan.at(one.scan, Pose2D(20.6, 0.0)) for one in there)]
    monkeypatch.setattr('ogm_mcmc.engine.beams_found.fit_sensor', lambda *args: (wrong, None))
    refinement.take(placed)
    assert refinement.sampler.burn_in == WARM_BURN_IN
    fresh = taken(*placed, burn_in=30)
    for now, first in zip(refinement.sampler.states, fresh.sampler.states, strict=True):
        assert np.array_equal(now.cells, first.cells)


def test_chains_that_go_on_with_a_few_more_scans_count_soon():
    """Once their burn-in is behind them, placed anew or not; not from a map that is given."""
    many = [FIRST] * 9
    refinement = taken(*many, burn_in=30)

    def burn_in_with(scans, start=None):
        refinement.take(scans, start)
        return refinement.sampler.burn_in

    assert burn_in_with([*many, SECOND]) == 30  # none was counted yet
    run(refinement, max_sweeps=31)
    assert burn_in_with([*many, SECOND, THIRD]) == WARM_BURN_IN
    run(refinement, max_sweeps=31)
    assert burn_in_with([*many, *map(copied, (SECOND, THIRD))]) == 30  # more than a few
    run(refinement, max_sweeps=31)
    assert burn_in_with(many, refinement.map()) == 30
    run(refinement, max_sweeps=31)
    assert burn_in_with(many[:5]) == WARM_BURN_IN
    run(refinement, max_sweeps=31)
    anew = [PlacedScan(FIRST.scan, PoseBelief(Pose2D(0.7, -0.4)))] * 5
    assert burn_in_with(anew) == WARM_BURN_IN  # placed anew, but known


def test_a_window_of_other_scans_burns_in_however_many_they_are():
    """New scans are told by what they are: a full window lets as many go as come."""
    many = [copied(FIRST) for _ in range(20)]
    refinement = taken(*many, burn_in=30)
    for replaced, expected in ((2, WARM_BURN_IN), (3, 30), (20, 30)):
        run(refinement, max_sweeps=31)
        many = many[replaced:] + [copied(FIRST) for _ in range(replaced)]
        refinement.take(many)
        assert refinement.sampler.burn_in == expected
    run(refinement, max_sweeps=31)
    # Placed anew by less than rounding: the same scans.
    refinement.take([PlacedScan(one.scan, one.belief.carried_to(one.pose)) for one in many])
    assert refinement.sampler.burn_in == WARM_BURN_IN


@pytest.mark.parametrize('changed', ['no_return', 'model'])
def test_chains_burn_in_where_scans_mean_another_thing(monkeypatch, changed):
    many = [FIRST] * 9
    refinement = taken(*many, burn_in=30)
    run(refinement, max_sweeps=31)
    if changed == 'no_return':
        other = NoReturnChoice('ignore', 'auto', NoReturns(100, 90))
        assert refinement.beams.no_return.value != other.value
        monkeypatch.setattr('ogm_mcmc.engine.refinement.no_return_of', lambda *args: other)
    else:
        fitted = ForwardModelConfig(sigma=0.2)
        monkeypatch.setattr('ogm_mcmc.engine.beams_found.fit_sensor', lambda *args: (fitted, None))
    refinement.take(many[:8])
    assert refinement.sampler.burn_in == 30


def test_shares_that_are_fitted_anew_are_no_other_thing(monkeypatch):
    many = [FIRST] * 9
    refinement = taken(*many, burn_in=30)
    run(refinement, max_sweeps=31)
    sigma = 1.04 * refinement.beams.model.sigma
    fitted = replace(refinement.beams.model, sigma=sigma, clutter=0.011, missing=0.02)
    monkeypatch.setattr('ogm_mcmc.engine.beams_found.fit_sensor', lambda *args: (fitted, None))
    refinement.take(many[:8])
    assert refinement.beams.model.clutter == 0.011
    assert refinement.sampler.burn_in == WARM_BURN_IN


def test_chains_go_on_where_joint_poses_moved_all_scans_by_next_to_nothing():
    """With every scan that comes all others are placed a little differently."""
    many = [copied(FIRST) for _ in range(10)]
    refinement = taken(*many, burn_in=30)
    run(refinement, max_sweeps=31)
    for step, corrected in ((1e-6, False), (0.3, True)):
        pose = Pose2D(FIRST.pose.x_m + step, FIRST.pose.y_m, FIRST.pose.yaw_rad)
        refinement.take([PlacedScan(one.scan, one.belief.carried_to(pose)) for one in many])
        assert refinement.corrected == corrected
        assert refinement.sampler.burn_in == (30 if corrected else WARM_BURN_IN)


@pytest.mark.parametrize(
    ('chain', 'apart'),
    [
        ({}, True),
        ({'burn_in': 39}, False),
        ({'chains': 1}, False),
        *(({'start': kind}, False) for kind in ('live', 'occupied', 'free', 'prior')),
    ],
)
def test_a_burn_in_may_end_early_where_chains_started_as_far_apart_as_can_be(chain, apart):
    of_chain = {'burn_in': 40, 'chains': 2, 'start': 'dispersed', **chain}
    refinement = Refinement(settings(**of_chain))
    refinement.take([FIRST])
    assert refinement.sampler.may_end == apart


def test_burn_ins_of_chains_from_a_map_or_that_go_on_are_done_whole():
    """The map is the same for all, and chains that agreed before are no longer apart."""
    refinement = taken(FIRST, burn_in=40)
    assert refinement.sampler.may_end
    refinement.take([FIRST, SECOND])
    assert not refinement.sampler.may_end
    assert not taken(FIRST, burn_in=40, start=lattice_map([[0.9, 0.4]])).sampler.may_end

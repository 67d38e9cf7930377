"""Scans in, posterior mean out: what is taken, what is refused, when it stops."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from support.strategies import fan

from ogm_mcmc.config import (
    ChainConfig,
    ForwardModelConfig,
    KeepConfig,
    PatchConfig,
    RecordingConfig,
    SamplerConfig,
    StopConfig,
    WindowConfig,
)
from ogm_mcmc.config.nodes import NodeWindowConfig, RefineSamplerConfig
from ogm_mcmc.engine.refinement import Recording, Refinement, hide_uncertain, live_map
from ogm_mcmc.errors import ConfigError, GridError, WindowError
from ogm_mcmc.geometry import GridMap, GridSpec, PlacedScan, Pose2D, PoseBelief
from ogm_mcmc.lab.exact import enumerate_maps
from ogm_mcmc.sampling import PosteriorSampler, RayWindow
from ogm_mcmc.sampling.informed import known_cells
from ogm_mcmc.sampling.posterior import ARRIVES

approx = pytest.approx

S = 1_000_000_000


def scan_at(x, y, *ranges, yaw=0.0, stamp_ns=0):
    scan = fan(*ranges, bearing=-1.0, increment=0.5, range_max_m=4.0, stamp_ns=stamp_ns)
    return PlacedScan(scan, PoseBelief(Pose2D(x, y, yaw)))


FIRST = scan_at(0.13, 0.22, 1.1, 1.6, 2.3, math.inf)
SECOND = scan_at(0.63, -0.42, 1.0, math.inf, 1.3, yaw=1.2)
THIRD = scan_at(-2.3, 1.4, 2.1, 2.2, 1.9, yaw=-2.0)
FAR = scan_at(40000.0, 40000.0, 1.0, 2.0)
NOTHING = scan_at(50.0, 50.0, math.nan, -1.0, 0.0)


def settings(window=None, model=None, **chain):
    return SamplerConfig(
        model=ForwardModelConfig(**{'sigma': 0.3, 'clutter': 0.2, **(model or {})}),
        window=WindowConfig(**{'resolution': 0.5, **(window or {})}),
        chain=ChainConfig(**{'burn_in': 10, **chain}),
    )


def taken(*scans, start=None, **changes):
    refinement = Refinement(settings(**changes))
    refinement.take(list(scans), start)
    return refinement


def run(refinement, **stop):
    return list(refinement.run(StopConfig(**{'max_time': 60.0, 'r_hat': 0.0, **stop})))


def maps(refinement):
    """Every chain's map as the set of occupied lattice cells."""
    spec = refinement.window.spec
    found = []
    for state in refinement.sampler.states:
        rows, columns = np.nonzero(state.cells.reshape(spec.height, spec.width))
        found.append(set(zip(columns + spec.column0, rows + spec.row0, strict=True)))
    return found


def lattice_map(values, column0=0, row0=0, **spec):
    probability = np.array(values, np.float32)
    height, width = probability.shape
    where = {'width': width, 'height': height, 'column0': column0, 'row0': row0}
    return GridMap(GridSpec(**{'resolution_m': 0.5, **where, **spec}), probability)


# -- scans in -------------------------------------------------------------------------------------


def test_rays_of_all_scans_are_counted():
    refinement = Refinement(settings())
    assert refinement.take([FIRST]) == 4
    assert refinement.take([FIRST, SECOND]) == 7
    assert refinement.take([FIRST, SECOND, NOTHING]) == 7
    assert refinement.take([SECOND]) == 3


def test_scans_that_came_in_extend_the_window():
    """The same posterior as of all scans at once, with the old rays left where they are."""
    refinement = taken(FIRST)
    window = refinement.window
    refinement.take([FIRST, SECOND, THIRD])
    assert refinement.window is window
    whole = taken(FIRST, SECOND, THIRD).window
    assert window.spec == whole.spec
    for name in ('rays', 'lists', 'near', 'front', 'runs'):
        assert np.array_equal(getattr(window.index, name), getattr(whole.index, name)), name


@pytest.mark.parametrize(
    'patch',
    [PatchConfig(), PatchConfig(prior='uniform', size=9, margin=2)],
    ids=['cells', 'patches'],
)
def test_a_window_that_grew_draws_what_one_built_at_once_draws(patch):
    config = replace(settings(), patch=patch)
    grown, whole = Refinement(config), Refinement(config)
    scans = [FIRST, SECOND, NOTHING, THIRD, FIRST]
    for count in (1, 2, 5):
        grown.take(scans[:count])
    whole.take(scans)
    assert grown.window.spec == whole.window.spec
    draws = []
    for refinement in (grown, whole):
        model = refinement.sampler.model
        sampler = PosteriorSampler(
            model, [np.zeros(model.n_cells, np.uint8)] * 2, seed=3, burn_in=4
        )
        sampler.advance(20)
        cells = [state.cells.tolist() for state in sampler.states]
        draws.append((model.touched.tolist(), model.telling.tolist(), cells))
    assert draws[0] == draws[1]
    assert 0 < sum(draws[0][2][0]) < len(draws[0][2][0])


def test_beams_of_a_robot_that_stands_are_merged_and_counted():
    """In a window that grows, too: the same cells, so that a saved state fits."""
    again = scan_at(0.13, 0.22, 1.0, 1.5, 2.3, 2.0)
    grown, whole = taken(FIRST), taken(FIRST, again, SECOND)
    assert grown.size.n_merged == 0
    assert grown.take([FIRST, again, SECOND]) == whole.size.n_rays == 11
    assert (grown.size.n_merged, whole.size.n_merged) == (3, 4)
    assert whole.window.index.n_rays == 11 - 4
    assert grown.sampler.model.touched.tolist() == whole.sampler.model.touched.tolist()


def test_scans_that_went_build_the_window_anew():
    refinement = taken(FIRST, SECOND)
    refinement.take([SECOND, THIRD])
    assert refinement.window.spec == taken(SECOND, THIRD).window.spec
    assert refinement.window.index.n_rays == 6


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


def test_nothing_to_sample_is_refused():
    refinement = Refinement(settings())
    with pytest.raises(WindowError, match='no scan was recorded: expected at least one'):
        refinement.take([])
    with pytest.raises(WindowError, match='no beam of 2 scans says anything: nothing to sample'):
        refinement.take([NOTHING, NOTHING])
    with pytest.raises(WindowError, match='no scan was taken: nothing to sample'):
        run(refinement)
    with pytest.raises(WindowError, match='nothing was sampled yet: no map'):
        refinement.map()
    assert refinement.take([NOTHING, FIRST]) == 4


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
        arrives = (sampler.arrival(mean if of is None else of.mean) >= ARRIVES).reshape(live.shape)
        inside = known_cells(expected, arrives, refinement.config.patch.margin)
        assert inside.sum() > 0
        known = np.where(inside, expected, math.nan)
        np.testing.assert_allclose(refinement.known_map(of).probability, known, atol=1e-6)


@pytest.mark.parametrize('extends', [True, False])
def test_too_much_is_refused_and_sampling_can_go_on(extends):
    far = scan_at(4000.0, 4000.0, 1.0, 2.0)  # a window of many cells
    refinement = taken(FIRST, window={'max_memory_mb': 1.0})
    run(refinement, max_sweeps=30)
    before = refinement.window.index, refinement.sampler, refinement.window.spec
    arrays = [array.copy() for array in refinement.window.index]
    mean = refinement.map().probability.copy()
    with pytest.raises(WindowError, match='expected at most max_memory_mb = 1'):
        refinement.take([FIRST, far] if extends else [SECOND, far])
    assert (refinement.window.index, refinement.sampler, refinement.window.spec) == before
    for a, b in zip(arrays, refinement.window.index, strict=True):
        assert np.array_equal(a, b)
    assert np.array_equal(refinement.map().probability, mean, equal_nan=True)
    run(refinement, max_sweeps=30)
    assert refinement.take([FIRST, SECOND]) == 7


# -- starts ---------------------------------------------------------------------------------------


def test_what_no_return_means_is_seen_in_the_scans():
    """Every other beam on a wall is lost; decided anew where rays are indexed anew."""
    lost = [
        scan_at(0.1 * k, 0.0, *((2.0, math.inf) * 10 if k % 2 else (math.inf, 2.0) * 10), yaw=0.5)
        for k in range(8)
    ]
    refinement = Refinement(replace(settings(), window=NodeWindowConfig(0.5)))
    refinement.take(lost)
    assert refinement.no_return.value == 'ignore'
    assert refinement.no_return.found.doubtful
    assert refinement.window.index.n_rays == 80
    assert refinement.settings()['window.no_return'] == 'ignore'
    with pytest.raises(WindowError):
        refinement.take([NOTHING])
    assert refinement.no_return.value == 'ignore'  # as before: nothing was taken
    with pytest.raises(WindowError):
        refinement.take([*lost, FAR])
    assert refinement.window.index.n_rays == 80
    refinement.take([FIRST, SECOND])
    assert refinement.no_return.value == 'ignore'  # two beams do not tell
    assert refinement.window.index.n_rays == 8 - 3


def before_a_wall(k, losing):
    """Beams without a return past a wall; or beams at it, every other of which is lost."""
    if not losing:
        return scan_at(0.1 * k, 0.0, *(2.0, 2.0, 2.0, *[math.inf] * 9), yaw=0.5)
    return scan_at(0.1 * k, 0.0, *((2.0, math.inf) * 10 if k % 2 else (math.inf, 2.0) * 10))


def test_a_window_that_grows_means_what_one_taken_at_once_means(tmp_path):
    """Too few beams, then clear, then ignore; a state that was saved fits after a restart."""
    first = [before_a_wall(k, losing=False) for k in range(4)]
    scans = [*first, *(before_a_wall(k, losing=True) for k in range(12))]
    chosen = replace(settings(), window=NodeWindowConfig(0.5))
    grown, found = Refinement(chosen), []
    for count in (1, 4, 8, 16):
        if grown.sampler is not None:
            run(grown, max_sweeps=20)
            before = maps(grown)
        grown.take(scans[:count])
        found.append(grown.no_return.value)
        whole = Refinement(chosen)
        whole.take(scans[:count])
        assert grown.no_return == whole.no_return
        assert grown.settings() == whole.settings()
        assert grown.window.spec == whole.window.spec
        for name in ('rays', 'lists', 'near', 'front', 'runs'):
            ours, theirs = (getattr(one.window.index, name) for one in (grown, whole))
            assert np.array_equal(ours, theirs), (name, count)
        if count > 1:  # warm
            spec = grown.window.spec
            cells = {
                (k % spec.width + spec.column0, k // spec.width + spec.row0)
                for k in grown.sampler.model.touched.tolist()
            }
            assert maps(grown) == [one & cells for one in before]
    assert (found[0], found[1], found[-1]) == ('ignore', 'clear', 'ignore')
    run(grown, max_sweeps=20)
    grown.save(tmp_path / 'state')
    whole.resume(tmp_path / 'state')
    assert maps(whole) == maps(grown)


@pytest.mark.parametrize('extends', [True, False])
@pytest.mark.parametrize('where', ['posterior_model', 'PosteriorSampler'])
def test_what_fails_after_indexing_leaves_something_to_go_on_with(monkeypatch, extends, where):
    refinement = taken(FIRST)
    run(refinement, max_sweeps=20)
    before = refinement.window, refinement.sampler, maps(refinement)

    def fails(*_, **__):
        raise MemoryError

    with monkeypatch.context() as patched:
        patched.setattr(f'ogm_mcmc.engine.refinement.{where}', fails)
        with pytest.raises(MemoryError):
            refinement.take([FIRST, SECOND] if extends else [SECOND])
    if extends:  # the index is no longer that of the chains
        assert refinement.sampler is None
        assert not refinement.holds([FIRST])
    else:
        assert (refinement.window, refinement.sampler, maps(refinement)) == before
        assert refinement.holds([FIRST])
        run(refinement, max_sweeps=20)
    assert refinement.take([FIRST, SECOND, THIRD]) == taken(FIRST, SECOND, THIRD).size.n_rays
    run(refinement, max_sweeps=20)


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


# -- sampling -------------------------------------------------------------------------------------


def test_the_same_seed_gives_the_same_map_however_long_rounds_take(monkeypatch):
    found = []
    for round_s in (0.0, 0.001, 10.0):
        monkeypatch.setattr(PosteriorSampler, 'round_s', round_s)
        refinement = taken(FIRST, SECOND)
        assert run(refinement, max_sweeps=120)[-1].sweeps == 120
        found.append(refinement.map().probability)
    assert np.array_equal(found[0], found[1], equal_nan=True)
    assert np.array_equal(found[0], found[2], equal_nan=True)
    other = taken(FIRST, SECOND, seed=2)
    run(other, max_sweeps=120)
    assert not np.array_equal(other.map().probability, found[0], equal_nan=True)


def test_the_map_is_that_of_the_exact_posterior():
    """And nan where no ray ever came."""
    scan = scan_at(0.13, 0.22, 1.1, 1.6)
    config = settings(window={'resolution': 1.0}, model={'sigma': 0.8}, prior=0.3)
    refinement = Refinement(config)
    refinement.take([scan])
    run(refinement, max_sweeps=3000)
    window = RayWindow(config.window, config.model)
    window.add([scan])
    exact = enumerate_maps(window.index, config.chain.prior_log_odds)
    found = refinement.map()
    assert found.spec == window.spec
    flat = found.probability.reshape(-1)
    assert np.flatnonzero(~np.isnan(flat)).tolist() == exact.touched.tolist()
    assert flat[exact.touched] == approx(exact.marginals, abs=0.05)
    assert refinement.settings()['chain.prior'] == 0.3
    assert refinement.settings()['scans'] == 1


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
    # Hidden is what was hidden when they were tied at zero.
    plain = GridMap(spec, refinement.grid_map(estimate.mean).probability)
    for draws in (3, 10, estimate.draws):
        before, now = (hide_uncertain(one, 0.3, 0.02, draws) for one in (plain, refinement.map()))
        free = plain.probability == 0.0
        assert np.array_equal(np.isnan(before.probability)[free], np.isnan(now.probability)[free])


def test_sweeps_as_reason():
    progress = run(taken(FIRST), max_sweeps=77)
    last = progress[-1]
    assert (last.reason, last.sweeps, last.counted) == ('sweeps', 77, 67)
    assert [p.reason for p in progress[:-1]] == [''] * (len(progress) - 1)
    assert sum(p.sweeps < 77 for p in progress) == len(progress) - 1


def test_time_as_reason():
    last = run(taken(FIRST), max_sweeps=10**9, max_time=0.3)[-1]
    assert last.reason == 'time'
    assert 0.3 <= last.seconds < 3.0
    assert last.sweeps_per_s == approx(last.sweeps / last.seconds, rel=0.05)


def test_cancelled_as_reason():
    refinement = taken(FIRST)
    asked = []

    def cancelled():
        asked.append(1)
        return len(asked) == 3

    progress = list(refinement.run(StopConfig(max_sweeps=10**9, r_hat=0.0), cancelled))
    assert (progress[-1].reason, len(progress)) == ('cancelled', 3)
    assert np.isfinite(refinement.map().probability).any()


def test_converged_as_reason():
    refinement = taken(FIRST, SECOND)
    stop = StopConfig(max_sweeps=10**6, r_hat=1.05, agreeing_share=0.99)
    last = list(refinement.run(stop))[-1]
    assert last.reason == 'converged'
    assert last.counted >= 64
    assert last.agreeing_share >= 0.99
    assert refinement.quality.agreeing_share(1.05) == last.agreeing_share
    assert last.ess_median > 1.0
    assert 0.0 < last.mcse_max < 0.5


def test_limits_that_contradict_each_other_are_refused_at_once():
    refinement = taken(FIRST, burn_in=100)
    with pytest.raises(ConfigError, match=r'max_sweeps is 100: expected more than burn_in \(100'):
        refinement.run(StopConfig(max_sweeps=100))
    assert refinement.sampler.sweeps == 0
    run(refinement, max_sweeps=101)
    # The burn-in is over: what comes counts.
    assert run(refinement, max_sweeps=5)[-1].counted == 6


def test_progress_is_plain_json():
    """Strictly so: a parser need not know of Infinity."""
    progress = run(taken(FIRST, burn_in=2), max_sweeps=4)[-1]
    assert progress.r_hat_p99 == math.inf  # not known yet
    values = json.loads(json.dumps(progress.as_dict(), allow_nan=False))
    assert values['r_hat_p99'] is None
    assert values['sweeps'] == 4
    assert values['reason'] == 'sweeps'


# -- what is shown --------------------------------------------------------------------------------


def test_cells_no_more_certain_than_the_prior_are_hidden():
    grid = lattice_map([[0.2, 0.19, 0.81, 0.5, math.nan, 0.0, 0.14, 0.86]])
    shown = hide_uncertain(grid, prior=0.2, margin=0.05).probability[0]
    assert np.isnan(shown).tolist() == [True] * 5 + [False] * 3
    assert shown[5:] == approx([0.0, 0.14, 0.86])
    shown = hide_uncertain(grid, prior=0.8, margin=0.0).probability[0]
    assert np.isnan(shown).tolist() == [True, False, False, True, True, False, False, False]


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
    """Known are the inside and the surface of its walls; nothing beyond, and every side of it."""
    refinement = Refinement(learned())
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


# -- recording ------------------------------------------------------------------------------------


def stamped(seconds, beams=2):
    return scan_at(0.0, 0.0, *[1.0] * beams, stamp_ns=round(seconds * S))


def recorded(scans, **limits):
    recording = Recording(RecordingConfig(KeepConfig(keep='latest'), **limits))
    for scan in scans:
        recording.add(scan)
    return recording


def test_the_oldest_scans_go_when_there_are_too_many():
    scans = [stamped(i) for i in range(5)]
    recording = recorded(scans, max_scans=3)
    assert recording.snapshot() == scans[2:]
    assert (len(recording), recording.n_rays) == (3, 6)


def test_the_oldest_scans_go_when_they_have_too_many_rays():
    scans = [stamped(i, beams=3) for i in range(5)]
    recording = recorded(scans, max_rays=7)
    assert recording.snapshot() == scans[3:]
    assert recording.n_rays == 6
    # The newest is kept whatever its size.
    large = stamped(9, beams=50)
    recording.add(large)
    assert recording.snapshot() == [large]


def test_scans_that_are_too_old_go():
    scans = [stamped(s) for s in (0.0, 1.0, 5.0, 10.0)]
    assert recorded(scans, max_seconds=5.0).snapshot() == scans[2:]
    assert recorded(scans, max_seconds=0.0).snapshot() == scans


def test_a_snapshot_stays_as_it_is():
    recording = recorded([FIRST])
    snapshot = recording.snapshot()
    recording.add(SECOND)
    assert snapshot == [FIRST]
    recording.clear()
    assert (len(recording), recording.n_rays, recording.snapshot()) == (0, 0, [])


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


def test_chains_that_go_on_with_a_few_more_scans_count_soon():
    """Once their burn-in is behind them; not where scans moved, nor from a map that is given."""
    many = [FIRST] * 9
    refinement = taken(*many, burn_in=30)

    def burn_in_with(scans, start=None):
        refinement.take(scans, start)
        return refinement.sampler.burn_in

    assert burn_in_with([*many, SECOND]) == 30  # none was counted yet
    run(refinement, max_sweeps=31)
    assert burn_in_with([*many, SECOND, THIRD]) == 10
    run(refinement, max_sweeps=31)
    assert burn_in_with([*many, SECOND, THIRD, SECOND, THIRD]) == 30  # more than a few
    run(refinement, max_sweeps=31)
    assert burn_in_with(many, refinement.map()) == 30
    run(refinement, max_sweeps=31)
    assert burn_in_with(many[:5]) == 10
    run(refinement, max_sweeps=31)
    assert burn_in_with([PlacedScan(FIRST.scan, PoseBelief(Pose2D(0.7, -0.4)))] * 5) == 30

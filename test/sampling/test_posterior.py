"""Chains side by side: repeatable, and looking most where there is doubt."""

import threading

import numpy as np
import pytest
from support.small_chains import LoneCells, assert_same, sampler_of, small_model
from support.strategies import fan

from ogm_mcmc.config import ForwardModelConfig, WindowConfig
from ogm_mcmc.engine.prior_files import default_prior_file, load_prior
from ogm_mcmc.errors import ConfigError
from ogm_mcmc.geometry import CellBox, PlacedScan, Pose2D
from ogm_mcmc.sampling import PosteriorSampler, RayWindow, over_dispersed_starts
from ogm_mcmc.sampling.burn_in import POWERS
from ogm_mcmc.sampling.chain_starts import forgotten
from ogm_mcmc.sampling.patch_gibbs import PatchModel
from ogm_mcmc.sampling.patch_places import DULL_TURNS
from ogm_mcmc.sampling.patch_prior import make_table

approx = pytest.approx


# -- repeatable -----------------------------------------------------------------------------------


@pytest.mark.parametrize('order', ['fixed', 'random'])
def test_same_seed_same_result_however_sweeps_are_asked_for(order):
    model = small_model(order)
    at_once, one_by_one, others = (sampler_of(model) for _ in range(3))
    flips = at_once.advance(60)
    assert flips == sum(one_by_one.advance(1) for _ in range(60))
    for n in (3, 0, 40, 17):
        others.advance(n)
    assert_same(at_once, one_by_one)
    assert_same(at_once, others)
    assert at_once.counted == 55
    another = sampler_of(model, seed=8)
    another.advance(60)
    assert not np.array_equal(another.estimate().mean, at_once.estimate().mean)


def test_threads_make_no_difference():
    """A chain draws the same alone, beside others, and while the processor is busy."""
    model = small_model()
    both = sampler_of(model, chains=4)
    stop = threading.Event()

    def keep_busy():
        while not stop.is_set():
            sum(range(100))

    busy = threading.Thread(target=keep_busy)
    busy.start()
    both.advance(30)
    stop.set()
    busy.join()
    in_turn = sampler_of(model, chains=4)
    for chain in (2, 0, 3, 1):
        in_turn._advance_one(chain, 30)
    in_turn.sweeps = 30
    assert_same(both, in_turn)
    # And chains differ from each other.
    assert len({state.cells.tobytes() for state in both.states}) > 1


def assert_mean_of(estimate, maps):
    assert estimate.mean == approx(np.mean(maps, axis=(0, 1)), abs=1e-6)
    assert estimate.draws == 2 * len(maps)


def test_mean_is_that_of_the_counted_maps():
    model = small_model()
    sampler = sampler_of(model, burn_in=4)
    maps = []
    for _ in range(25):
        sampler.advance(1)
        maps.append([state.cells[model.touched] for state in sampler.states])
        # Results are of what counts; until there is any, of the later half of the burn-in.
        burnt = {1: maps[:1], 2: maps[1:2], 3: maps[1:3], 4: maps[2:4]}
        assert_mean_of(sampler.estimate(), burnt.get(sampler.sweeps, maps[4:]))
        # What is shown meanwhile is of that half until enough sweeps count.
        shown = {**burnt, 5: maps[2:5]}.get(sampler.sweeps, maps[4:])
        assert_mean_of(sampler.present_estimate(), shown)
    assert sampler.estimate().sweeps == sampler.counted == 21
    assert sampler.log_likelihoods() == [model.log_likelihood(state) for state in sampler.states]


def test_thinned_maps_are_those_of_the_chains():
    model = small_model()
    sampler, twin = sampler_of(model), sampler_of(model)
    drawn = list(sampler.draw_maps(5, thin=3))
    expected = []
    for _ in range(3):
        twin.advance(3)
        expected += [state.cells.copy() for state in twin.states]
    assert [m.tolist() for m in drawn] == [m.tolist() for m in expected[:5]]
    with pytest.raises(ConfigError, match='thin is 0: expected at least 1'):
        list(sampler.draw_maps(1, thin=0))


def test_memory_is_reported():
    model = small_model()
    sampler = sampler_of(model, chains=3)
    n_rays, n_touched = model.index.n_rays, model.touched.size
    counts = 16 * 2 * n_touched
    states = (1 + 8) * model.n_cells + (16 + 32) * n_rays  # with log-odds that are kept
    assert sampler.n_bytes == 3 * (states + 2 * counts)
    sampler.advance(5 + 16)  # enough sweeps count, those of the burn-in are not needed any more
    assert sampler.n_bytes == 3 * (states + counts)


# -- starts ---------------------------------------------------------------------------------------


def starts_of(kind, n_chains=5, n_cells=400, live=None, free=None):
    nothing = np.zeros(n_cells, np.uint8)
    return over_dispersed_starts(
        kind,
        n_chains,
        nothing if live is None else live,
        0.25,
        1,
        nothing != 0 if free is None else free,
    )


def test_dispersed_starts_are_far_apart_but_for_free_cells():
    live = (np.arange(400) % 7 == 0).astype(np.uint8)
    free = (np.arange(400) < 100) & (live == 0)
    starts = starts_of('dispersed', live=live, free=free)
    assert np.array_equal(starts[0], live)
    assert np.array_equal(starts[1], ~free)
    assert not starts[2].any()
    assert not starts[3][free].any()
    assert 0.15 < starts[3][~free].mean() < 0.35
    assert np.array_equal(starts[4], live)
    starts[0][:] = 9
    assert live.max() == 1  # a copy


@pytest.mark.parametrize(
    ('kind', 'mean'), [('free', 0.0), ('occupied', 1.0), ('prior', 0.25), ('live', 0.0)]
)
def test_starts_of_one_kind(kind, mean):
    free = np.arange(2000) < 700  # of no matter to these
    starts = starts_of(kind, 2, 2000, free=free)
    for start in starts:
        assert start.dtype == np.uint8
        assert start.mean() == approx(mean, abs=0.04)
    again = starts_of(kind, 2, 2000)
    assert [s.tolist() for s in again] == [s.tolist() for s in starts]
    if kind == 'prior':
        assert not np.array_equal(starts[0], starts[1])


def blocked_room(beams=120):
    """A room seen from its middle by many beams, and a prior that holds blocks together."""
    window = RayWindow(
        WindowConfig(resolution=0.2), ForwardModelConfig(sigma=0.1), limits=CellBox(0, 0, 40, 30)
    )
    scan = fan(*[2.1] * beams, bearing=0.0, increment=6.0 / beams, range_max_m=6.0)
    window.add([PlacedScan.at(scan, Pose2D(4.03, 3.02, 0.0))])
    counts = load_prior(default_prior_file(), 0.05).counts
    return PatchModel(window.index, 40, make_table('border', 9, counts), margin=3)


def test_starts_are_forgotten():
    """From a solid window, an empty one and noise: what the readings ask for and nothing else."""
    model = blocked_room()
    rng = np.random.default_rng(1)
    starts = [
        np.zeros(model.n_cells, np.uint8),
        np.ones(model.n_cells, np.uint8),
        (rng.random(model.n_cells) < 0.5).astype(np.uint8),
    ]
    found = forgotten(model, starts, 1)
    again = forgotten(model, starts, 1)
    walls = []
    for cells, same, start in zip(found, again, starts, strict=True):
        assert np.array_equal(cells, same)
        assert model.log_likelihood(model.start(cells)) > model.log_likelihood(model.start(start))
        rows, columns = np.divmod(model.touched[cells[model.touched] == 1], 40)
        walls.append(rows.size)
        distance = np.hypot((columns + 0.5) * 0.2 - 4.03, (rows + 0.5) * 0.2 - 3.02)
        assert np.abs(distance - 2.1).max() < 0.6
    assert max(walls) < 1.2 * min(walls)


def test_lone_readings_are_not_taken_for_clutter_where_a_burn_in_begins_cold(monkeypatch):
    model = blocked_room(beams=15)
    starts = forgotten(model, [np.zeros(model.n_cells, np.uint8)] * 8, 1)
    said = []
    for few in (model.index.n_rays + 1, model.index.n_rays):
        monkeypatch.setattr('ogm_mcmc.sampling.patch_gibbs.FEW_RAYS', few)
        sampler = PosteriorSampler(model, starts, seed=3, burn_in=40)
        sampler.advance(len(POWERS) + 1)
        for state in sampler.states:  # of the model that it goes on with
            assert np.array_equal(state.records[:, :2], model.start(state.cells).records[:, :2])
        said.append(np.mean(sampler.log_likelihoods()))
    cold, plain = said
    assert cold > plain + 1.0


def test_where_no_ray_arrives_cells_in_which_readings_ended_begin_solid():
    model = blocked_room()
    starts = [np.zeros(model.n_cells, np.uint8), np.ones(model.n_cells, np.uint8)]
    ended, only = np.random.default_rng(2).random((2, model.n_cells)) < 0.5
    plain = forgotten(model, starts, 1, only)
    arrives = model.arrival(np.mean(plain, axis=0, dtype=np.float32), 0.0) >= 0.5
    solid = ended & ~arrives & only
    assert solid.any()
    assert not np.array([cells[solid] for cells in plain]).all()
    for cells, before in zip(forgotten(model, starts, 1, only, ended), plain, strict=True):
        assert cells[solid].all()
        assert np.array_equal(cells[~solid], before[~solid])


def test_cells_behind_a_surface_are_not_judged():
    """They take the prior's word, whatever rays cross them on paper."""
    model = blocked_room()
    sampler = PosteriorSampler(
        model, forgotten(model, [np.zeros(model.n_cells, np.uint8)] * 2, 1), seed=3, burn_in=10
    )
    assert sampler.informed_quality() is None
    sampler.advance(74)
    quality = sampler.informed_quality()
    arrives = sampler.arrival(sampler.quality().mean) >= 0.5
    assert quality.mean.size == arrives[model.touched].sum()
    assert quality.mean.size < 0.8 * model.touched.size
    rows, columns = np.divmod(np.flatnonzero(arrives), 40)
    distance = np.hypot((columns + 0.5) * 0.2 - 4.03, (rows + 0.5) * 0.2 - 3.02)
    assert distance.max() < 2.9
    assert quality.agreeing_share(1.2) > 0.9


@pytest.mark.parametrize('burn_in', [0, 9, 16, 50])
def test_where_sweeps_look_does_not_bias_what_they_find(burn_in):
    """A cell that happened to stay free is drawn seldom: it must not keep that for it."""
    rare = np.repeat([0.01, 0.02, 0.05, 0.95], 12_000)
    model = LoneCells(rare)
    sampler = PosteriorSampler(model, [np.zeros(rare.size, np.uint8)], seed=5, burn_in=burn_in)
    done = 0
    for counted in (1, 16, 62, 128):
        sampler.advance(burn_in + counted - done)
        done = burn_in + counted
        found = sampler.estimate().mean.reshape(4, -1)
        least = np.minimum(rare, 1.0 - rare).reshape(4, -1)[:, 0]
        # At most as many draws as there are turns of a cell that is drawn seldom.
        deviation = np.sqrt(least / (12_000 * max(1.0, counted / DULL_TURNS)))
        off = np.abs(found.mean(axis=1) - rare.reshape(4, -1)[:, 0])
        assert (off < 4.0 * deviation).all(), (counted, off / deviation)

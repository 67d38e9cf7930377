"""Chains on disk: taken up again they draw what they would have drawn; others are refused."""

from dataclasses import replace

import numpy as np
import pytest
from support.strategies import fan

from ogm_mcmc.config import ChainConfig, PatchConfig, SamplerConfig, StopConfig, WindowConfig
from ogm_mcmc.engine import refinement as refinement_module
from ogm_mcmc.engine import sensor_fit
from ogm_mcmc.engine.fingerprint import fingerprint
from ogm_mcmc.engine.refinement import Refinement
from ogm_mcmc.engine.saved_chains import save_chains
from ogm_mcmc.engine.warm_up import warm_up_chains, warm_up_changes, warm_up_sampling
from ogm_mcmc.errors import WindowError
from ogm_mcmc.geometry import PlacedScan, Pose2D, PoseBelief
from ogm_mcmc.sampling import first_hits, ray_dropping
from ogm_mcmc.sampling.estimates import hide_uncertain

CONFIG = SamplerConfig(window=WindowConfig(resolution=0.2), chain=ChainConfig(burn_in=20))


def scans(count=4):
    rng = np.random.default_rng(11)
    return [
        PlacedScan(
            fan(*rng.uniform(0.5, 4.0, 12), increment=0.5, range_max_m=5.0, stamp_ns=i),
            PoseBelief(Pose2D(0.3 * i + 0.05, 0.07, 0.2 * i)),
        )
        for i in range(count)
    ]


def taken(some, config=CONFIG):
    refinement = Refinement(config)
    refinement.take(some)
    return refinement


def sweep(refinement, count):
    return list(refinement.run(StopConfig(max_sweeps=count, max_time=1e6, r_hat=0.0)))[-1]


@pytest.mark.parametrize(
    'patch',
    [PatchConfig(), pytest.param(PatchConfig(size=9), marks=pytest.mark.jit)],
    ids=['cells', 'patches'],
)
@pytest.mark.parametrize('before', [21, 70], ids=['just after the burn-in', 'later'])
def test_goes_on_as_if_nothing_had_happened(tmp_path, patch, before):
    """Scans that came by another way but say the same: equal maps, counts and judgement."""
    config = replace(CONFIG, patch=patch)
    whole = taken(scans(), config)
    sweep(whole, before + 50)

    first = taken(scans(), config)
    sweep(first, before)
    first.save(tmp_path / 'chains.npz')
    second = taken(scans(), config)
    second.resume(tmp_path / 'chains.npz')
    assert second.sampler.sweeps == before
    done = sweep(second, 50)

    assert done.sweeps == before + 50
    assert done.counted == before + 30
    assert np.array_equal(whole.map().probability, second.map().probability, equal_nan=True)
    for a, b in zip(whole.sampler.states, second.sampler.states, strict=True):
        assert np.array_equal(a.cells, b.cells)
    assert np.array_equal(whole.quality.r_hat, second.quality.r_hat)
    # Nor does the first one mind that it was saved.
    sweep(first, 50)
    assert np.array_equal(whole.map().probability, first.map().probability, equal_nan=True)


@pytest.mark.parametrize('started', [False, True], ids=['warm', 'from a map'])
def test_scans_that_come_after_an_interruption_change_nothing_either(tmp_path, started):
    """Taken twice, interrupted, taken a third time: what one process would have drawn."""
    some = scans()
    whole = taken(some[:2])
    sweep(whole, 40)
    whole.take(some[:3])
    sweep(whole, 30)
    whole.save(tmp_path / 'chains.npz')

    second = taken(some[:3])
    second.resume(tmp_path / 'chains.npz')
    start = whole.map() if started else None
    for refinement in (whole, second):
        refinement.take(some, start)
        assert refinement.sampler.sweeps == 0
        sweep(refinement, 60)
    assert np.array_equal(whole.map().probability, second.map().probability, equal_nan=True)
    for a, b in zip(whole.sampler.states, second.sampler.states, strict=True):
        assert np.array_equal(a.cells, b.cells)


def test_a_window_that_grew_goes_on_with_what_its_first_scans_told_of_the_beams(tmp_path):
    """Shares are fitted once; all scans together would tell of others."""
    config = replace(CONFIG, chain=replace(CONFIG.chain, sensor='fitted'))
    some = scans(6)
    grown = taken(some[:4], config)
    grown.take(some)
    sweep(grown, 30)
    grown.save(tmp_path / 'chains.npz')
    again = taken(some, config)
    assert again.beams.model != grown.beams.model
    again.resume(tmp_path / 'chains.npz')
    assert (again.beams.model, again.beams.sensor) == (grown.beams.model, grown.beams.sensor)
    sweep(grown, 10)
    sweep(again, 10)
    assert np.array_equal(grown.map().probability, again.map().probability, equal_nan=True)
    again.take([*some, *scans(7)[6:]])
    assert again.beams.model == grown.beams.model


SAID = {'sigma': 0.05, 'grazing': 0.0, 'clutter': 0.1, 'missing': 0.1, 'sensor': None, 'scans': 4}


@pytest.mark.parametrize(
    'found', [7, {}, {**SAID, 'clutter': 2.0}, {**SAID, 'sigma': -1.0}, {**SAID, 'scans': None}]
)
def test_beams_that_cannot_be_are_refused_and_change_nothing(tmp_path, found):
    path = tmp_path / 'chains.npz'
    some = scans()
    first = taken(some[:3])
    first.take(some)
    sweep(first, 21)
    save_chains(first.sampler, path, {**first._identity(), 'found': found})
    before = first.sampler, first.beams.model, first.window
    with pytest.raises(WindowError, match='expected what was found of the beams'):
        first.resume(path)
    assert (first.sampler, first.beams.model, first.window) == before


def test_what_was_sampled_otherwise_is_refused_and_changes_nothing(tmp_path):
    path = tmp_path / 'chains.npz'
    first = taken(scans())
    sweep(first, 30)
    first.save(path)
    moved = [
        PlacedScan(scan, PoseBelief(replace(belief.mean, yaw_rad=belief.mean.yaw_rad + 1e-12)))
        for scan, belief in scans()
    ]
    others = {
        'seed': taken(scans(), replace(CONFIG, chain=replace(CONFIG.chain, seed=2))),
        'prior': taken(scans(), replace(CONFIG, chain=replace(CONFIG.chain, prior=0.2))),
        'a state of other scans': taken(moved),
        'scans': taken(scans(3)),
    }
    for what, other in others.items():
        before = other.sampler
        with pytest.raises(WindowError, match=f'^{path}: .*{what}'):
            other.resume(path)
        assert other.sampler is before
    with pytest.raises(WindowError, match='no scan was taken'):
        Refinement(CONFIG).resume(path)
    with pytest.raises(WindowError, match='nothing was sampled yet'):
        Refinement(CONFIG).save(path)


def test_fingerprint_knows_everything_that_decides_the_posterior():
    base = scans(2)
    scan, belief = base[1]
    changes = [
        PlacedScan(replace(scan, ranges_m=scan.ranges_m + np.float32(1e-6)), belief),
        PlacedScan(replace(scan, angle_min_rad=scan.angle_min_rad + 1e-12), belief),
        PlacedScan(replace(scan, angle_increment_rad=0.51), belief),
        PlacedScan(replace(scan, range_min_m=0.1), belief),
        PlacedScan(replace(scan, range_max_m=6.0), belief),
        PlacedScan(scan, PoseBelief(replace(belief.mean, x_m=0.36))),
        PlacedScan(scan, PoseBelief(replace(belief.mean, y_m=0.08))),
    ]
    digests = [fingerprint([base[0], changed]) for changed in (base[1], *changes)]
    digests += [fingerprint(base[::-1]), fingerprint(base[:1])]
    assert len(set(digests)) == len(digests)
    # Names and times do not matter.
    renamed = PlacedScan(replace(scan, stamp_ns=99, frame_id='other'), belief)
    assert fingerprint([base[0], renamed]) == digests[0]


def test_the_same_scans_are_known():
    some, refinement = scans(), Refinement(CONFIG)
    assert not refinement.holds([])
    refinement.take(some)
    assert refinement.holds(list(some))
    assert not refinement.holds(some[:3])
    assert not refinement.holds(scans())  # equal, but who compares all readings?


@pytest.mark.parametrize('order', ['fixed', 'random', 'checkerboard'])
def test_warm_up_runs_everything_once(order):
    window = WindowConfig(resolution=0.05, beam_stride=7)
    config = SamplerConfig(window=window, chain=ChainConfig(order=order, burn_in=3))
    assert warm_up_sampling(config) == 4


def test_warm_up_merges_beams(monkeypatch):
    """Else the first `~/refine` of a robot that stood still would compile for seconds."""
    merged = []
    run = Refinement.run

    def noted(refinement, stop):
        merged.append(refinement.size.n_merged)
        return run(refinement, stop)

    monkeypatch.setattr(Refinement, 'run', noted)
    warm_up_sampling(SamplerConfig(chain=ChainConfig(burn_in=3)))
    assert merged[-2] > 0  # the last window has one scan there


def test_what_chance_may_do_is_not_shown():
    """100 draws of a cell with the prior 0.2: 0.08 to 0.32 says nothing, whatever the margin."""
    refinement = taken(scans())
    grid_map = refinement.map()
    values = np.array([[0.0, 0.079, 0.081, 0.2, 0.319, 0.321, 0.8, 1.0, np.nan]], np.float32)
    grid_map = grid_map._replace(probability=values)
    nan = np.nan
    cases = {
        (-0.5, 100): [0.0, 0.079, nan, nan, nan, 0.321, 0.8, 1.0, nan],
        (0.05, 100): [0.0, 0.079, nan, nan, nan, nan, nan, 1.0, nan],
        (0.05, 10**9): [0.0, 0.079, 0.081, nan, nan, nan, nan, 1.0, nan],
        (-0.5, 20): [0.0, nan, nan, nan, nan, nan, 0.8, 1.0, nan],
        (-0.5, 5): [nan, nan, nan, nan, nan, nan, 0.8, 1.0, nan],
        (-0.5, 1): [nan, nan, nan, nan, nan, nan, nan, nan, nan],
        (0.05, 0): [0.0, 0.079, 0.081, nan, nan, nan, nan, 1.0, nan],
    }
    for (margin, draws), expected in cases.items():
        shown = hide_uncertain(grid_map, 0.2, margin, draws).probability[0]
        assert np.array_equal(shown, np.array(expected, np.float32), equal_nan=True), margin


@pytest.mark.parametrize(
    ('warm_up', 'keeping'),
    [(warm_up_sampling, True), (warm_up_chains, True), (warm_up_changes, False)],
)
def test_warm_up_takes_scans_out_and_keeps_first_hits(monkeypatch, warm_up, keeping):
    called = []

    def seen(module, name):
        real = getattr(module, name)

        def one(*args):
            called.append(name)
            return real(*args)

        monkeypatch.setattr(module, name, one)

    names = ['drop_entries', 'drop_runs', 'look_again', 'take_gains']
    for name in names:
        seen(ray_dropping, name)
    seen(first_hits, 'mark_through')
    warm_up(SamplerConfig(chain=ChainConfig(burn_in=3)))
    assert set(called) == {*names, *(['mark_through'] if keeping else [])}


def test_chains_are_made_ready_before_any_map_of_scans(monkeypatch):
    """What maps scans is compiled beside: it would be compiled twice."""
    order = []

    def noted(module, name):
        real = getattr(module, name)

        def one(*args, **settings):
            order.append(name)
            return real(*args, **settings)

        monkeypatch.setattr(module, name, one)

    for name in ('live_map', 'reflection_map'):
        noted(refinement_module, name)
    noted(sensor_fit, '_mapped')
    noted(Refinement, 'run')
    warm_up_chains(SamplerConfig(chain=ChainConfig(burn_in=3)))
    assert order[:4] == ['run'] * 3 + ['live_map']
    order.clear()
    warm_up_changes(SamplerConfig(chain=ChainConfig(burn_in=3)))
    assert set(order) <= {'live_map'}

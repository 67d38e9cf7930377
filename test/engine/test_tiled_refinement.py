"""A refinement in tiles gives what a whole one gives, within the error of sampling."""

import numpy as np
import pytest
from support.local_tiles import LocalHolders

from ogm_mcmc.config import (
    ChainConfig,
    ForwardModelConfig,
    PatchConfig,
    SamplerConfig,
    StopConfig,
    WindowConfig,
)
from ogm_mcmc.engine.refinement import Refinement
from ogm_mcmc.engine.tiled_refinement import TiledRefinement
from ogm_mcmc.errors import ClusterError, ConfigError, WindowError
from ogm_mcmc.simulation import WORLDS, Lidar, record

STOP = StopConfig(max_sweeps=60, max_time=1e6, r_hat=0.0)


def config(seed=5, **patch):
    return SamplerConfig(
        ForwardModelConfig(),
        WindowConfig(resolution=0.2, max_range=4.0),
        ChainConfig(chains=2, burn_in=20, seed=seed),
        PatchConfig(**patch),
    )


@pytest.fixture(scope='module')
def scans():
    lidar = Lidar(60, range_min_m=0.0, range_max_m=6.0, noise_m=0.05, dropout=0.0)
    return list(record(WORLDS['office'](), lidar, np.random.default_rng(3)))[::50]


@pytest.mark.jit
def test_tiles_and_whole_are_one_posterior(scans, tmp_path):
    chosen = config(prior='border', size=9)
    whole, tiles = Refinement(chosen), TiledRefinement(chosen, 2, 2, LocalHolders())
    assert whole.take(scans) == tiles.take(scans)
    assert tiles.window.spec == whole.window.spec
    assert tiles.window.index.n_rays == 0
    assert tiles.size.n_rays == whole.size.n_rays
    assert tiles.size.n_pairs >= whole.size.n_pairs
    for refinement in (whole, tiles):
        *_, last = refinement.run(STOP)
        assert (last.counted, last.reason) == (40, 'sweeps')
    assert np.array_equal(tiles.sampler.model.touched, whole.sampler.model.touched)
    ours, theirs = tiles.sampler.quality(), whole.sampler.quality()
    # What lies behind surfaces is the prior's, and takes long to agree about.
    arrives = whole.sampler.arrival(theirs.mean)[whole.sampler.model.touched] >= 0.5
    ours, theirs = ours.of(arrives), theirs.of(arrives)
    assert arrives.sum() > 1000
    assert ours.agreeing_share(1.1) > 0.95
    apart = np.abs(ours.mean - theirs.mean)
    assert np.quantile(apart / np.hypot(ours.mcse, theirs.mcse), 0.98) < 3.0
    assert apart.mean() < 0.015
    known = np.isfinite(tiles.known_map().probability), np.isfinite(whole.known_map().probability)
    assert (known[0] == known[1]).mean() > 0.95
    # A saved state goes on as if nothing had happened.
    tiles.save(tmp_path / 'state')
    again = TiledRefinement(chosen, 2, 2, LocalHolders())
    again.take(scans)
    again.resume(tmp_path / 'state')
    for refinement in (tiles, again):
        list(refinement.run(StopConfig(max_sweeps=3, max_time=1e6, r_hat=0.0)))
    assert np.array_equal(tiles.map().probability, again.map().probability, equal_nan=True)


def test_the_sensor_is_fitted_once_where_all_scans_are(scans):
    chosen = config()
    holders = LocalHolders()
    tiles = TiledRefinement(chosen, 2, 1, holders)
    tiles.take(scans[:3])
    (given, count), *_ = holders.asked
    assert (given.chain.sensor, count) == ('given', 2)
    assert given.model == tiles.beams.model
    *_, last = tiles.run(StopConfig(max_sweeps=30, max_time=1e6, r_hat=0.0))
    assert last.counted == 10
    mean = tiles.map().probability
    assert np.nanmin(mean) >= 0.0
    assert np.nanmax(mean) > 0.0
    samplers = tiles.tiled._tiles.samplers
    states = [state for sampler in samplers for state in sampler._kept.values()]
    kept = sum(array.nbytes for state in states for array in state)
    assert tiles.size.n_bytes == kept + sum(sampler.rays.n_bytes for sampler in samplers)


def test_tiles_that_could_not_be_held_are_held_anew(scans, monkeypatch):
    holders = LocalHolders()
    tiles = TiledRefinement(config(), 2, 1, holders)
    n_rays = tiles.take(scans[:2])
    before, hold = tiles.sampler, holders.hold

    def fails(*_):
        raise ClusterError('no worker is left')

    tiles._shape = 100, 2  # refused before anything is held
    with pytest.raises(WindowError):
        tiles.take(scans[:3])
    assert tiles.sampler is before
    tiles._shape = 2, 1
    monkeypatch.setattr(holders, 'hold', fails)
    with pytest.raises(ClusterError):
        tiles.take(scans[:3])
    assert tiles.sampler is None
    assert tiles.size.n_rays == 0
    monkeypatch.setattr(holders, 'hold', hold)
    assert tiles.take(scans[:2]) == n_rays


def test_what_cannot_be_in_tiles(scans):
    with pytest.raises(ConfigError, match=r'patch\.order is random: expected tiled'):
        TiledRefinement(config(prior='border', size=9, order='random'), 2, 2, LocalHolders())
    with pytest.raises(ConfigError, match=r'patch\.random_share is 0\.1: expected 0 where'):
        TiledRefinement(config(prior='border', size=9, random_share=0.1), 2, 2, LocalHolders())
    tiles = TiledRefinement(config(), 100, 2, LocalHolders())
    with pytest.raises(WindowError, match='100x2 tiles of'):
        tiles.take(scans[:2])
    with pytest.raises(WindowError, match='no scan was recorded'):
        tiles.take([])
    with pytest.raises(WindowError, match='nothing to sample'):
        tiles.tiled  # noqa: B018

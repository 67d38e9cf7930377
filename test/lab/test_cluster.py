"""Chains and data sets on a Dask cluster: what comes back is what local work gives."""

import json
import os
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from support.local_tiles import LocalHolders
from support.tasks import dying_once, square, whereabouts

from ogm_mcmc.cli import sample as sample_command
from ogm_mcmc.cli.main import run
from ogm_mcmc.config import (
    ChainConfig,
    ForwardModelConfig,
    PatchConfig,
    SamplerConfig,
    StopConfig,
    WindowConfig,
)
from ogm_mcmc.config.nodes import NodeWindowConfig, RefineSamplerConfig
from ogm_mcmc.engine.prior_files import default_prior_file
from ogm_mcmc.engine.refinement import Refinement
from ogm_mcmc.engine.tiled_refinement import TiledRefinement
from ogm_mcmc.errors import ClusterError
from ogm_mcmc.lab import chain_worker, cluster, experiments
from ogm_mcmc.lab import workers as workers_module
from ogm_mcmc.lab.cluster import distribute
from ogm_mcmc.lab.experiments import run_all
from ogm_mcmc.lab.parcels import unpack
from ogm_mcmc.lab.tile_cluster import ClusterTiles
from ogm_mcmc.lab.workers import connected
from ogm_mcmc.sampling import burn_in
from ogm_mcmc.simulation import WORLDS, Lidar, record

STOP = StopConfig(max_sweeps=120, max_time=1e6, r_hat=0.0)


def sample_chains(refinement, scans, stop, executor):
    distribute(refinement, scans, executor)
    return refinement.run(stop)


def config(**patch):
    return SamplerConfig(
        ForwardModelConfig(),
        WindowConfig(resolution=0.2, max_range=4.0),
        ChainConfig(chains=3, burn_in=20, seed=5),
        PatchConfig(**patch),
    )


@pytest.fixture(scope='module')
def scans():
    lidar = Lidar(60, range_min_m=0.0, range_max_m=6.0, noise_m=0.05, dropout=0.0)
    walk = list(record(WORLDS['office'](), lidar, np.random.default_rng(3)))[::60]
    assert len(walk) > 4
    return walk


@pytest.fixture(scope='module')
def local(scans):
    refinement = Refinement(config())
    refinement.take(scans)
    *_, last = refinement.run(STOP)
    return refinement, last


def test_workers_do_not_judge_again(scans):
    """What no return means and the sensor's numbers are found once, at home."""
    refinement = Refinement(RefineSamplerConfig(window=NodeWindowConfig(0.2, 4.0)))
    refinement.take(scans)
    with ThreadPoolExecutor(1) as pool:
        distribute(refinement, scans, pool)
    _, (shipped, _) = unpack(refinement.sampler._parcel)
    assert shipped.window.no_return == refinement.beams.no_return.value != 'auto'
    assert (shipped.model, shipped.chain.sensor) == (refinement.beams.model, 'given')


@pytest.fixture(scope='module')
def dask_cluster():
    distributed = pytest.importorskip('distributed')
    with distributed.LocalCluster(
        n_workers=2,
        threads_per_worker=1,
        host='127.0.0.1',
        dashboard_address=':0',  # any port: tests run beside each other
        silence_logs='CRITICAL',
    ) as running:
        yield running


class Deadly(workers_module.Workers):
    """Hands one task on in a form that kills the process it is done in, the first time."""

    def __init__(self, inner, marker, which):
        self.inner, self.marker, self.which = inner, marker, which
        self.submitted = 0

    def share(self, data):
        return self.inner.share(data)

    def place(self, keys):
        return self.inner.place(keys)

    def done_by(self, key, worker):
        self.inner.done_by(key, worker)

    def check(self):
        self.inner.check()

    def again(self, key, fn, *args):
        self.submitted += 1
        if self.submitted == self.which:
            return self.inner.again(key, dying_once, str(self.marker), fn, *args)
        return self.inner.again(key, fn, *args)


def same(one: Refinement, other: Refinement) -> None:
    assert np.array_equal(one.map().probability, other.map().probability, equal_nan=True)
    assert one.sampler.log_likelihoods() == other.sampler.log_likelihoods()
    for mine, theirs in zip(one.sampler.counts, other.sampler.counts, strict=True):
        assert np.array_equal(mine.counts, theirs.counts)
    for mine, theirs in zip(one.sampler.rngs, other.sampler.rngs, strict=True):
        assert mine.bit_generator.state == theirs.bit_generator.state
    assert one.quality.summary() == other.quality.summary()


@pytest.mark.jit
def test_any_executor_gives_what_local_chains_give(scans, local, monkeypatch):
    refinement = Refinement(config())
    refinement.take(scans)
    built = []
    monkeypatch.setattr(chain_worker, '_models', {})
    real = chain_worker._built
    monkeypatch.setattr(chain_worker, '_built', lambda *p: built.append(p) or real(*p))
    with ThreadPoolExecutor(2) as executor:
        *_, last = sample_chains(refinement, scans, STOP, executor)
    assert (last.sweeps, last.counted, last.reason) == (120, 100, 'sweeps')
    assert last.r_hat_p99 == local[1].r_hat_p99
    assert len(built) == 1
    same(refinement, local[0])


@pytest.mark.jit
def test_a_burn_in_ends_early_as_that_of_local_chains(scans, monkeypatch):
    monkeypatch.setattr(burn_in, 'AGREEING', (1.2, 0.9))
    chain = replace(config().chain, chains=2, burn_in=40)
    here, there = (Refinement(replace(config(), chain=chain)) for _ in range(2))
    for refinement in (here, there):
        refinement.take(scans[:4])
    stop = replace(STOP, max_sweeps=60)
    *_, local = here.run(stop)
    with ThreadPoolExecutor(1) as pool:
        *_, distant = sample_chains(there, scans[:4], stop, pool)
    assert here.sampler.burn_in == there.sampler.burn_in < 40
    assert distant.counted == local.counted == 60 - here.sampler.burn_in
    same(there, here)


@pytest.mark.jit
def test_a_window_built_at_once_is_that_which_grew(scans):
    grown, at_once = Refinement(config()), Refinement(config())
    grown.take(scans[:3])
    grown.take(scans)
    at_once.take(scans)
    assert grown.window.spec == at_once.window.spec
    for mine, theirs in zip(grown.window.index, at_once.window.index, strict=True):
        assert np.array_equal(mine, theirs)


@pytest.mark.jit
def test_a_prior_file_need_not_be_on_the_worker(scans, tmp_path):
    mine = tmp_path / 'mine.npz'
    mine.write_bytes(default_prior_file().read_bytes())
    chosen = config(prior='border', size=9, prior_file=str(mine))
    stop = StopConfig(max_sweeps=40, max_time=1e6, r_hat=0.0)
    here, there = Refinement(chosen), Refinement(chosen)
    here.take(scans)
    there.take(scans)
    list(here.run(stop))
    with ThreadPoolExecutor(1) as executor:
        rounds = sample_chains(there, scans, stop, executor)
        mine.unlink()
        list(rounds)
    same(here, there)


class Forgetful(workers_module.Workers):
    """Workers that lose what was shared with them once, and move the second chain each round."""

    def __init__(self, inner):
        self.inner = inner
        self.sent, self.given = [], []

    def share(self, data):
        self.sent.append(data)
        return data

    def place(self, keys):
        return {1}

    def done_by(self, key, worker):
        raise AssertionError('threads are no workers')

    def check(self):
        """Threads stay."""

    def again(self, key, fn, *args):
        self.given.append(args)
        if len(self.given) == 1:
            gone = Future()
            gone.cancel()
            gone.set_running_or_notify_cancel()
            return gone
        return self.inner.submit(fn, *args)


@pytest.mark.jit
def test_scans_are_sent_once_and_again_when_all_have_lost_them(scans, local):
    refinement = Refinement(config())
    refinement.take(scans)
    with ThreadPoolExecutor(2) as pool:
        workers = Forgetful(pool)
        list(sample_chains(refinement, scans, STOP, workers))
    assert len(workers.sent) == 2
    assert len(workers.given) > 6
    assert all(len(problem.token) == 64 for problem, *_ in workers.given)
    assert all(given[1] is workers.sent[0] for given in workers.given[:3])
    # Who gets a chain that moves is told where it stands at once; others go on from their marks.
    told = [
        [job.state is not None for *_, job in workers.given[6:] if job.chain == j] for j in (0, 1)
    ]
    assert not any(told[0])
    assert all(told[1])
    assert min(map(len, told)) > 0
    same(refinement, local[0])


@pytest.mark.jit
def test_a_killed_worker_costs_nothing(dask_cluster, scans, local, tmp_path):
    refinement = Refinement(config())
    refinement.take(scans)
    marker = tmp_path / 'killed'
    with connected(dask_cluster.scheduler_address) as executor:
        # The second chain of the third round.
        deadly = Deadly(executor, marker, 8)
        *_, last = sample_chains(refinement, scans, STOP, deadly)
    assert marker.exists()
    assert deadly.submitted > 8
    assert last.sweeps == 120
    same(refinement, local[0])


def test_data_sets_survive_a_killed_worker(dask_cluster, tmp_path):
    (tmp_path / 'calls').mkdir()
    work = {
        f'set{n}': {'value': n, 'folder': str(tmp_path / 'calls'), 'dies': n == 3}
        for n in range(6)
    }
    with connected(dask_cluster.scheduler_address) as executor:
        results = run_all(tmp_path / 'out', square, work, executor=executor)
    assert [result['square'] for result in results.values()] == [0, 1, 4, 9, 16, 25]
    assert (tmp_path / 'calls' / '3-1').exists()
    assert len(list((tmp_path / 'out').iterdir())) == 6


def test_experiment_on_a_cluster(dask_cluster, tmp_path, monkeypatch, capsys):
    found = {}

    def elsewhere(folder, *, quick, seed):
        found.update(run_all(folder / 'sets', whereabouts, {'one': {'number': 1}}))
        return {'rows': [experiments.row('number', found['one']['number'])]}

    monkeypatch.setitem(experiments.EXPERIMENTS, 'pose-sim', elsewhere)
    arguments = ['experiment', 'pose-sim', '-o', str(tmp_path / 'out')]
    assert run([*arguments, '--scheduler', dask_cluster.scheduler_address]) == 0
    assert 'number' in capsys.readouterr().out
    assert found['one']['process'] != os.getpid()
    # Without a cluster a single data set is computed in this process.
    for path in (tmp_path / 'out' / 'sets').iterdir():
        path.unlink()
    assert run(arguments) == 0
    assert found['one']['process'] == os.getpid()


@pytest.mark.jit
def test_sample_on_a_cluster(dask_cluster, office_bag, tmp_path, capsys, monkeypatch):
    """With --state, in two runs: here, then on the cluster; as if all had been done here."""
    few = ('--resolution', '0.2', '--beam-stride', '12', '--burn-in', '16', '--r-hat', '0')
    few += ('--prior', 'uniform', '--patch-size', '1')
    there = ('--scheduler', dask_cluster.scheduler_address)
    shared = []
    real = cluster.distribute
    monkeypatch.setattr(sample_command, 'distribute', lambda *a: shared.append(a) or real(*a))

    def sample(name, *options):
        arguments = ['sample', str(office_bag), '-o', str(tmp_path / name), *few, *options]
        assert run(arguments) == 0
        said.append(capsys.readouterr().out)
        with np.load(tmp_path / name / 'map.npz') as data:
            return data['probability'], data['r_hat']

    said = []
    whole = sample('whole', '--max-sweeps', '44')
    state = ('--state', str(tmp_path / 'state'))
    sample('first', *state, '--max-sweeps', '20')
    parts = sample('parts', *state, '--max-sweeps', '24', *there, '--json')
    assert len(shared) == 1
    sent = json.loads(said[-1])['cluster']
    assert min(sent['parcel_bytes'], sent['told'], sent['answered']) > 0
    assert sent['jobs'] >= 2
    assert sorted(j for of in sent['workers'].values() for j in of['chains']) == [1, 2]
    assert all(of['peak_mb'] > 0 for of in sent['workers'].values())
    for one, other in zip(whole, parts, strict=True):
        assert np.array_equal(one, other, equal_nan=True)


@pytest.mark.slow
@pytest.mark.jit
def test_tiles_on_a_cluster(dask_cluster, office_bag, scans, tmp_path, capsys):
    """What tiles in this process give, though a worker is lost, and by the command."""
    here = TiledRefinement(config(), 2, 2, LocalHolders())
    here.take(scans)
    few = StopConfig(max_sweeps=40, max_time=1e6, r_hat=0.0)
    list(here.run(few))
    with connected(dask_cluster.scheduler_address) as workers:
        tiles = ClusterTiles(workers)
        there = TiledRefinement(config(), 2, 2, tiles)
        there.take(scans)
        rounds = there.run(few)
        next(rounds)
        held = tiles.figures()['workers']
        assert sorted(tile for of in held.values() for tile in of['tiles']) == [1, 2, 3, 4]
        assert all(len(of['tiles']) == 2 for of in held.values())
        gone = workers.client.submit(
            dying_once, str(tmp_path / 'gone'), abs, 1, workers=[min(held)], pure=False
        )
        list(rounds)
        assert (tmp_path / 'gone').exists()
        gone.cancel()
        assert tiles.traffic.jobs > 40 * 2 * 4
        assert min(tiles.traffic.told, tiles.traffic.answered) > 0
    same(there, here)
    few = (
        '--resolution',
        '0.2',
        '--beam-stride',
        '12',
        '--burn-in',
        '2',
        '--r-hat',
        '0',
        '--json',
    )
    arguments = ['sample', str(office_bag), '-o', str(tmp_path), *few, '--max-sweeps', '6']
    arguments += ['--scheduler', dask_cluster.scheduler_address, '--tiles', '2x1']
    assert run([*arguments, '--prior', 'uniform', '--patch-size', '1']) == 0
    said = json.loads(capsys.readouterr().out)
    assert said['counted'] == 4
    assert sorted(n for group in said['tiles']['groups'] for n in group) == [0, 1]
    assert said['tiles']['parcel_bytes'] > 0
    assert said['rays'] > 0
    assert (tmp_path / 'map.yaml').exists()


def test_a_worker_is_no_scheduler(dask_cluster):
    worker, *_ = dask_cluster.scheduler_info['workers']
    with pytest.raises(ClusterError, match='is a Worker; expected'), connected(worker):
        pass


def test_workers_of_another_version(dask_cluster, monkeypatch):
    monkeypatch.setattr(workers_module, '__version__', '99.0')
    with (
        pytest.raises(ClusterError, match=r'expected 99\.0'),
        connected(dask_cluster.scheduler_address),
    ):
        pass

"""The sampling benchmark measures what it says: the pairs, the chain, the memory."""

import json
import math

import numpy as np
import pytest
from support.office import OFFICE_SCANS
from support.strategies import fan

from ogm_mcmc.config import SamplerConfig, WindowConfig
from ogm_mcmc.engine.refinement import Refinement
from ogm_mcmc.geometry import PlacedScan, Pose2D, PoseBelief
from ogm_mcmc.lab.benchmarks.pair_count_kernels import count_looked_at
from ogm_mcmc.lab.benchmarks.sample import Effort, bag_config, scene_config, time_sampling
from ogm_mcmc.sampling.gibbs_kernels import SLACK
from ogm_mcmc.sampling.ray_index_kernels import NOTHING

AT = PoseBelief(Pose2D(0.5, 0.5))


def apart(number):
    """A little from there: scans within a sixteenth of a cell have their rays in common."""
    return PoseBelief(Pose2D(0.5 + 0.1 * number, 0.5))


def test_pairs_of_a_corridor_on_paper():
    """Two readings along a line of 20 cells of 1 m; not cut, and cut four sigma behind."""
    placed = [PlacedScan(fan(3.0), apart(0)), PlacedScan(fan(7.25), apart(1))]
    whole = time_sampling(placed, scene_config(1.0, 0.0, 0.15), Effort(2, 3))
    assert whole['pairs'] == 2 * 21  # from the middle of a cell 20 m on
    assert whole['cells'] == 21
    cut = time_sampling(placed, scene_config(1.0, 4.0, 0.15), Effort(2, 3))
    # 0.5 + 3 + 4 sigma of 2 cells lies in cell 11, 0.6 + 7.25 + 8 in cell 15.
    assert cut['pairs'] == 12 + 16
    assert cut['settings']['model.sigma'] == 2.0
    plain = cut['plain_loop']
    assert plain['same_draws'] is True
    assert plain['cpu_ratio_to_plain'] > 0.0
    assert plain['median_cpu_ms_per_sweep'] > 0.0
    assert cut['settings']['chain.start'] == 'live'


def test_result_holds_what_was_promised():
    scan = fan(3.0, 5.0, 6.0, increment=0.1)
    placed = [PlacedScan(scan, apart(number)) for number in range(20)]
    result = time_sampling(placed, bag_config(0.5, 'ignore', 0.2), Effort(3, 5))
    assert 0.0 < result['ms_per_sweep'] <= result['median_ms_per_sweep']
    assert result['ns_per_pair'] == pytest.approx(
        1e6 * result['ms_per_sweep'] / result['pairs'], abs=0.1
    )
    assert result['bytes_per_pair_sampling'] > 0.0
    assert result['bytes_per_ray'] > 40.0
    assert result['peak_bytes_per_ray'] >= result['bytes_per_ray']
    assert result['index_ms'] > 0.0
    threads = result['threads']
    assert threads['ratio'] == pytest.approx(threads['2'] / threads['1'], abs=1e-3)
    assert result['plain_loop'] is None  # `beam` is level in front of readings
    looked_at = result['looked_at']
    assert 0 < looked_at['pairs'] <= result['pairs']
    assert looked_at['all_rays_for_every_cell'] == result['rays'] * result['cells']
    assert result['settings']['window.no_return'] == 'ignore'
    json.dumps(result)


def plain_count(rng, model, state):
    """Count in plain Python, ray by ray from the map alone."""
    index, prior = model.index, model.prior_log_odds
    paths, values, nothing = zip(*map(index.ray, range(index.n_rays)), strict=True)
    paths, gains = [path.tolist() for path in paths], index.gains()

    def says(ray, position):
        return nothing[ray] if position is None else float(values[ray][position])

    def first_hit(ray, cells):
        return next((p for p, cell in enumerate(paths[ray]) if cells[cell]), None)

    looked_cells = looked_pairs = 0
    for cell in model.touched:
        u = rng.random()
        if not u < model.ceiling[cell]:
            continue
        looked_cells += 1
        free = state.cells.copy()
        free[cell] = 0
        log_odds = prior
        least = math.log(u / (1.0 - u)) - SLACK
        through = [ray for ray in range(index.n_rays) if cell in paths[ray]]
        near = [ray for ray in through if says(ray, paths[ray].index(cell)) != values[ray][0]]
        for rays, enough in ((near, least - gains[cell]), (sorted({*through} - {*near}), least)):
            if log_odds < least and rays is not near:
                break
            for ray in rays:
                looked_pairs += 1
                position, behind = paths[ray].index(cell), first_hit(ray, free)
                if behind is None or behind > position:
                    log_odds += says(ray, position) - says(ray, behind)
                if log_odds < enough:
                    break
    return looked_cells, looked_pairs


def test_counting_equals_plain_python():
    scan = fan(2.0, 2.5, 3.0, 2.2, 4.0, bearing=-0.4, increment=0.2, range_max_m=5.0)
    config = SamplerConfig(window=WindowConfig(resolution=0.25))
    refinement = Refinement(config)
    refinement.take([PlacedScan(scan, AT), PlacedScan(scan, PoseBelief(Pose2D(0.7, 0.3, 0.2)))])
    sampler = refinement.sampler
    sampler.advance(5)
    counts = []
    for seed in range(8):
        for state in sampler.states:
            arguments = (sampler.model.touched, *state[:2], sampler.model.index,
                         sampler.model.ceiling, sampler.model.prior_log_odds)  # fmt: skip
            found = count_looked_at(np.random.default_rng(seed), *arguments)
            assert found == plain_count(np.random.default_rng(seed), sampler.model, state)
            counts.append(found)
    # Not everything and not nothing is looked at.
    assert 0 < min(pairs for _, pairs in counts) < sampler.model.index.n_pairs
    assert sampler.model.index.n_pairs < NOTHING


def test_from_the_command_line(run_cli, office_bag):
    done = run_cli(
        *('bench', 'sample', office_bag, '--resolution', '0.4', '--sweeps', '2', '--warm-up', '1')
    )
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert set(result) == {'scene', 'scene cut at 4 sigma', 'bag 40 cm'}
    assert result['scene']['settings']['model.kind'] == 'gaussian'
    assert result['scene']['settings']['window.cut_sigma'] == 0.0
    assert all(result[name]['plain_loop']['same_draws'] for name in list(result)[:2])
    # As many rays; cut ones cross fewer cells.
    assert result['scene']['rays'] == result['scene cut at 4 sigma']['rays'] > 17_900
    assert result['scene']['pairs'] > 1.5 * result['scene cut at 4 sigma']['pairs']
    assert result['bag 40 cm']['settings']['window.no_return'] == 'ignore'
    assert result['bag 40 cm']['scans'] == OFFICE_SCANS


@pytest.mark.parametrize(
    ('arguments', 'reason'),
    [
        (['--sweeps', '0'], '--sweeps is 0: expected 1 or more'),
        (['--warm-up', '-1'], '--warm-up is -1: expected 0 or more'),
        (['--cell-prior', '1'], '--cell-prior is 1: expected'),
        (['--resolution', '0'], '--resolution is 0: expected 0.001 to 10 m'),
        (['--resolution', '0.1'], '--resolution: expected with a BAG'),
        (['--no-return', 'clear'], '--no-return: expected with a BAG'),
        (['--pose-topic', '/none'], '--pose-topic: expected with a BAG'),
        (['--scene', 'nowhere.npz'], 'expected an NPZ'),
    ],
    ids=lambda value: ' '.join(value) if isinstance(value, list) else '',
)
def test_a_mistake_is_one_line(capsys, arguments, reason):
    from ogm_mcmc.cli.main import run

    assert run(['bench', 'sample', *arguments]) == 2
    assert reason in capsys.readouterr().err

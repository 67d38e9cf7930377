"""`demo`: real nodes in separate processes, on a log and on the simulated building."""

import argparse
import json

import pytest
from PIL import Image
from support.commands import finished

from ogm_mcmc.io.map_files import load_map

pytest.importorskip('rclpy', reason='rclpy is not installed: no demo')

from ogm_mcmc.cli.demo import (
    MOST_ROUNDS,
    NODE_START_S,
    _mapper_arguments,
    _refined,
    _refiner_arguments,
)
from ogm_mcmc.cli.demo_input import DemoInput
from ogm_mcmc.config.nodes import IntakeConfig

pytestmark = [pytest.mark.ros, pytest.mark.slow]


class SlowRefiner:
    """Goes on with its chains at each call, so many sweeps at a time."""

    def __init__(self, sweeps):
        self.sweeps_at_once, self.calls = sweeps, 0

    def refine(self, timeout_s, alive, show):
        self.calls += 1
        return {'sweeps': str(self.calls * self.sweeps_at_once)}


@pytest.mark.parametrize(('at_once', 'calls'), [(100, 1), (7, 3), (0, MOST_ROUNDS)])
def test_a_slow_machine_gets_more_time(at_once, calls):
    refiner = SlowRefiner(at_once)
    report = _refined(refiner, 1.0, lambda: True, lambda report: None)
    assert refiner.calls == calls
    assert report['sweeps'] == str(calls * at_once)


@pytest.mark.parametrize('arguments', [_mapper_arguments, _refiner_arguments])
def test_no_node_complains_of_scans_that_cannot_come_yet(arguments, tmp_path):
    """The mapper said ERROR while the other node compiled, and again while maps were refined."""
    options = argparse.Namespace(params_file=None, sampling_time=10.0)
    topics = ('/scan',), '/pose', 'pose', ''
    source = DemoInput(tmp_path, *topics, 'map', 'base_link', '', False, 10, 180)
    (value,) = [
        float(text.partition(':=')[2])
        for text in arguments(options, source, tmp_path)
        if text.startswith('stale_after:=')
    ]
    assert IntakeConfig(stale_after=value).stale_after > NODE_START_S


def test_demo_without_input_maps_the_simulated_building(run_process, tmp_path):
    done = run_process('demo', '-o', 'out/demo', '--sampling-time', '3', '--json', timeout=200)
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert result['scans_used'] == result['scans_received'] == 1158
    assert result['dropped'] == 0
    assert result['maps_received'] >= 1
    for suffix in ('pgm', 'yaml', 'png'):
        assert (tmp_path / 'out' / 'demo' / f'map.{suffix}').stat().st_size > 50
    with Image.open(tmp_path / 'out' / 'demo' / 'map.png') as picture:
        assert picture.size == pytest.approx((322, 242), abs=4)
    assert 'replay: 100%' in done.stderr

    refined = result['refined']
    assert refined['saved'] == str(tmp_path / 'out' / 'demo' / 'map_refined.yaml')
    assert refined['stopped_because'] in ('converged', 'time')
    assert refined['beam_stride'] == 9
    assert 44_000 < refined['rays'] < 48_000
    assert refined['sweeps'] > 10
    assert 'refine: ' in done.stderr
    live = load_map(tmp_path / 'out' / 'demo' / 'map.yaml')
    sampled = load_map(tmp_path / 'out' / 'demo' / 'map_refined.yaml')
    # The refined map may show something of what is behind the walls.
    assert sampled.probability.shape == pytest.approx(live.probability.shape, abs=60)
    assert (sampled.probability == 1.0).sum() > 1000
    assert (sampled.probability == 0.0).mean() > 0.6
    with Image.open(result['side_by_side']) as sheet:
        assert sheet.size[0] > 2 * 2 * 322
        assert sheet.size[1] > 2 * 242


@pytest.mark.data
def test_demo_maps_a_log(run_process, tmp_path, data_folder):
    log = data_folder / 'carmen' / 'belgioioso-corrected.log.gz'
    done = run_process('demo', log, '-o', 'out', '--sampling-time', '3', '--json', timeout=200)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)['scans_used'] == 395
    assert done.stderr.count('no_return auto: ignore, ') == 2  # said by both nodes
    with Image.open(tmp_path / 'out' / 'map.png') as picture:
        assert min(picture.size) > 500
    assert (tmp_path / 'out' / 'map_refined.yaml').is_file()
    assert (tmp_path / 'out' / 'maps.png').is_file()


@pytest.mark.parametrize(
    ('option', 'value', 'message'),
    [
        ('--sampling-time', '0', 'max_time is 0.0: expected a number from 0.01'),
        ('--method', 'sonar', '--method sonar: expected one for LaserScan'),
    ],
)
def test_demo_refuses_before_it_starts(tmp_path, option, value, message):
    done = finished('demo', '-o', tmp_path / 'out', option, value)
    assert done.returncode == 2
    assert message in done.stderr
    assert not (tmp_path / 'out').exists()

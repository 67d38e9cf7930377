"""`demo`: real nodes in separate processes, on a log and on the simulated building."""

import json

import pytest
from PIL import Image

pytest.importorskip('rclpy', reason='rclpy is not installed: no demo')

pytestmark = [pytest.mark.ros, pytest.mark.slow]


def test_demo_without_input_maps_the_simulated_building(run_cli, tmp_path):
    done = run_cli('demo', '-o', 'out/demo', '--json', timeout=200)
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


@pytest.mark.data
def test_demo_maps_a_log(run_cli, tmp_path, data_folder):
    log = data_folder / 'carmen' / 'belgioioso-corrected.log.gz'
    done = run_cli('demo', log, '-o', 'out', '--json', timeout=200)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)['scans_used'] == 395
    assert 'no return: ignored' in done.stderr
    with Image.open(tmp_path / 'out' / 'map.png') as picture:
        assert min(picture.size) > 500

"""`evaluate`: every judge by hand, the page in a real browser, one line for every mistake."""

import json
import re
import shutil
import subprocess

import numpy as np
import pytest
import yaml
from support.commands import command
from support.refusals import error_line
from support.small_maps import ESTIMATE, TRUTH

from ogm_mcmc.geometry import GridMap, GridSpec, Pose2D
from ogm_mcmc.io import ros_types
from ogm_mcmc.io.bags import BagWriter
from ogm_mcmc.io.map_files import load_grid, save_npz


def test_table_and_files(run_cli, maps):
    done = run_cli('evaluate', 'map.npz', '--truth', 'truth.yaml', '-o', 'out')
    assert done.returncode == 0, done.stderr
    assert re.search(r'cells that count +11 \(10 of them measured\)', done.stdout)
    assert re.search(
        r'at threshold 0\.5 +F1 0\.7500, precision 0\.7500, recall 0\.7500', done.stdout
    )
    result = json.loads((maps / 'out' / 'evaluation.json').read_text())
    assert result['settings']['mask'] == 'all'
    assert result['at_threshold']['f1'] == pytest.approx(0.75)
    q = np.array([0.1, 0.2, 0.9, 0.5, 0.1, 0.6, 0.3, 0.8, 0.4, 0.1, 0.2])
    p = TRUTH[np.isfinite(TRUTH)]
    expected = -np.log(np.where(p == 1, q, 1 - q)).sum()
    assert result['divergence_nats'] == pytest.approx(expected, rel=1e-6)
    page = (maps / 'out' / 'evaluation.html').read_text()
    assert page.count('<img') == 8
    assert 'http' not in page


def test_options_and_json(run_cli, maps):
    done = run_cli(
        *('evaluate', 'map.npz', '--truth', 'truth.yaml', '--json', '--mask', 'measured'),
        *('--truth-unknown', 'occupied', '--threshold', '0.35', '--name', 'mine'),
    )
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert result['cells'] == result['measured_cells'] == 11
    assert result['at_threshold']['recall'] == 1.0
    assert (maps / 'out' / 'evaluate' / 'mine.html').exists()
    assert json.loads((maps / 'out' / 'evaluate' / 'mine.json').read_text()) == result


def test_a_yaml_map_and_itself(run_cli, maps):
    done = run_cli('evaluate', 'truth.yaml', '--truth', 'truth.yaml', '--json')
    assert json.loads(done.stdout)['best']['f1'] == 1.0


def browser():
    names = ('chromium', 'chromium-browser', 'google-chrome', 'chrome')
    return next((path for path in map(shutil.which, names) if path), None)


@pytest.mark.skipif(browser() is None, reason='no Chromium found to open the page in')
@pytest.mark.parametrize(
    ('judges', 'pictures'),
    [
        (('--truth', 'truth.yaml'), 8),
        (('--truth', 'truth.yaml', '--beams', 'bag', '--pose', '0.55,-0.15,0'), 13),
    ],
    ids=('truth', 'all'),
)
def test_the_page_opens_in_a_browser(run_cli, maps, bag, judges, pictures):
    """Every picture is decoded, and a picture of the page is not blank."""
    assert run_cli('evaluate', 'map.npz', *judges, '-o', 'out').returncode == 0
    page = maps / 'out' / 'evaluation.html'
    # The page itself runs no script; a copy counts the pictures that the browser could decode.
    counting = (
        '<script>addEventListener("load", () => { document.title = [...document.images]'
        '.filter(i => i.complete && i.naturalWidth > 0).length + " pictures shown"; })</script>'
    )
    watched = maps / 'watched.html'
    watched.write_text(page.read_text().replace('</body>', counting + '</body>'))
    flags = [
        *('--headless', '--no-sandbox', '--disable-gpu', '--disable-dev-shm-usage'),
        *(f'--user-data-dir={maps / "profile"}', '--host-resolver-rules=MAP * ~NOTFOUND'),
        '--window-size=1300,2000',
    ]
    dumped = subprocess.run(
        [browser(), *flags, '--virtual-time-budget=5000', '--dump-dom', watched.as_uri()],
        capture_output=True, text=True, timeout=60,
    )  # fmt: skip
    assert f'<title>{pictures} pictures shown</title>' in dumped.stdout, dumped.stderr
    shot = maps / 'shot.png'
    subprocess.run(
        [browser(), *flags, f'--screenshot={shot}', page.as_uri()],
        capture_output=True, check=True, timeout=60,
    )  # fmt: skip
    from PIL import Image

    with Image.open(shot) as image:
        assert len(image.convert('RGB').getcolors(10_000_000)) > 50


def test_all_judges_at_once(run_cli, maps, bag):
    judges = ('--truth', 'truth.yaml', '--beams', 'bag', '--pose=0.55,-0.15,0')
    done = run_cli('evaluate', 'map.npz', *judges, '-o', 'out', '--no-return', 'clear')
    assert done.returncode == 0, done.stderr
    assert re.search(r'held-out beams +4 of 2 scans', done.stdout)
    assert re.search(r'log-likelihood, nats a beam +-?\d+\.\d+ \+- \d', done.stdout)
    assert re.search(r'of those without a return +\S+ \(1\)', done.stdout)
    result = json.loads((maps / 'out' / 'evaluation.json').read_text())
    assert result['at_threshold']['f1'] == pytest.approx(0.75)
    assert result['truth'] == 'truth.yaml'
    assert {'mask', 'model.kind', 'beams_stride', 'lidar_beams', 'mount.x'} <= set(
        result['settings']
    )
    page = (maps / 'out' / 'evaluation.html').read_text()
    assert page.count('<img') == 13
    for text in ('map.npz against truth.yaml', 'Held-out beams', 'A scan that may come'):
        assert text in page


def test_probabilities_come_back_from_a_file(maps):
    grid_map = load_grid(maps / 'map.npz')
    assert np.array_equal(grid_map.probability, ESTIMATE, equal_nan=True)
    assert grid_map.spec.origin_x_m == pytest.approx(0.5)
    assert grid_map.spec.origin_y_m == pytest.approx(-0.2)


@pytest.mark.parametrize(
    ('arguments', 'reason'),
    [
        (['nowhere.npz', '--truth', 'truth.yaml'], 'nowhere.npz'),
        (['m=.', '--truth', 'truth.yaml'], 'or an array (.npy, .mat), such as far.npz'),
        (['map.png', '--truth', 'truth.yaml'], 'or an array (.npy, .mat), such as map.npz'),
        (['map.npz', '--truth', 'nowhere.yaml'], 'nowhere.yaml: expected a readable map YAML'),
        (['notes.npz', '--truth', 'truth.yaml'], 'expected an NPZ with probability'),
        (['other.npz', '--truth', 'truth.yaml'], 'expected an NPZ with probability'),
        (['wild.npz', '--truth', 'truth.yaml'], 'expected values from 0 to 1'),
        (['flat.npz', '--truth', 'truth.yaml'], '(any, any)'),
        (['notes.txt', '--truth', 'truth.yaml'], 'probabilities (.npz) or an array (.npy, .mat)'),
        (['map.npz', '--truth', 'coarse.yaml'], 'resolution of the map is 0.1 m'),
        (['map.npz', '--truth', 'truth.yaml', '--mask', 'some'], 'some'),
        (['map.npz', '--truth', 'truth.yaml', '--threshold', '2'], 'threshold is 2.0'),
        (['map.npz', '--truth', 'truth.yaml', '--name', 'a/b'], 'without folders'),
        (['map.npz', '--truth', 'truth.yaml', '-o', 'notes.txt'], 'expected a writable folder'),
        (['map.npz'], 'expected at least one of --truth MAP, --beams BAG, --pose X,Y,YAW'),
        (['map.npz', '--beams', 'nowhere'], 'nowhere: no such file or folder'),
        (['map.npz', '--beams', 'poses'], 'poses: no scans in it'),
        (['map.npz', '--beams', 'bag', '--beams-stride', '0'], 'beams_stride is 0'),
        (['map.npz', '--beams', 'bag', '--clutter', '0'], 'clutter is 0.0'),
        (['map.npz', '--beams', 'bag', '--params-file', 'no.yaml'], 'no.yaml: expected a'),
        (['map.npz', '--beams', 'bag', '--scan-topic', '/pose'], 'topic /pose has type'),
        (
            ['far.npz', '--beams', 'bag', '--leaving', 'exclude', '--no-return', 'clear'],
            'no beam of 3 placed scans says anything (4 left out',
        ),
        (['map.npz', '--beams', 'bag', '--samples', 'other.npz'], 'NPZ with map samples'),
        (['map.npz', '--samples', 'other.npz', '--pose', '0.6,0,0'], 'expected --beams BAG'),
        (['map.npz', '--pose', '0.6,0'], "--pose is '0.6,0': expected X,Y,YAW (m, m, rad)"),
        (['map.npz', '--pose', '0.6,0,north'], 'expected X,Y,YAW'),
        (['map.npz', '--pose', '0.6,0,inf'], 'expected X,Y,YAW'),
        (
            ['map.npz', '--pose', '0.6,0.2,0'],
            'pose (0.6, 0.2) lies outside of the map: expected x from 0.5 to 0.9, y from -0.2 to',
        ),
        (['map.npz', '--pose', '0.6,0,0', '--lidar-beams', '0'], 'lidar_beams is 0'),
    ],
    ids=lambda value: ' '.join(value)[:50] if isinstance(value, list) else '',
)
def test_a_mistake_is_one_line_and_leaves_nothing(
    maps, bag, monkeypatch, capsys, arguments, reason
):
    with BagWriter(maps / 'poses') as poses:
        known = ros_types.pose_with_covariance(1, 'map', Pose2D(), np.zeros((3, 3)))
        poses.write('/pose', ros_types.POSE, 1, known)
    (maps / 'notes.txt').write_text('nothing of use\n')
    (maps / 'notes.npz').write_text('nothing of use\n')
    np.savez(maps / 'other.npz', a=np.zeros(3))
    held = {'resolution': 0.1, 'origin': np.zeros(3)}
    np.savez(maps / 'wild.npz', probability=np.full((2, 2), 7.0), **held)
    np.savez(maps / 'flat.npz', probability=np.zeros(3), **held)
    save_npz(GridMap(GridSpec(0.1, 4, 3, column0=99), ESTIMATE), maps / 'far.npz', {})
    described = yaml.safe_load((maps / 'truth.yaml').read_text())
    (maps / 'coarse.yaml').write_text(yaml.safe_dump({**described, 'resolution': 0.2}))
    before = sorted(maps.rglob('*'))
    monkeypatch.chdir(maps)
    code, _, err = command(capsys, 'evaluate', *arguments)
    assert code == 2
    assert reason in error_line(err)
    assert sorted(maps.rglob('*')) == before

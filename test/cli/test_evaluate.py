"""`evaluate`: the table, the JSON, the page in a real browser, and one line for every mistake."""

import json
import re
import shutil
import subprocess

import numpy as np
import pytest
import yaml

from ogm_mcmc.cli.main import run
from ogm_mcmc.config import OutputConfig
from ogm_mcmc.geometry import GridMap, GridSpec
from ogm_mcmc.io.map_files import load_grid, save_map, save_npz

NAN = np.nan
TRUTH = np.array([[0, 0, 1, 1], [0, 0, 0, 1], [1, 0, 0, NAN]], np.float32)
ESTIMATE = np.array([[0.1, 0.2, 0.9, NAN], [0.1, 0.6, 0.3, 0.8], [0.4, 0.1, 0.2, 0.5]], np.float32)


@pytest.fixture
def maps(tmp_path):
    """map.npz (probabilities) and truth.yaml of the same cells."""
    spec = GridSpec(0.1, 4, 3, column0=5, row0=-2)
    save_npz(GridMap(spec, ESTIMATE), tmp_path / 'map.npz', {'made': 'by hand'})
    save_map(GridMap(spec, TRUTH), tmp_path, OutputConfig(), 'truth')
    return tmp_path


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
def test_the_page_opens_in_a_browser(run_cli, maps):
    """Every picture is decoded, and a picture of the page is not blank."""
    assert run_cli('evaluate', 'map.npz', '--truth', 'truth.yaml', '-o', 'out').returncode == 0
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
    assert '<title>8 pictures shown</title>' in dumped.stdout, dumped.stderr
    shot = maps / 'shot.png'
    subprocess.run(
        [browser(), *flags, f'--screenshot={shot}', page.as_uri()],
        capture_output=True, check=True, timeout=60,
    )  # fmt: skip
    from PIL import Image

    with Image.open(shot) as image:
        assert len(image.convert('RGB').getcolors(10_000_000)) > 50


def test_probabilities_come_back_from_a_file(maps):
    grid_map = load_grid(maps / 'map.npz')
    assert np.array_equal(grid_map.probability, ESTIMATE, equal_nan=True)
    assert grid_map.spec.origin_x_m == pytest.approx(0.5)
    assert grid_map.spec.origin_y_m == pytest.approx(-0.2)


@pytest.mark.parametrize(
    ('arguments', 'reason'),
    [
        (['nowhere.npz', '--truth', 'truth.yaml'], 'nowhere.npz'),
        (['map.npz', '--truth', 'nowhere.yaml'], 'nowhere.yaml: expected a readable map YAML'),
        (['notes.npz', '--truth', 'truth.yaml'], 'expected an NPZ with probability'),
        (['other.npz', '--truth', 'truth.yaml'], 'expected an NPZ with probability'),
        (['wild.npz', '--truth', 'truth.yaml'], 'expected values from 0 to 1'),
        (['flat.npz', '--truth', 'truth.yaml'], 'expected (height, width)'),
        (['notes.txt', '--truth', 'truth.yaml'], 'expected a map YAML (.yaml) or'),
        (['map.npz', '--truth', 'coarse.yaml'], 'resolution of the map is 0.1 m'),
        (['map.npz', '--truth', 'truth.yaml', '--mask', 'some'], 'some'),
        (['map.npz', '--truth', 'truth.yaml', '--threshold', '2'], 'threshold is 2.0'),
        (['map.npz', '--truth', 'truth.yaml', '--name', 'a/b'], 'without folders'),
        (['map.npz', '--truth', 'truth.yaml', '-o', 'notes.txt'], 'expected a writable folder'),
        (['map.npz'], '--truth'),
    ],
    ids=lambda value: ' '.join(value)[:50] if isinstance(value, list) else '',
)
def test_a_mistake_is_one_line_and_leaves_nothing(maps, monkeypatch, capsys, arguments, reason):
    (maps / 'notes.txt').write_text('nothing of use\n')
    (maps / 'notes.npz').write_text('nothing of use\n')
    np.savez(maps / 'other.npz', a=np.zeros(3))
    held = {'resolution': 0.1, 'origin': np.zeros(3)}
    np.savez(maps / 'wild.npz', probability=np.full((2, 2), 7.0), **held)
    np.savez(maps / 'flat.npz', probability=np.zeros(3), **held)
    described = yaml.safe_load((maps / 'truth.yaml').read_text())
    (maps / 'coarse.yaml').write_text(yaml.safe_dump({**described, 'resolution': 0.2}))
    before = sorted(path for path in maps.rglob('*') if path.is_file())
    monkeypatch.chdir(maps)
    try:
        code = run(['evaluate', *arguments])
    except SystemExit as stopped:  # argparse's own
        code = stopped.code
    assert code == 2
    lines = [line for line in capsys.readouterr().err.splitlines() if 'error' in line]
    assert len(lines) == 1
    assert reason in lines[0]
    assert sorted(path for path in maps.rglob('*') if path.is_file()) == before

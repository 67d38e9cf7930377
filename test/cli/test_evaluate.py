"""`evaluate`: every judge by hand, the page in a real browser, one line for every mistake."""

import json
import math
import re
import shutil
import subprocess

import numpy as np
import pytest
import yaml
from scipy import stats
from support.strategies import fan

from ogm_mcmc.cli.main import run
from ogm_mcmc.config import ForwardModelConfig, OutputConfig
from ogm_mcmc.engine.saved_map import save_map
from ogm_mcmc.evaluation import expected_information_gain
from ogm_mcmc.geometry import GridMap, GridSpec, PlacedScan, Pose2D
from ogm_mcmc.io import ros_types
from ogm_mcmc.io.bags import BagWriter
from ogm_mcmc.io.map_files import load_grid, save_npz
from ogm_mcmc.io.recording_bag import write_recording
from ogm_mcmc.io.sample_files import MapSamples, save_samples
from ogm_mcmc.sensors.forward_model import ForwardModel

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


@pytest.fixture
def bag(maps):
    """Scans along the lowest row, to the right and to the left, and one that says nothing."""
    scans = [
        PlacedScan.at(
            fan(0.2, np.inf, 0.05, increment=1e-6, range_max_m=0.3, stamp_ns=1),
            Pose2D(0.55, -0.15),
        ),
        PlacedScan.at(fan(0.2, range_max_m=0.3, stamp_ns=2), Pose2D(0.55, -0.15, np.pi)),
        PlacedScan.at(fan(NAN, range_max_m=0.3, stamp_ns=3), Pose2D(0.55, -0.15)),
    ]
    assert write_recording(maps / 'bag', scans) == 3
    return maps / 'bag'


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


def by_hand(z, first, reach=0.3, clutter=0.05):
    """Log p(z) of the default model, f one of `first` (distance: mass), from the definition."""

    def density(f):
        hit, sigma = 0.95 - clutter, 0.05
        if math.isinf(z):
            beyond = 1.0 if math.isinf(f) else stats.norm.sf(reach, f, sigma)
        else:
            beyond = stats.norm.pdf(z, f, sigma) if math.isfinite(f) else 0.0
        share = 0.05 if math.isinf(z) else clutter / reach
        return share + hit * beyond / stats.norm.sf(0.0, f, sigma)

    return math.log(sum(mass * density(f) for f, mass in first.items()))


# From the middle of a cell, half a cell to its border; hits lie half way through a cell. The
# unknown fourth cell, and those to the left of the map, are occupied with probability 0.3.
AHEAD = {
    0.025: 0.1,
    0.1: 0.9 * 0.2,
    0.2: 0.9 * 0.8 * 0.9,
    0.3: 0.9 * 0.8 * 0.1 * 0.3,
    math.inf: 0.9 * 0.8 * 0.1 * 0.7,
}
BEHIND = {
    0.025: 0.1,
    0.1: 0.9 * 0.3,
    0.2: 0.9 * 0.7 * 0.3,
    0.3: 0.9 * 0.7**2 * 0.3,
    math.inf: 0.9 * 0.7**3,
}


@pytest.fixture
def judged(maps, bag, monkeypatch, capsys):
    """Run `evaluate map.npz --beams bag` with options in this process; returns its JSON."""
    monkeypatch.chdir(maps)

    def call(*options):
        capsys.readouterr()
        arguments = ('evaluate', 'map.npz', '--beams', 'bag', '--unknown', '0.3', '--json')
        assert run([*arguments, '--no-return', 'clear', *options]) == 0
        return json.loads(capsys.readouterr().out)

    return call


def test_beams_by_hand(judged, maps):
    result = judged()
    assert json.loads((maps / 'out' / 'evaluate' / 'evaluation.json').read_text()) == result
    assert 'truth' not in result
    assert 'pose' not in result
    assert result['settings']['model.kind'] == 'beam'
    of = result['beams']
    first = [by_hand(z, AHEAD) for z in (0.2, math.inf, 0.05)]
    values = [*first, by_hand(0.2, BEHIND)]
    mean = np.mean(values)
    assert (of['scans'], of['scans_used'], of['beams'], of['left_out']) == (3, 2, 4, 0)
    assert of['nats_per_beam'] == pytest.approx(mean, rel=1e-4)
    gaps = np.array([sum(first) - 3 * mean, values[3] - mean])
    assert of['standard_error'] == pytest.approx(math.sqrt(2 * (gaps**2).sum()) / 4, rel=1e-4)
    returned = [values[k] for k in (0, 2, 3)]
    assert of['returned']['nats_per_beam'] == pytest.approx(np.mean(returned), rel=1e-4)
    assert of['no_return'] == {
        'beams': 1, 'nats_per_beam': pytest.approx(values[1], rel=1e-4), 'standard_error': None,
    }  # fmt: skip
    assert of['ending_outside']['nats_per_beam'] == pytest.approx(values[3], rel=1e-4)


def test_choosing_beams(judged):
    of = judged('--leaving', 'exclude')['beams']
    assert (of['scans_used'], of['beams'], of['left_out']) == (1, 3, 1)
    assert of['ending_outside'] == {'beams': 0, 'nats_per_beam': None, 'standard_error': None}
    of = judged('--no-return', 'ignore')['beams']
    assert (of['beams'], of['no_return']['beams']) == (3, 0)
    # The first and the third of the scans; the third says nothing.
    of = judged('--beams-stride', '2')['beams']
    assert (of['scans_used'], of['beams']) == (1, 3)
    of = judged('--max-range', '0.1')['beams']
    assert of['returned']['beams'] == 1
    nothing = by_hand(math.inf, {0.025: 0.1, 0.1: 0.18, math.inf: 0.72}, 0.1)
    behind = by_hand(math.inf, {0.025: 0.1, 0.1: 0.27, math.inf: 0.63}, 0.1)
    expected = (2 * nothing + behind) / 3
    assert of['no_return']['nats_per_beam'] == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize('several', [False, True])
def test_what_no_return_means_is_seen_in_the_bag(maps, monkeypatch, capsys, several):
    """By default, as `map` and `sample` do: half of the beams on a wall are lost."""
    ranges = np.where(np.arange(60) % 2, 0.2, np.inf)
    scans = [
        PlacedScan.at(
            fan(*(ranges if k % 2 else ranges[::-1]), increment=1e-6, range_max_m=0.3, stamp_ns=k),
            Pose2D(0.55, -0.15),
        )
        for k in range(1, 9)
    ]
    write_recording(maps / 'lossy', scans)
    monkeypatch.chdir(maps)
    named = ['a=map.npz', 'b=map.npz'] if several else ['map.npz']
    assert run(['evaluate', *named, '--beams', 'lossy']) == 0
    said = capsys.readouterr().out
    assert 'no_return auto: ignore, 100% of the beams without a return cross' in said
    (written,) = (maps / 'out' / 'evaluate').glob('*.json')
    result = json.loads(written.read_text())
    assert result['settings']['window.no_return'] == 'ignore'
    beams = result['maps']['a']['beams'] if several else result['beams']
    assert beams['no_return']['beams'] == 0
    assert result['beams']['meaning_of_no_return']['value'] == 'ignore'


def test_another_model(judged, maps):
    """By an option, and by the YAML of the sampler's node."""
    (maps / 'node.yaml').write_text('/**:\n  ros__parameters:\n    model: {clutter: 0.4}\n')
    by_option, by_file = judged('--clutter', '0.4'), judged('--params-file', 'node.yaml')
    assert by_option['settings'] == by_file['settings']
    assert by_option['beams'] == by_file['beams']
    values = [by_hand(z, AHEAD, clutter=0.4) for z in (0.2, math.inf, 0.05)]
    values.append(by_hand(0.2, BEHIND, clutter=0.4))
    assert by_file['beams']['nats_per_beam'] == pytest.approx(np.mean(values), rel=1e-4)
    gaussian = judged('--model', 'gaussian', '--no-return', 'ignore')['beams']
    values = []
    for z, first in ((0.2, AHEAD), (0.05, AHEAD), (0.2, BEHIND)):
        density = sum(m * stats.norm.pdf(z, min(f, 0.3), 0.05) for f, m in first.items())
        values.append(math.log(density))
    assert gaussian['nats_per_beam'] == pytest.approx(np.mean(values), rel=1e-4)


def test_samples_are_a_mixture(judged, maps):
    """Cells that no ray came to are unknown in the samples as in the map."""
    cells = np.zeros((2, 3, 4), np.uint8)
    cells[0, 0, 2] = cells[1, 0, 1] = 1
    touched = np.isfinite(ESTIMATE)
    spec = GridSpec(0.1, 4, 3, column0=5, row0=-2)
    save_samples(MapSamples(spec, cells, touched, touched), maps / 'drawn.npz', 1, {})
    of = judged('--samples', 'drawn.npz', '--leaving', 'exclude')['beams']
    expected = [by_hand(z, {0.2: 0.5, 0.1: 0.5}) for z in (0.2, math.inf, 0.05)]
    mixture = of['samples']
    assert (mixture['maps'], mixture['beams']) == (2, 3)
    assert mixture['nats_per_beam'] == pytest.approx(np.mean(expected), rel=1e-4)
    above = mixture['nats_per_beam'] - of['nats_per_beam']
    assert mixture['above_map']['nats_per_beam'] == pytest.approx(above)


def test_what_a_scan_from_a_pose_would_tell(run_cli, maps):
    lidar = ('--lidar-beams', '3', '--lidar-range-max', '0.3', '--lidar-field-of-view', '90')
    done = run_cli('evaluate', 'map.npz', '--pose', '0.55,-0.15,0', '--unknown', '0.3', *lidar)
    assert done.returncode == 0, done.stderr
    result = json.loads((maps / 'out' / 'evaluate' / 'evaluation.json').read_text())
    assert 'beams' not in result
    of = result['pose']
    p = ESTIMATE[np.isfinite(ESTIMATE)].astype(float)
    known = -(p * np.log(p) + (1 - p) * np.log(1 - p)).sum()
    unknown = stats.entropy([0.3, 0.7])
    assert (of['measured_cells'], of['unknown_cells']) == (11, 1)
    assert of['entropy_measured_nats'] == pytest.approx(known, rel=1e-6)
    assert of['entropy_nats'] == pytest.approx(known + unknown, rel=1e-6)
    gains = of['information_gain_of_beams']
    here, bearings = Pose2D(0.55, -0.15), np.radians([-45.0, 0.0, 45.0])
    model = ForwardModel.from_config(ForwardModelConfig())
    grid_map = load_grid(maps / 'map.npz')
    expected = expected_information_gain(grid_map, here, bearings, 0.3, model, prior=0.3)
    assert gains == pytest.approx(expected)
    # Less than readings without noise would tell, which is the entropy of where the beam ends.
    assert 0.0 < gains[1] < stats.entropy(list(AHEAD.values()))
    assert of['information_gain_nats'] == pytest.approx(sum(gains))
    assert re.search(r'entropy of the map, nats +\d+\.\d+ \(1 cells unknown\)', done.stdout)
    assert re.search(r'scan from 0\.55, -0\.15, 0 +at most \d', done.stdout)


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


def test_points_by_hand(judged):
    """Free at 0.04, 0.12 (and 0.2) m along beams; ends at 0.2 and 0.05 m; outside is unknown."""
    result = judged('--points', '--point-step', '0.08')
    of = result['points']
    # Ahead: 0.2 m long, none in 0.3 m, 0.05 m; behind: 0.2 m, out of the map.
    free = [0.1, 0.2, 0.1, 0.2, 0.9, 0.1, 0.3]
    ends = [0.9, 0.2, 0.3]
    assert (of['points'], of['occupied_points']) == (len(free) + len(ends), len(ends))
    losses = np.concatenate((-np.log1p(-np.array(free)), -np.log(ends)))
    brier = np.concatenate((np.square(free), np.square(1 - np.array(ends))))
    assert of['log_loss']['value'] == pytest.approx(losses.mean(), rel=1e-5)
    assert of['brier_score']['value'] == pytest.approx(brier.mean(), rel=1e-5)
    above = np.mean([[(e > f) + 0.5 * (e == f) for f in free] for e in ends])
    assert of['roc_area'] == pytest.approx(above)
    assert result['settings']['point_step'] == 0.08
    assert 'points' not in judged()


def test_points_want_beams(run_cli, maps):
    done = run_cli('evaluate', 'map.npz', '--truth', 'truth.yaml', '--points')
    assert done.returncode == 2
    assert done.stderr.strip().endswith('--points: expected --beams BAG, whose beams they lie on')

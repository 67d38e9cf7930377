"""`evaluate --beams`: what beams say of a map, against the definition by hand."""

import json
import math
import re

import numpy as np
import pytest
from scipy import stats
from support.small_maps import ESTIMATE
from support.strategies import fan

from ogm_mcmc.cli.main import run
from ogm_mcmc.config import ForwardModelConfig
from ogm_mcmc.evaluation import expected_information_gain
from ogm_mcmc.geometry import GridSpec, PlacedScan, Pose2D
from ogm_mcmc.io.map_files import load_grid
from ogm_mcmc.io.recording_bag import write_recording
from ogm_mcmc.io.sample_files import MapSamples, save_samples
from ogm_mcmc.sensors.forward_model import ForwardModel


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


@pytest.mark.parametrize(
    ('option', 'value', 'judge'),
    [
        ('--point-step', '0.1', '--points'),
        ('--beams-stride', '2', '--beams BAG'),
        ('--lidar-beams', '9', '--pose X,Y,YAW'),
        ('--robot-radius', '0.2', '--path FILE'),
    ],
)
def test_settings_of_a_judge_that_is_not_asked_are_refused(run_cli, maps, option, value, judge):
    done = run_cli('evaluate', 'map.npz', '--truth', 'truth.yaml', option, value)
    assert done.returncode == 2
    assert done.stderr.strip().endswith(f'{option}: expected {judge} with it')

"""`evaluate` of several maps: their figures are those of one, their differences are paired."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
import yaml
from PIL import Image
from support.rooms import path_through, scans_of
from support.strategies import fan

from ogm_mcmc.cli.evaluate_several import named_maps
from ogm_mcmc.cli.main import run
from ogm_mcmc.config import MapperConfig, OutputConfig
from ogm_mcmc.engine.live_map import map_of
from ogm_mcmc.engine.saved_map import save_map
from ogm_mcmc.errors import ConfigError
from ogm_mcmc.geometry import GridMap, GridSpec, PlacedScan, Pose2D
from ogm_mcmc.io.map_files import save_npz
from ogm_mcmc.io.recording_bag import write_recording

SPEC = GridSpec(0.1, 4, 3)
TRUTH = np.array([[0, 0, 1, 1], [0, 0, 0, 1], [1, 0, 0, 0]], np.float32)
GOOD = np.where(TRUTH > 0, 0.9, 0.1).astype(np.float32)
POOR = np.where(TRUTH > 0, 0.6, 0.3).astype(np.float32)

SECOND = 1_000_000_000
FRAME = Pose2D(1.5, -0.7, 0.9)


@pytest.fixture
def theirs(tmp_path, monkeypatch):
    """good.npz; poor as percents in greys of a raw map image; poor as an NPY; truth; a bag."""
    monkeypatch.chdir(tmp_path)
    save_npz(GridMap(SPEC, GOOD), tmp_path / 'good.npz', {})
    save_map(GridMap(SPEC, TRUTH), tmp_path, OutputConfig(), 'truth')
    greys = np.rint(100 * POOR[::-1]).astype(np.uint8)
    Image.fromarray(greys).save(tmp_path / 'raw.png')
    grid = {'resolution': 0.1, 'origin': [0.0, 0.0, 0.0]}
    image = {'image': 'raw.png', 'mode': 'raw', 'negate': 0}
    image |= {'occupied_thresh': 0.65, 'free_thresh': 0.196, **grid}
    (tmp_path / 'raw.yaml').write_text(yaml.safe_dump(image))
    np.save(tmp_path / 'poor.npy', POOR)
    (tmp_path / 'poor.yaml').write_text(yaml.safe_dump(grid))
    scans = [
        PlacedScan.at(
            fan(0.2, 0.2, increment=1e-6, range_max_m=0.3, stamp_ns=SECOND), Pose2D(0.05, 0.05)
        ),
        PlacedScan.at(fan(0.1, range_max_m=0.3, stamp_ns=2 * SECOND), Pose2D(0.15, 0.05)),
        PlacedScan.at(fan(0.3, range_max_m=0.4, stamp_ns=3 * SECOND), Pose2D(0.05, 0.15)),
    ]
    assert write_recording(tmp_path / 'bag', scans) == 3
    return tmp_path


def asked(capsys, *arguments):
    capsys.readouterr()
    assert run(['evaluate', *arguments, '--json']) == 0
    return json.loads(capsys.readouterr().out)


def test_unmoved_cells_of_sampled_maps_are_judged_by_their_mean(theirs, capsys):
    moved = GOOD.copy()
    moved[1:, 1:] = np.nan
    save_npz(GridMap(SPEC, moved), theirs / 'sampled.npz', {}, {'posterior_mean': GOOD})
    judges = ('--truth', 'truth.yaml', '--beams', 'bag', '--points', '--point-step', '0.1')
    good = asked(capsys, 'good.npz', *judges)
    sampled = asked(capsys, 'sampled.npz', *judges)
    assert sampled['measured_cells'] == 6
    for figure in ('divergence_nats', 'roc_area', 'brier_score', 'cells', 'points'):
        assert sampled[figure] == good[figure]
    assert sampled['beams']['nats_per_beam'] == good['beams']['nats_per_beam']
    both = asked(capsys, 'a=good.npz', 'b=sampled.npz', *judges)
    assert [one['nats_per_beam'] for one in both['beams']['differences']] == [0.0]
    assert [one['nearer'] for one in both['truth']['differences']] == [0.0]
    # Asked to, it takes them all for as unknown as those never measured.
    even = asked(capsys, 'sampled.npz', *judges, '--unknown', '0.5')
    assert even['divergence_nats'] > good['divergence_nats']
    assert even['beams']['nats_per_beam'] < good['beams']['nats_per_beam']


def test_against_truth_and_beams(theirs, capsys):
    judges = ('--truth', 'truth.yaml', '--beams', 'bag')
    points = ('--points', '--point-step', '0.1')
    result = asked(capsys, 'ours=good.npz', 'raw=raw.yaml', 'poor.npy', *judges, *points)
    assert list(result['maps']) == ['ours', 'raw', 'poor']
    without = asked(capsys, 'ours=good.npz', 'raw=raw.yaml', *judges)
    assert 'points' not in without['maps']['ours']['beams']
    singles = [
        asked(capsys, name, *judges, *points) for name in ('good.npz', 'raw.yaml', 'poor.npy')
    ]
    for one, alone in zip(result['maps'].values(), singles, strict=True):
        assert one['truth']['divergence_nats'] == alone['divergence_nats']
        assert one['beams']['nats_per_beam'] == alone['beams']['nats_per_beam']
        assert one['beams']['ending_outside'] == alone['beams']['ending_outside']
        assert one['beams']['points'] == alone['points']
    first, same, of_both = (result['beams']['differences'][k] for k in (0, 2, 1))
    assert (first['map'], first['against']) == ('ours', 'raw')
    gap = singles[0]['beams']['nats_per_beam'] - singles[1]['beams']['nats_per_beam']
    assert first['nats_per_beam'] == pytest.approx(gap)
    assert first['nats_per_beam'] == pytest.approx(of_both['nats_per_beam'])
    assert (first['scans_won'], first['scans_lost']) == (3, 0)
    # Paired, two maps that say the same have no error, whatever that of each.
    assert abs(same['nats_per_beam']) < 1e-6 > same['standard_error']
    assert singles[1]['beams']['standard_error'] > 0.01
    nearer = np.log(np.where(TRUTH > 0, 0.9 / 0.6, 0.9 / 0.7)).sum()
    by_truth = result['truth']['differences'][0]
    assert by_truth['nearer'] == pytest.approx(nearer, rel=1e-5)
    assert (by_truth['cells_won'], by_truth['cells_lost']) == (12, 0)


def test_table_and_page(theirs, capsys):
    arguments = ('ours=good.npz', 'theirs=poor.npy', '--truth', 'truth.yaml', '--beams', 'bag')
    assert run(['evaluate', *arguments, '--points', '-o', 'out']) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split()[0] == 'map'
    assert [line.split()[0] for line in lines[1:3]] == ['ours', 'theirs']
    assert lines[3].startswith('ours against theirs: ')
    assert lines[4].startswith('ours against theirs: +')
    assert 'nats a beam, paired by scan; better in 3 scans, worse in 0' in lines[4]
    page = (theirs / 'out' / 'evaluation.html').read_text()
    # Two maps, the truth, reliability and wins by cells; reliability and wins by beams.
    assert page.count('<img') == 7
    assert 'blue where ours is better than theirs' in page
    files = [('ours', 'good.npz'), ('theirs', 'poor.npy'), ('--truth', 'truth.yaml')]
    for what, file in [*files, ('--beams', 'bag')]:
        assert f'<tr><td>{what}</td><td>{file}</td></tr>' in page


def test_pairs_of_many_maps_are_a_table_and_the_best_is_drawn_beside_the_others(theirs, capsys):
    arguments = ('raw.yaml', 'a=poor.npy', 'best=good.npz', 'b=poor.npy', '--beams', 'bag')
    assert run(['evaluate', *arguments, '--truth', 'truth.yaml', '-o', 'out']) == 0
    by_truth, by_beams = capsys.readouterr().out.split('\n\n')[1:]
    result = json.loads((theirs / 'out' / 'evaluation.json').read_text())
    assert len(result['beams']['differences']) == len(result['truth']['differences']) == 6
    one = result['beams']['differences'][3]
    assert (one['map'], one['against']) == ('a', 'best')
    gain = -one['nats_per_beam']
    assert gain > 0.0
    rows = by_beams.splitlines()
    assert ' '.join(rows[0].split()) == 'nats a beam more, paired by scan, than raw a best b'
    assert rows[3].startswith('best')
    assert f'  {gain:+.4f} +- ' in rows[3]
    assert f'  {-gain:+.4f} +- ' in rows[2]
    nearer = result['truth']['differences'][3]['nearer']
    rows = by_truth.splitlines()
    assert ' '.join(rows[0].split()) == 'nats nearer to the truth than raw a best b'
    assert f'  {-nearer:+.6g}' in rows[3]
    assert f'  {nearer:+.6g}' in rows[2]
    page = (theirs / 'out' / 'evaluation.html').read_text()
    # Four maps, the truth, reliability; three pairs each.
    assert page.count('<img') == 12
    assert page.count('blue where best is better than a,') == 4  # captions and their alt texts
    assert 'better than best' not in page
    assert '<th>nats nearer to the truth than</th><th>raw</th>' in page


def test_maps_of_other_grids_are_judged_by_the_same_beams(theirs, capsys):
    """A map of fewer and larger cells; `exclude` leaves out what ends outside of any map."""
    coarse = GridMap(GridSpec(0.15, 2, 2), np.full((2, 2), 0.3, np.float32))
    save_npz(coarse, theirs / 'coarse.npz', {})
    result = asked(capsys, 'good.npz', 'coarse.npz', '--beams', 'bag')
    assert [one['beams']['beams'] for one in result['maps'].values()] == [4, 4]
    outside = [one['beams']['ending_outside']['beams'] for one in result['maps'].values()]
    assert outside == [0, 1]
    assert run(['evaluate', 'good.npz', 'coarse.npz', '--beams', 'bag', '-o', 'out']) == 0
    header, good, coarse_row = capsys.readouterr().out.splitlines()[:3]
    at = header.index('end outside')
    assert (good[at:].split()[0], coarse_row[at:].split()[0]) == ('0', '1')
    result = asked(capsys, 'good.npz', 'coarse.npz', '--beams', 'bag', '--leaving', 'exclude')
    assert [one['beams']['beams'] for one in result['maps'].values()] == [3, 3]
    assert result['beams']['left_out'] == 1


@pytest.mark.parametrize(
    ('arguments', 'said'),
    [
        (('good.npz', 'x=good.npz', '--truth', 'truth.yaml', '--pose', '0,0,0'), '--pose with 2'),
        (('good.npz', 'good.npz', '--truth', 'truth.yaml'), 'second map of name good'),
        (('a=good.npz', '=poor.npy', '--truth', 'truth.yaml'), "'=poor.npy': expected NAME=MAP"),
        (('a=good.npz', 'b=', '--truth', 'truth.yaml'), 'map b is empty: expected a path'),
        (('a=good.npz', 'b=coarse.npz', '--truth', 'truth.yaml'), 'b: resolution of the map is'),
        (('a=good.npz', 'b=none.npz', '--truth', 'truth.yaml'), 'none.npz: '),
    ],
)
def test_what_is_wrong_is_one_line(theirs, capsys, arguments, said):
    save_npz(GridMap(GridSpec(0.2, 2, 2), GOOD[:2, :2]), theirs / 'coarse.npz', {})
    assert run(['evaluate', *arguments]) == 2
    error = capsys.readouterr().err.strip()
    assert said in error
    assert '\n' not in error


def test_names(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'a=b.npz').touch()
    assert list(named_maps(['a=b.npz', 'maps/c.npz', 'd=e=f.npz'])) == ['a=b', 'c', 'd']
    assert named_maps(['d=e=f.npz'])['d'].name == 'e=f.npz'
    with pytest.raises(ConfigError, match='without NUL'):
        named_maps(['a\0.npz'])


def test_a_map_too_far_away_for_beams_is_named(theirs, capsys):
    far = GridMap(GridSpec(0.1, 4, 3, anchor_x_m=-1e18), POOR)
    save_npz(far, theirs / 'far.npz', {})
    assert run(['evaluate', 'good.npz', 'theirs=far.npz', '--beams', 'bag']) == 2
    said = capsys.readouterr().err
    assert 'error: theirs: pose (' in said
    assert 'too far from the map' in said


@pytest.fixture(scope='module')
def drive(tmp_path_factory):
    """A map of a room; the same of a SLAM system that began elsewhere; one of nothing there."""
    folder = tmp_path_factory.mktemp('frames')
    poses = path_through(12)
    scans = scans_of(poses, 60, 0.01)
    poses[:, :2] += 0.05  # walls in the middle of cells
    placed = [
        PlacedScan.at(replace(scan, stamp_ns=k * SECOND), Pose2D(*pose))
        for k, (scan, pose) in enumerate(zip(scans, poses, strict=True), 1)
    ]
    began = FRAME.inverse()
    of_slam = [PlacedScan.at(scan, began.compose(one.mean)) for scan, one in placed]
    config = MapperConfig(resolution=0.1)
    save_npz(map_of(placed, config), folder / 'ours.npz', {})
    save_npz(map_of(of_slam, config), folder / 'theirs.npz', {})
    for name, off in (('near', 0.25), ('far', 50.0)):
        away = [PlacedScan.at(scan, Pose2D(off, 0.2).compose(one.mean)) for scan, one in placed]
        save_npz(map_of(away, config).cropped(), folder / f'{name}.npz', {})
    speckle = np.random.default_rng(1).random((50, 70)) < 0.1
    save_npz(
        GridMap(GridSpec(0.1, 70, 50), np.where(speckle, 0.9, 0.1).astype(np.float32)),
        folder / 'other.npz',
        {},
    )
    write_recording(folder / 'bag', placed)
    write_recording(folder / 'one', placed[:1])
    return folder


def test_maps_in_other_frames_are_found_and_judged_there(drive, monkeypatch, capsys):
    monkeypatch.chdir(drive)
    maps = ('ours.npz', 'theirs.npz', 'other.npz')
    judge = ('--beams', 'bag', '--unknown', '0.15', '--points')
    looked = (*judge, '--align', '--align-reach', '4', '--align-turn', '60')
    given = asked(capsys, 'ours.npz', *judge)
    result = asked(capsys, *maps, *looked)
    assert given['beams']['scans_used'] == 12
    assert 'alignment' not in given['beams']
    assert 'hint' not in given['beams']
    hinted = asked(capsys, 'far=far.npz', 'near=near.npz', *judge)['beams']['hints']
    assert [line.split(' ')[0] for line in hinted] == ['far:', 'near:']
    assert 'of the beams end where it has no cells: does it lie in' in hinted[0]
    assert 'moved a little it has' in hinted[1]
    alone = asked(capsys, 'near.npz', *judge)['beams']['hint']
    assert hinted[1] == f'near: {alone}'
    assert result['settings']['align'] is True
    ours, theirs, other = (result['maps'][name]['beams'] for name in ('ours', 'theirs', 'other'))
    assert result['beams']['scans_used'] == 6
    found = theirs['alignment']
    here = Pose2D(3.0, 2.0)
    frame = Pose2D(found['x_m'], found['y_m'], found['yaw_rad'])
    off = FRAME.inverse().compose(here).inverse().compose(frame.inverse().compose(here))
    assert math.hypot(off.x_m, off.y_m) < 0.05
    assert abs(off.yaw_rad) < math.radians(0.4)
    assert found['fits'] is True
    assert found['above_as_given']['nats_per_beam'] > 1.0
    # Cells lie otherwise on the walls, that is all.
    assert theirs['nats_per_beam'] == pytest.approx(ours['nats_per_beam'], abs=0.3)
    assert theirs['points']['roc_area'] == pytest.approx(ours['points']['roc_area'], abs=0.03)
    assert theirs['ending_outside']['beams'] == 0
    assert other['alignment']['fits'] is False
    said = result['beams']['alignments']
    assert [line.split(':')[0] for line in said] == ['ours', 'theirs', 'other']
    assert 'fits nowhere for sure' in said[2]
    assert said[2].endswith('; --align-reach 0 --align-turn 180 look everywhere')
    # One map before the same judge.
    alone = asked(capsys, 'theirs.npz', *looked)
    assert alone['beams']['alignment'] == found
    assert alone['beams']['nats_per_beam'] == theirs['nats_per_beam']
    assert alone['points'] == theirs['points']


@pytest.mark.parametrize(
    ('options', 'said'),
    [
        (('--truth', 'ours.npz', '--align'), '--align: expected --beams BAG'),
        (('--beams', 'bag', '--align-turn', '9'), '--align-turn: expected --align with it'),
        (('--beams', 'bag', '--truth', 'ours.npz', '--align'), '--align with --truth'),
        (('--beams', 'one', '--align'), 'one: 1 scan for --align: expected at least 2'),
        (('--beams', 'bag', '--align', '--align-turn', '181'), 'align_turn'),
    ],
)
def test_what_align_cannot_do_is_one_line(drive, monkeypatch, capsys, options, said):
    monkeypatch.chdir(drive)
    for maps in (('ours.npz',), ('ours.npz', 'theirs.npz')):
        assert run(['evaluate', *maps, *options]) == 2
        assert said in capsys.readouterr().err.splitlines()[-1]

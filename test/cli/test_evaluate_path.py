"""`evaluate --path`: a way asked of saved samples, and the mistakes it names."""

import json

import numpy as np
import pytest
from support.commands import command

from ogm_mcmc.engine.collision import chance_of_unknown
from ogm_mcmc.engine.refined_map import RefinedMap
from ogm_mcmc.geometry import GridMap, GridSpec, Pose2D, SampleBits
from ogm_mcmc.io.sample_files import MapSamples, load_samples, save_samples
from ogm_mcmc.io.trajectory_files import write_tum

WAY = [(0.15, 0.15), (0.45, 0.15), (0.85, 0.15)]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Four maps of 3 x 7 cells of 0.1 m; one has a door in its column 3; the last is unknown."""
    monkeypatch.chdir(tmp_path)
    maps = np.zeros((4, 3, 7), np.uint8)
    maps[1, :, 3] = 1
    every = np.ones((3, 7), bool)
    samples = MapSamples(GridSpec(0.1, 7, 3), maps, every, every)
    save_samples(samples, tmp_path / 's.npz', 1, {})
    # The door is where data moved nothing: the prior drew it.
    moved = np.arange(7) < np.full((3, 1), 3)
    save_samples(samples._replace(known=moved, prior=0.4), tmp_path / 'prior.npz', 1, {})
    (tmp_path / 'way.csv').write_text('x,y\n' + ''.join(f'{x},{y}\n' for x, y in WAY))
    write_tum(tmp_path / 'way.txt', [1, 2, 3], [Pose2D(x, y, 0.3) for x, y in WAY])
    return tmp_path


@pytest.mark.parametrize('file', ['way.csv', 'way.txt'])
def test_answers(folder, capsys, file):
    code, out, err = command(
        capsys, 'evaluate', '--path', file, '--samples', 's.npz', '--robot-radius', '0.06',
        '--unknown', '0.2', '--json',
    )  # fmt: skip
    assert code == 0, err
    found = json.loads(out)['path']
    # The second place is 5 cm from the door, the third off the map, the way goes past both.
    assert found['risk'] == pytest.approx([0.0, 0.25, 0.2])
    assert found['whole_way'] == pytest.approx(0.25 + 0.75 * 0.2)
    assert (found['places'], found['samples']['maps']) == (3, 4)
    assert found['unknown_places'] == 1
    assert 'Way' in (folder / 'out' / 'evaluate' / 'evaluation.html').read_text()


@pytest.mark.parametrize('said', [[], ['--unknown', '0.2']])
def test_what_data_did_not_move_is_one_chance_as_on_collision_query(folder, capsys, said):
    code, out, err = command(
        capsys, 'evaluate', '--path', 'way.csv', '--samples', 'prior.npz', '--robot-radius',
        '0.06', '--json', *said,
    )  # fmt: skip
    assert code == 0, err
    found = json.loads(out)
    path = found['path']
    assert path['unknown_places'] == 2
    samples = load_samples(folder / 'prior.npz')
    bits = SampleBits.of_maps(samples.spec, samples.maps, samples.touched)
    mean = np.where(samples.known, np.float32(0.1), np.float32(np.nan))
    shown = GridMap(samples.spec, mean)
    bits = bits.known_in(shown)
    unknown = 0.2 if said else chance_of_unknown(bits, 0.4)
    assert [*path['risk'], path['whole_way']] == pytest.approx([0.0, unknown, unknown, unknown])
    assert found['settings']['unknown'] == unknown
    node = RefinedMap(1, shown, shown, 0.4, 4, 1, 0, True, samples=bits, unknown=unknown)
    if not said:
        answer = node.collision_risk(np.array(WAY), 0.06).tolist()
        assert answer == [*path['risk'], path['whole_way']]


def test_a_way_off_the_maps_says_so(folder, capsys):
    (folder / 'off.csv').write_text('0.1,0.1\n50,0.1\n')
    code, out, err = command(capsys, 'evaluate', '--path', 'off.csv', '--samples', 's.npz')
    assert code == 0, err
    assert '  places in unknown space    1 of 2' in out


@pytest.mark.parametrize(
    ('arguments', 'said'),
    [
        (['--path', 'way.csv'], '--path way.csv: expected --samples FILE'),
        (['--samples', 's.npz'], 'expected at least one of'),
        (['--path', 'none.csv', '--samples', 's.npz'], 'none.csv: expected lines x,y'),
        (['--path', 'bad.csv', '--samples', 's.npz'], 'bad.csv: line 2: 1, nan'),
        (['--path', 'way.csv', '--samples', 'way.txt'], 'way.txt: expected an NPZ with map'),
        (['--path', 'way.csv', '--samples', 's.npz', '--robot-radius', '-1'], 'robot_radius'),
    ],
)
def test_mistakes_are_named_in_a_line(folder, capsys, arguments, said):
    (folder / 'bad.csv').write_text('0.1,0.1\n1,nan\n')
    code, _, err = command(capsys, 'evaluate', *arguments)
    assert code == 2
    assert said in err
    assert 'Traceback' not in err

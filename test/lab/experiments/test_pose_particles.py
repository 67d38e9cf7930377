"""Two particles in a corridor by hand, and the recorded log in coarse cells."""

import json
import math

import numpy as np
import pytest
from PIL import Image
from support.strategies import fan

from ogm_mcmc.config import MapperConfig
from ogm_mcmc.errors import ConfigError
from ogm_mcmc.geometry import GridMap, GridSpec, PlacedScan, Pose2D, PoseBelief, PoseSamples
from ogm_mcmc.lab.experiments.pose_particles import (
    Believed,
    compare_maps,
    draw,
    held_out_likelihood,
    maps_of,
    read_log,
    run,
)
from ogm_mcmc.plotting.grids import BOTTOM, LEFT, LEGEND, RIGHT, TOP

approx = pytest.approx

CONFIG = MapperConfig(resolution=0.1, no_return='ignore')


def believed(weights=(0.7, 0.3), known_x=0.25):
    """The wall is 2 m ahead; the likelier of two particles is wrong by 0.2 m, or of three."""
    places = [[0.05, 0.05, 0.0], [0.25, 0.05, 0.0]][: len(weights)]
    particles = PoseSamples.checked(places, np.array(weights))
    return Believed(
        PlacedScan(fan(2.0), PoseBelief(particles.mean(), None, particles)), Pose2D(known_x, 0.05)
    )


def test_likeliest_particle():
    assert believed().likeliest == Pose2D(0.05, 0.05, 0.0)
    assert believed((0.3, 0.7)).likeliest == Pose2D(0.25, 0.05, 0.0)


def test_maps_differ_where_the_beliefs_do():
    maps = maps_of(CONFIG, [believed()])
    walls = {
        name: found.spec.column0 + int(np.nanargmax(found.probability[0]))
        for name, found in maps.items()
    }
    assert walls == {
        'likeliest particle': 20, 'mean pose': 21, 'all particles': 20, 'final map': 22,
    }  # fmt: skip
    # The wall of the lighter particle has three tenths of the log-odds.
    probability = maps['all particles'].probability[0, 22 - maps['all particles'].spec.column0]
    assert probability == approx(1 / (1 + math.exp(-0.3 * 1.3863)), abs=1e-4)


def test_table_of_a_perfect_and_a_wrong_map():
    one = believed()
    maps = maps_of(CONFIG, [one, one, one])
    benchmark = maps.pop('final map')
    maps['perfect'] = benchmark
    rows, curves = compare_maps(maps, benchmark, [one, one])
    found = {line['what']: line['ours'] for line in rows}
    assert found['perfect, ROC area'] == 1.0
    assert found['likeliest particle, best F1'] < found['perfect, best F1'] == 1.0
    assert found['perfect, Brier score'] < found['likeliest particle, Brier score']
    judge = 'nats per held-out beam, sigma 0.05 m'
    assert found[f'all - likeliest, {judge}'] == approx(
        found[f'all particles, {judge}'] - found[f'likeliest particle, {judge}']
    )
    assert found[f'final map, {judge}'] > found[f'likeliest particle, {judge}']
    assert [name for name, _ in curves] == list(maps)


def test_likelihood_of_a_held_out_beam_on_paper():
    """A certain wall in cell 20, hit at its middle: p(z) = 0.9 N(0; 0.1) + 0.1 / 80."""
    probability = np.zeros((1, 30), np.float32)
    probability[0, 20] = 1.0
    grid_map = GridMap(GridSpec(0.1, 30, 1), probability)
    one = Believed(believed().placed, Pose2D(0.05, 0.05))
    expected = math.log(0.9 / (0.1 * math.sqrt(2 * math.pi)) + 0.1 / 80)
    assert held_out_likelihood(grid_map, [one, one], 0.1) == approx([expected] * 2, abs=1e-4)


def test_pictures(tmp_path):
    one = believed()
    maps = maps_of(CONFIG, [one, one])
    draw(tmp_path, maps, maps.pop('final map'), [one, one])
    with Image.open(tmp_path / 'close-up.png') as picture:
        pixels = np.asarray(picture.convert('RGB'))
    # Four pixels a cell of 0.1 m, 8 m around the robot in cell 2, row 0; three maps.
    across, upwards = LEFT + 320 + RIGHT, TOP + LEGEND + 320 + BOTTOM
    assert pixels.shape == (2 * upwards, 2 * across, 3)

    def colour(x_m, *, column=0, line=0):
        at = LEFT + column * across + 40 * (x_m - 0.2 + 4.0)
        down = TOP + LEGEND + line * upwards + 320 - 40 * 4.05
        return tuple(pixels[int(down), int(at)])

    wall = [(colour(2.05), colour(2.25)), (colour(2.05, column=1), colour(2.25, column=1))]
    assert wall[0][1] == (190, 198, 208)
    assert wall[0][0] < wall[1][0] < wall[1][1] < (127, 127, 127)
    assert colour(2.05, line=1)[0] > 200  # the final map: free before its own wall
    assert colour(2.25, line=1) == wall[0][0]
    blue, red = (31, 119, 180), (214, 39, 40)
    assert [colour(x, column=1) for x in (0.05, 0.25)] == [blue, blue]
    assert colour(0.25, line=1) == red
    assert colour(0.05, line=1) != red


def test_without_the_log_it_says_what_it_needs(tmp_path, monkeypatch):
    monkeypatch.setenv('OGM_MCMC_DATA', str(tmp_path))
    with pytest.raises(ConfigError, match='no such file; expected OGM_MCMC_DATA to name a folder'):
        run(tmp_path, quick=True, seed=1)


@pytest.mark.full
@pytest.mark.data
def test_recorded_particles(data_folder, tmp_path, monkeypatch):
    """All particles rank cells better than the likeliest one, in both inverse models."""
    monkeypatch.setenv('OGM_MCMC_DATA', str(data_folder))
    assert len(read_log(data_folder / 'csail' / 'csail.corrected.gfs')) == 406
    result = run(tmp_path, quick=True, seed=1)
    found = {line['what']: line['ours'] for line in result['rows']}
    json.dumps(result['rows'])
    for model in ('step', 'gaussian'):
        for figure in ('ROC area', 'best F1'):
            likeliest = found[f'{model}: likeliest particle, {figure}']
            assert found[f'{model}: all particles, {figure}'] > likeliest
    assert {path.name for path in tmp_path.iterdir()} == set(result['pictures'])

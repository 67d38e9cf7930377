"""The simulator's benchmark measures what it says."""

import json

import numpy as np
import pytest

from ogm_mcmc.cli.main import run
from ogm_mcmc.geometry import GridSpec
from ogm_mcmc.lab.benchmarks.simulation import time_simulation
from ogm_mcmc.simulation import GridWorld, Lidar


def test_cells_of_a_closed_room():
    """Four beams from a robot in a square room, from its cell to the wall's, both counted."""
    occupied = np.ones((23, 23))
    occupied[1:-1, 1:-1] = 0
    world = GridWorld.checked(GridSpec(0.1, 23, 23), occupied)
    result = time_simulation(world, Lidar(4, range_max_m=9.0), repeats=2, max_scans=5)
    assert result['data_set']['scans'] == 5
    assert result['beams']['beams'] == 20
    # A cross of four beams walks through 21 free cells at least, and meets four walls.
    assert 5 * (21 + 4) <= result['beams']['cells'] <= 5 * 4 * 40
    assert result['beams']['ns_per_cell'] == pytest.approx(
        1e6 * result['beams']['ms'] / result['beams']['cells'], rel=0.01
    )


@pytest.mark.jit
def test_the_command(capsys):
    arguments = ['bench', 'simulate', '--world', 'building-10', '--repeats', '1']
    assert run([*arguments, '--scans', '10']) == 0
    result = json.loads(capsys.readouterr().out)
    assert result['data_set']['scans'] == 10
    assert result['beams']['beams'] == 1800
    assert result['beams']['ns_per_cell'] > 0.0
    assert run(['bench', 'simulate', '--world', 'office']) == 2
    assert 'made of cells' in capsys.readouterr().err


@pytest.mark.parametrize(
    ('arguments', 'reason'),
    [
        (['--scans', '0'], '--scans is 0: expected 1 to'),
        (['--beams', '0'], '--beams is 0: expected 1 to 100000'),
        (['--repeats', '0'], '--repeats is 0: expected 1 or more'),
        (['--seed', '-1'], '--seed is -1: expected 0 or more'),
        (['--range-max', '0.05'], '--range-max is 0.05: expected more than 0.1 m'),
        (['--range-max', 'nan'], '--range-max is nan: expected 0 to'),
        (['--range-max', '20000'], '--range-max is 20000: expected 0.1 to below 10000 m'),
    ],
    ids=lambda value: ' '.join(value) if isinstance(value, list) else '',
)
def test_a_mistake_is_said_of_the_option(capsys, arguments, reason):
    assert run(['bench', 'simulate', *arguments]) == 2
    assert reason in capsys.readouterr().err

"""The YAML that is shipped for a node is taken by every command that takes one."""

import argparse
from pathlib import Path

import numpy as np
import pytest

from ogm_mcmc.cli.main import make_parser, run
from ogm_mcmc.cli.options import config_from
from ogm_mcmc.config import PlacingConfig
from ogm_mcmc.config.nodes import NodeMapperConfig
from ogm_mcmc.geometry import PlacedScan, Pose2D, Scan
from ogm_mcmc.io.recording_bag import write_recording

CONFIG = Path(__file__).parents[2] / 'config'
SHIPPED = sorted(CONFIG.glob('*.yaml'))

CHEAP = {
    'map': ('map', 'bag', '-o', 'out'),
    'sample': (
        *('sample', 'bag', '-o', 'out', '--max-sweeps', '12', '--burn-in', '2', '--r-hat', '0'),
        *('--resolution', '0.1'),
    ),
    'evaluate': ('evaluate', 'map.npz', '--beams', 'bag', '-o', 'out'),
    'evaluate two': ('evaluate', 'a=map.npz', 'b=map.npz', '--beams', 'bag', '-o', 'out'),
    'bench online': ('bench', 'online', 'bag', '--repeats', '1'),
}

# These take seconds.
DEAR = {'demo', 'bench sample', 'bench refine'}


def takers(parser, name=''):
    """Names of the commands that take --params-file."""
    found = set()
    for action in parser._actions:
        if '--params-file' in action.option_strings:
            found.add(name)
        if isinstance(action, argparse._SubParsersAction):
            for word, inner in action.choices.items():
                found |= takers(inner, f'{name} {word}'.strip())
    return found


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    """A bag of three scans of a round room, and the map of it."""
    made = tmp_path_factory.mktemp('shipped')
    scans = [
        PlacedScan.at(
            Scan.checked(
                np.full(24, 1.0, np.float32),
                angle_min_rad=0.0,
                angle_increment_rad=2.0 * np.pi / 24,
                range_min_m=0.0,
                range_max_m=3.0,
                stamp_ns=k,
            ),
            Pose2D(0.03, 0.04),
        )
        for k in (1, 2, 3)
    ]
    write_recording(made / 'bag', scans)
    assert run(['map', str(made / 'bag'), '-o', str(made), '--name', 'map']) == 0
    return made


def test_no_command_is_forgotten():
    assert {path.stem for path in SHIPPED} == {'online_mapper', 'refine_server'}
    named = {name.removesuffix(' two') for name in CHEAP} | DEAR
    assert takers(make_parser()) == named


@pytest.mark.parametrize('shipped', SHIPPED, ids=lambda path: path.stem)
@pytest.mark.parametrize('command', CHEAP.values(), ids=CHEAP)
def test_what_is_shipped_is_taken(folder, monkeypatch, capsys, command, shipped):
    monkeypatch.chdir(folder)
    code = run([*command, '--params-file', str(shipped)])
    said = capsys.readouterr().err
    of_other_node = (command[0] in ('sample', 'evaluate')) != (shipped.stem == 'refine_server')
    assert code == (2 if of_other_node else 0), said
    assert (f'{shipped}: unknown parameter' in said) == of_other_node


@pytest.mark.parametrize('command', sorted(DEAR))
def test_what_takes_long_reads_what_is_shipped(command):
    shipped = CONFIG / 'online_mapper.yaml'
    options = make_parser().parse_args([*command.split(), '--params-file', str(shipped)])
    assert config_from(options, PlacingConfig) == PlacingConfig()
    if command == 'demo':
        assert config_from(options, NodeMapperConfig).no_return == 'auto'


def test_a_wrong_value_is_said_with_its_file(folder, monkeypatch, capsys):
    monkeypatch.chdir(folder)
    Path('wrong.yaml').write_text('resolution: far\n', encoding='utf-8')
    command = ['map', 'bag', '-o', 'out', '--params-file', 'wrong.yaml']
    assert run(command) == 2
    assert "error: wrong.yaml: resolution is 'far': expected float" in capsys.readouterr().err
    assert run([*command, '--resolution', '0.0']) == 2
    assert 'error: resolution is 0.0: expected a number' in capsys.readouterr().err

"""What `warm-up` compiles is what the nodes need by their defaults."""

import contextlib
import json
import os
import signal
import sys
import time
from multiprocessing.process import BaseProcess
from types import SimpleNamespace

import pytest

from ogm_mcmc.cli import warm_up
from ogm_mcmc.cli.main import run
from ogm_mcmc.config import MapperConfig
from ogm_mcmc.config.nodes import NodeMapperConfig, RefineSamplerConfig
from ogm_mcmc.config.settings import flatten

MAPPING, MAPS, COLLISIONS = 'warm_up_mapping', 'warm_up_maps', 'warm_up_collisions'
CHAINS, CHANGES, SAMPLING = 'warm_up_chains', 'warm_up_changes', 'warm_up_sampling'


@pytest.fixture
def asked(monkeypatch):
    """Calls of what compiles, in their order; nothing is compiled."""
    calls = []

    def note(name):
        monkeypatch.setattr(warm_up, name, lambda *settings: calls.append((name, *settings)))

    for name in (MAPPING, MAPS, COLLISIONS, CHAINS, CHANGES, SAMPLING):
        note(name)
    monkeypatch.setattr(warm_up, 'beside', done_here)
    return calls


@contextlib.contextmanager
def done_here(work, *arguments):
    """A process of its own would know nothing of what a test replaced."""
    work(*arguments)
    yield SimpleNamespace(exitcode=0, join=lambda: None)


def test_kernels_of_both_nodes_are_made_ready(asked, capsys):
    assert run(['warm-up', '--json']) == 0
    assert json.loads(capsys.readouterr().out)['seconds'] >= 0.0
    config = RefineSamplerConfig()
    assert sorted(asked[:-1], key=str) == sorted(
        [
            (CHAINS, config),
            (MAPPING, MapperConfig()),
            (MAPS, config),
            (COLLISIONS,),
            (CHANGES, config),
        ],
        key=str,
    )
    assert asked[-1] == (SAMPLING, config)
    mapping = MapperConfig()
    # A node begins with what beams without a return mean by then: no kernel depends on it.
    expected = {**flatten(NodeMapperConfig()), 'no_return': mapping.no_return}
    assert flatten(mapping) == expected


def test_what_a_process_that_was_killed_left_is_compiled_all_the_same(asked, monkeypatch):
    @contextlib.contextmanager
    def killed(work, *arguments):
        yield SimpleNamespace(exitcode=-signal.SIGKILL, join=lambda: None)

    monkeypatch.setattr(warm_up, 'beside', killed)
    assert run(['warm-up']) == 0
    assert [name for name, *_ in asked] == [CHAINS, MAPPING, MAPS, COLLISIONS, CHANGES, SAMPLING]


def test_a_process_beside_ends_at_once_with_the_command_and_not_by_ctrl_c():
    """It was waited for (SIGTERM: half a minute), or told of Ctrl-C in a traceback."""
    handler, begun = signal.getsignal(signal.SIGINT), []

    def command():
        with warm_up.beside(time.sleep, 600.0) as process:
            begun.append(process)
            assert signal.getsignal(signal.SIGINT) is handler
            os.kill(process.pid, signal.SIGINT)
            sys.exit(143)

    with pytest.raises(SystemExit):
        command()
    assert begun[0].exitcode == -signal.SIGTERM


def test_ctrl_c_while_a_process_is_started_is_not_lost(monkeypatch):
    """It was ignored for as long as that takes."""
    started, really = [], BaseProcess.start

    def start(process):
        os.kill(os.getpid(), signal.SIGINT)
        really(process)
        started.append(process)

    monkeypatch.setattr(BaseProcess, 'start', start)
    with pytest.raises(KeyboardInterrupt), warm_up.beside(time.sleep, 600.0):
        pytest.fail('the block was entered')
    assert started[0].exitcode == -signal.SIGTERM


def test_a_process_beside_does_what_it_was_given(tmp_path):
    with warm_up.beside(os.mkdir, tmp_path / 'made') as process:
        process.join()
    assert process.exitcode == 0
    assert (tmp_path / 'made').is_dir()

"""What `warm-up` compiles is what the nodes need by their defaults."""

import json
from concurrent.futures import Future, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool

import pytest

from ogm_mcmc.cli import warm_up
from ogm_mcmc.cli.main import run
from ogm_mcmc.config import MapperConfig
from ogm_mcmc.config.nodes import NodeMapperConfig, RefineSamplerConfig
from ogm_mcmc.config.settings import flatten

MAPPING, MAPS, COLLISIONS = 'warm_up_mapping', 'warm_up_maps', 'warm_up_collisions'
CHAINS, SAMPLING = 'warm_up_chains', 'warm_up_sampling'


@pytest.fixture
def asked(monkeypatch):
    """Calls of what compiles, in their order; nothing is compiled."""
    calls = []

    def note(name):
        monkeypatch.setattr(warm_up, name, lambda *settings: calls.append((name, *settings)))

    for name in (MAPPING, MAPS, COLLISIONS, CHAINS, SAMPLING):
        note(name)
    # A process of its own would know nothing of this.
    pool = ThreadPoolExecutor(1)
    monkeypatch.setattr(warm_up, 'ProcessPoolExecutor', lambda n, mp_context: pool)
    return calls


def test_kernels_of_both_nodes_are_made_ready(asked, capsys):
    assert run(['warm-up', '--json']) == 0
    assert json.loads(capsys.readouterr().out)['seconds'] >= 0.0
    config = RefineSamplerConfig()
    assert sorted(asked[:-1], key=str) == sorted(
        [(CHAINS, config), (MAPPING, MapperConfig()), (MAPS, config), (COLLISIONS,)], key=str
    )
    assert asked[-1] == (SAMPLING, config)
    mapping = MapperConfig()
    # A node begins with what beams without a return mean by then: no kernel depends on it.
    expected = {**flatten(NodeMapperConfig()), 'no_return': mapping.no_return}
    assert flatten(mapping) == expected


def test_what_a_process_that_was_killed_left_is_compiled_all_the_same(asked, monkeypatch):
    class Killed(ThreadPoolExecutor):
        def submit(self, work, *settings):
            future = Future()
            future.set_exception(BrokenProcessPool('killed'))
            return future

    monkeypatch.setattr(warm_up, 'ProcessPoolExecutor', lambda n, mp_context: Killed(n))
    assert run(['warm-up']) == 0
    assert [name for name, *_ in asked] == [CHAINS, MAPPING, MAPS, COLLISIONS, SAMPLING]

"""What `warm-up` compiles is what the nodes need by their defaults."""

import json

import pytest

from ogm_mcmc.cli import warm_up
from ogm_mcmc.cli.main import run
from ogm_mcmc.config.nodes import NodeMapperConfig, RefineSamplerConfig
from ogm_mcmc.config.settings import flatten

MAPPING, SAMPLING, COLLISIONS = 'warm_up_mapping', 'warm_up_sampling', 'warm_up_collisions'


@pytest.fixture
def asked(monkeypatch):
    """Calls of what compiles, in their order; nothing is compiled."""
    calls = []

    def note(name):
        monkeypatch.setattr(warm_up, name, lambda *settings: calls.append((name, *settings)))

    for name in (MAPPING, SAMPLING, COLLISIONS):
        note(name)
    return calls


def test_kernels_of_both_nodes_are_made_ready(asked, capsys):
    assert run(['warm-up', '--json']) == 0
    assert json.loads(capsys.readouterr().out)['seconds'] >= 0.0
    (first, mapping), *others = asked
    assert first == MAPPING
    assert others == [(SAMPLING, RefineSamplerConfig()), (COLLISIONS,)]
    # A node begins with what beams without a return mean by then: no kernel depends on it.
    expected = {**flatten(NodeMapperConfig()), 'no_return': mapping.no_return}
    assert flatten(mapping) == expected

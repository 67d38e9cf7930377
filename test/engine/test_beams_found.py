"""What scans told of their beams: when they are asked again, and that it is kept in a file."""

from dataclasses import replace
from pathlib import Path

import pytest
from support.workers import scans

from ogm_mcmc.config import ForwardModelConfig, SamplerConfig
from ogm_mcmc.config.nodes import NodeModelConfig
from ogm_mcmc.engine import beams_found
from ogm_mcmc.engine.beams_found import BeamsFound
from ogm_mcmc.engine.grazing import Grazing
from ogm_mcmc.engine.range_spread import Spread
from ogm_mcmc.engine.sensor_fit import SensorNumbers, Share
from ogm_mcmc.errors import WindowError

CONFIG = SamplerConfig()
SPREAD = Spread(0.03, 0.002, 400, 0.026, 0.034)
NUMBERS = SensorNumbers(Share.of(3.0, 200.0), None, SPREAD, Grazing(SPREAD, 0.02))
MODEL = replace(CONFIG.model, sigma=0.03, clutter=0.013, grazing=0.02)
FOUND = BeamsFound.of_none(CONFIG)._replace(model=MODEL, sensor=NUMBERS, told=3, came=1)


@pytest.mark.parametrize('sensor', [NUMBERS, SensorNumbers(None, None), None])
def test_what_is_saved_of_beams_is_what_comes_back(sensor):
    found = FOUND._replace(sensor=sensor)
    said = found.as_dict()
    asked = ForwardModelConfig()
    assert BeamsFound.of_none(CONFIG).saved(Path('state'), said, asked, 4) == found
    assert BeamsFound.of_none(CONFIG).saved(Path('state'), said, asked, 2).came == 0


@pytest.mark.parametrize(
    'said', [None, {}, {**FOUND.as_dict(), 'sigma': 'wide'}, {**FOUND.as_dict(), 'sensor': {}}]
)
def test_what_a_file_cannot_say_is_refused(said):
    with pytest.raises(WindowError, match='state: expected what was found of the beams'):
        FOUND.saved(Path('state'), said, CONFIG.model, 4)


def test_who_is_given_what_was_found_looks_for_nothing():
    config = replace(CONFIG, chain=replace(CONFIG.chain, sensor='fitted'))
    given = FOUND.as_given(config)
    assert (given.model, given.chain.sensor) == (MODEL, 'given')
    assert given.window.no_return == FOUND.no_return.value
    assert FOUND.in_settings(config) == replace(config, window=given.window)


def test_grazing_that_was_found_may_be_left_out_not_that_asked_for():
    asked = NodeModelConfig(grazing=-1.0)
    plain = FOUND.without_grazing(asked)
    assert (plain.model.grazing, plain.sensor.grazing.used) == (0.0, 0.0)
    assert plain.sensor.grazing.found == SPREAD
    assert plain.without_grazing(asked) is None
    assert FOUND.without_grazing(replace(asked, grazing=0.02)) is None


@pytest.mark.parametrize(
    ('clutter', 'came', 'grows', 'told', 'clutter_then'),
    [
        (0.5, 1, True, (3, 2), 0.013),  # too few came to ask again
        (0.5, 2, True, (5, 0), 0.5),  # as many as had told
        (0.014, 2, True, (5, 0), 0.013),  # nearly the same: rays need not be entered anew
        (0.014, 0, False, (5, 0), 0.014),  # they are anyway
    ],
)
def test_beams_are_asked_again_once_twice_as_many_tell(
    monkeypatch, clutter, came, grows, told, clutter_then
):
    fitted = replace(MODEL, clutter=clutter), NUMBERS
    monkeypatch.setattr(beams_found, 'fit_sensor', lambda *_: fitted)
    renewed = FOUND.renewed(scans(5), came, CONFIG, grows=grows)
    assert (renewed.told, renewed.came) == told
    assert renewed.model.clutter == clutter_then

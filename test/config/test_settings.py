import argparse
import math
from dataclasses import FrozenInstanceError, dataclass

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from support.strategies import REPEATABLE

from ogm_mcmc import config as config_module
from ogm_mcmc.config import (
    MapperConfig,
    MountConfig,
    OutputConfig,
    PlacingConfig,
    SamplerConfig,
    StepModelConfig,
    add_arguments,
    build,
    check_bounds,
    flatten,
    setting,
    settings_of,
)
from ogm_mcmc.config import settings as settings_module
from ogm_mcmc.errors import ConfigError
from ogm_mcmc.geometry.motion import MAX_SPEED_M_S, MAX_TURN_RAD_S

LEAVES = {leaf.name: leaf for leaf in settings_of(MapperConfig)}


def legal_values(leaf):
    """Any value a setting may have."""
    if leaf.choices:
        return st.sampled_from(leaf.choices)
    if leaf.type is bool:
        return st.booleans()
    if leaf.type is int:
        return st.integers(int(leaf.low), int(leaf.high))
    return st.floats(leaf.low, leaf.high)


@dataclass(frozen=True)
class Inner:
    depth: int = setting(3, 'how deep', low=0, high=9)


@dataclass(frozen=True)
class Outer:
    name: str = setting('x', 'what it is called')
    on: bool = setting(False, 'whether it runs')
    gain: float = setting(1.0, 'how much')
    inner: Inner = Inner()

    def __post_init__(self):
        check_bounds(self)


# -- declarations -------------------------------------------------------------------------------


def test_leaves_in_order_of_declaration_with_dotted_names():
    assert [leaf.name for leaf in settings_of(Outer)] == ['name', 'on', 'gain', 'inner.depth']
    depth = list(settings_of(Outer))[-1]
    assert (depth.type, depth.default, depth.description) == (int, 3, 'how deep')
    assert (depth.low, depth.high, depth.choices) == (0, 9, ())


@pytest.mark.parametrize('cls', [MapperConfig, OutputConfig])
def test_every_setting_says_what_it_means_and_its_bounds(cls):
    for leaf in settings_of(cls):
        assert len(leaf.description) > 10
        assert type(leaf.default) is leaf.type
        if leaf.type in (int, float):
            assert leaf.low <= leaf.default <= leaf.high
        elif leaf.type is str:
            assert leaf.default in leaf.choices


def test_defaults_are_what_users_were_told():
    assert flatten(MapperConfig()) == {
        'method': 'two_assumption',
        'inverse_model': 'step',
        'fusion': 'per_scan',
        'resolution': 0.05,
        'prior': 0.5,
        'log_odds_limit': 100.0,
        'max_range': 0.0,
        'no_return': 'clear',
        'max_cells': 100_000_000,
        'step.l_free': -1.3863,
        'step.l_occ': 1.3863,
        'gaussian.sigma': 0.03,
        'gaussian.sigma_growth': 0.0,
        'gaussian.width': 0.0,
        'gaussian.l_min': -1.3863,
        'gaussian.l_max': 1.3863,
        'pose_uncertain.samples': 100,
        'pose_uncertain.accuracy': 0.0,
        'pose_uncertain.negligible': 0.001,
        'pose_uncertain.map_beams': 0.0,
        'pose_uncertain.map_sigma': 0.1,
        'pose_uncertain.max_particles': 200,
        'pose_uncertain.draw': 'quasi',
        'pose_uncertain.seed': 1,
        'counting.show': 'reflection',
        'sonar.opening_angle': 0.5,
        'sonar.sigma_share': 0.5,
        'sonar.strength': 0.3,
        'sonar.strength_far': 0.1,
        'sonar.thickness': 0.1,
        'adaptive.finest_level': 0,
        'adaptive.coarsest_level': 4,
        'adaptive.output_level': 0,
        'adaptive.unknowns': True,
        'adaptive.way_to_hit': True,
        'adaptive.significance': 0.05,
        'adaptive.noise': 0.02,
        'adaptive.count_limit': 1000.0,
        'adaptive.merge_free': 0.05,
        'adaptive.merge_occupied': 0.95,
        'adaptive.merge_spread': 0.02,
        'adaptive.merge_margin': 0.1,
        'random_field.length_scale': 1.0,
        'random_field.variance': 0.1,
        'random_field.mean': 0.0,
        'random_field.drop': 1e-4,
        'random_field.max_variance': 0.9,
    }
    assert flatten(OutputConfig()) == {
        'output': 'trinary',
        'occupied_thresh': 0.65,
        'free_thresh': 0.25,
    }


# -- flatten and build --------------------------------------------------------------------------


@given(st.fixed_dictionaries({}, optional={k: legal_values(v) for k, v in LEAVES.items()}))
@REPEATABLE
def test_build_and_flatten_round_trip(values):
    prior, limit = values.get('prior', 0.5), values.get('log_odds_limit', 100.0)
    assume(abs(math.log(prior / (1.0 - prior))) < limit)
    built = build(MapperConfig, values)
    assert flatten(built) == {**flatten(MapperConfig()), **values}
    assert build(MapperConfig, flatten(built)) == built


def test_nested_names_reach_the_nested_class():
    built = build(MapperConfig, {'step.l_occ': 2.0})
    assert built.step == StepModelConfig(l_occ=2.0)


def test_a_refused_nested_value_goes_by_its_whole_name():
    with pytest.raises(ConfigError, match=r'^chain\.prior is 0\.0: expected a number from'):
        build(SamplerConfig, {'chain.prior': 0.0})


def test_an_unknown_name_is_refused_with_the_known_ones():
    with pytest.raises(ConfigError, match=r"unknown setting 'gian': one of gain, inner\.depth, n"):
        build(Outer, {'gain': 2.0, 'gian': 2.0})
    assert build(Outer, {'gain': 2.0, 'gian': 2.0}, ignore_unknown=True) == Outer(gain=2.0)


@pytest.mark.parametrize('name', ['step', 'l_occ', 'step.', 'step.l_occ.x'])
def test_parts_of_a_name_are_unknown(name):
    with pytest.raises(ConfigError, match='unknown setting'):
        build(MapperConfig, {name: 1.0})


def test_a_config_does_not_change():
    with pytest.raises(FrozenInstanceError):
        MapperConfig().prior = 0.9


# -- bounds and types ---------------------------------------------------------------------------

NUMBERS = [leaf for leaf in LEAVES.values() if leaf.type in (int, float)]


@pytest.mark.parametrize('leaf', NUMBERS, ids=lambda leaf: leaf.name)
def test_bounds_are_inclusive_and_what_is_beyond_is_refused(leaf):
    for value, beyond in ((leaf.low, -1), (leaf.high, 1)):
        edge = leaf.type(value)
        assert flatten(build(MapperConfig, {leaf.name: edge}))[leaf.name] == edge
        step = 1 if leaf.type is int else 1e-6 + abs(edge) * 1e-6
        with pytest.raises(ConfigError, match=f'^{leaf.name} is .*: expected a number from'):
            build(MapperConfig, {leaf.name: edge + beyond * step})


@pytest.mark.parametrize('name', ['resolution', 'prior', 'step.l_free'])
@pytest.mark.parametrize('value', [math.nan, math.inf, -math.inf])
def test_numbers_are_finite(name, value):
    with pytest.raises(ConfigError, match=f'^{name} is {value}: expected a number'):
        build(MapperConfig, {name: value})


@pytest.mark.parametrize(
    ('values', 'message'),
    [
        ({'gain': '1.0'}, "gain is '1.0': expected float"),
        ({'gain': True}, 'gain is True: expected float'),
        ({'gain': None}, 'gain is None: expected float'),
        ({'gain': [1.0]}, r'gain is \[1.0\]: expected float'),
        ({'inner.depth': 3.0}, 'inner.depth is 3.0: expected int'),
        ({'inner.depth': False}, 'inner.depth is False: expected int'),
        ({'inner.depth': 10}, 'inner.depth is 10: expected a number from 0 to 9'),
        ({'on': 1}, 'on is 1: expected bool'),
        ({'on': 'true'}, "on is 'true': expected bool"),
        ({'name': 5}, 'name is 5: expected str'),
    ],
)
def test_a_wrong_type_is_refused_and_never_converted(values, message):
    with pytest.raises(ConfigError, match=f'^{message}$'):
        build(Outer, values)


def test_a_number_beyond_all_floats_is_refused():
    with pytest.raises(ConfigError, match=r'^max_cells is 1000'):
        build(MapperConfig, {'max_cells': 10**400})


def test_a_whole_number_is_a_number():
    assert build(Outer, {'gain': 2}).gain == 2.0


@pytest.mark.parametrize(
    ('cls', 'values', 'message'),
    [
        (MapperConfig, {'fusion': 'per_day'}, "fusion is 'per_day': one of per_scan, per_beam"),
        (MapperConfig, {'no_return': ''}, "no_return is '': one of clear, ignore"),
        (
            MapperConfig,
            {'prior': 0.999, 'log_odds_limit': 3.5},
            r'log_odds_limit is 3.5: must not be below the log-odds of the prior \(6.91\)',
        ),
        (MapperConfig, {'prior': 0.001, 'log_odds_limit': 3.5}, 'log_odds_limit is 3.5: must not'),
        (OutputConfig, {'output': 'grey'}, "output is 'grey': one of trinary, probability"),
        (OutputConfig, {'free_thresh': 0.65}, 'free_thresh is 0.65: must be below occupied_thr'),
        (OutputConfig, {'occupied_thresh': 0.1}, 'free_thresh is 0.25: must be below'),
        (
            MountConfig,
            {'frames': 'a 0 0 1; b 0 0 1; a 1 1 1'},
            'mount.frames is .*: expected each',
        ),
    ],
)
def test_what_cannot_be_chosen(cls, values, message):
    with pytest.raises(ConfigError, match=f'^{message}'):
        build(cls, values)


# -- the command line ---------------------------------------------------------------------------


def test_options_are_named_after_settings():
    parser = argparse.ArgumentParser()
    add_arguments(parser, Outer)
    options = parser.parse_args(['--inner.depth', '4', '--on', '--name', 'y'])
    assert config_module.given(options, Outer) == {'inner.depth': 4, 'on': True, 'name': 'y'}
    assert config_module.given(parser.parse_args(['--no-on']), Outer) == {'on': False}
    assert config_module.given(parser.parse_args([]), Outer) == {}


def test_options_with_underscores_become_dashes():
    parser = argparse.ArgumentParser()
    add_arguments(parser, MapperConfig)
    options = parser.parse_args(['--max-range', '7', '--step.l-occ', '2', '--no-return', 'ignore'])
    expected = {'max_range': 7.0, 'step.l_occ': 2.0, 'no_return': 'ignore'}
    assert config_module.given(options, MapperConfig) == expected
    assert 'default: 0.05' in parser.format_help()


def test_the_limits_of_motion_are_those_of_the_code_that_applies_them():
    placing = PlacingConfig()
    assert (placing.max_speed, placing.max_turn_rate) == (MAX_SPEED_M_S, MAX_TURN_RAD_S)


def test_annotations_are_compiled_once(monkeypatch):
    """A node builds all of its config classes again for every parameter that is set."""
    build(MapperConfig, {'resolution': 0.1})
    monkeypatch.setattr(settings_module, 'get_type_hints', None)
    assert build(MapperConfig, {'resolution': 0.2}).resolution == 0.2

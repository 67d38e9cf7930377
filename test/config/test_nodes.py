"""Settings of the nodes and commands where they differ from those of plain Python."""

import pytest

from ogm_mcmc.config import ForwardModelConfig, build, settings_of
from ogm_mcmc.config.nodes import NodeMapperConfig, RefineSamplerConfig, judging
from ogm_mcmc.errors import ConfigError


def test_what_no_return_means_may_be_left_to_the_data():
    (leaf,) = (one for one in settings_of(RefineSamplerConfig) if one.name == 'window.no_return')
    assert (leaf.default, leaf.choices) == ('auto', ('auto', 'clear', 'ignore'))
    assert build(RefineSamplerConfig, {'window.resolution': 0.1}).window.no_return == 'auto'
    assert NodeMapperConfig().no_return == 'auto'
    with pytest.raises(ConfigError, match=r"window\.no_return is 'all': one of auto, clear"):
        build(RefineSamplerConfig, {'window.no_return': 'all'})


def test_sigma_may_be_left_to_the_data_but_not_by_a_judge():
    config = build(RefineSamplerConfig, {'window.resolution': 0.1})
    assert (config.model.sigma, config.model.sigma_m) == (0.0, ForwardModelConfig().sigma)
    assert judging(config).model.sigma == ForwardModelConfig().sigma
    assert (config.model.grazing, config.model.grazing_m) == (-1.0, 0.0)
    assert judging(config).model.grazing == 0.0
    fixed = build(RefineSamplerConfig, {'model.sigma': 0.02, 'model.grazing': 0.01})
    assert judging(fixed) == fixed
    with pytest.raises(ConfigError, match=r'grazing is -0\.5: expected -1, or 0 or more'):
        build(RefineSamplerConfig, {'model.grazing': -0.5})
    with pytest.raises(ConfigError, match=r'sigma is 1e-06: expected 0, or 0\.0001 or more'):
        build(RefineSamplerConfig, {'model.sigma': 1e-6})
    with pytest.raises(ConfigError, match=r'sigma is 0\.0: expected a number from 0\.0001'):
        ForwardModelConfig(sigma=0.0)

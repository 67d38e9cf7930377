"""Settings of the nodes and commands where they differ from those of plain Python."""

import pytest

from ogm_mcmc.config import build, settings_of
from ogm_mcmc.config.nodes import NodeMapperConfig, RefineSamplerConfig
from ogm_mcmc.errors import ConfigError


def test_what_no_return_means_may_be_left_to_the_data():
    (leaf,) = (one for one in settings_of(RefineSamplerConfig) if one.name == 'window.no_return')
    assert (leaf.default, leaf.choices) == ('auto', ('auto', 'clear', 'ignore'))
    assert build(RefineSamplerConfig, {'window.resolution': 0.1}).window.no_return == 'auto'
    assert NodeMapperConfig().no_return == 'auto'
    with pytest.raises(ConfigError, match=r"window\.no_return is 'all': one of auto, clear"):
        build(RefineSamplerConfig, {'window.no_return': 'all'})

"""Settings of the posterior that make no sense are refused in one clear line."""

import math

import pytest

from ogm_mcmc.config import (
    ChainConfig,
    ForwardModelConfig,
    PatchConfig,
    RecordingConfig,
    SamplerConfig,
    StopConfig,
    WindowConfig,
    build,
    flatten,
    settings_of,
)
from ogm_mcmc.config.sampling import CHAINS_BELOW
from ogm_mcmc.errors import ConfigError

REFUSED = [
    (ChainConfig, 'prior', 0.0, 'expected a number from 1e-06 to 0.999999'),
    (ChainConfig, 'prior', 1.0, 'expected a number from 1e-06 to 0.999999'),
    (ChainConfig, 'prior', 1, 'expected a number from'),
    (ChainConfig, 'prior', math.nan, 'expected a number from'),
    (ChainConfig, 'prior', '0.5', 'expected float'),
    (ChainConfig, 'chains', -1, 'expected a number from 0'),
    (ChainConfig, 'burn_in', -1, 'expected a number from 0'),
    (ChainConfig, 'seed', -1, 'expected a number from 0'),
    (ChainConfig, 'start', 'anywhere', 'one of dispersed, live, prior, free, occupied'),
    (ChainConfig, 'order', 'spiral', 'one of fixed, random, checkerboard'),
    (ChainConfig, 'start_threshold', 1.5, 'expected a number from 0 to 1'),
    (ForwardModelConfig, 'sigma', 0.0, 'expected a number from 0.0001 to 10'),
    (ForwardModelConfig, 'sigma', -0.1, 'expected a number from 0.0001 to 10'),
    (ForwardModelConfig, 'sigma', math.inf, 'expected a number from 0.0001 to 10'),
    (ForwardModelConfig, 'sigma', math.nan, 'expected a number from 0.0001 to 10'),
    (ForwardModelConfig, 'clutter', 0.0, 'expected a number from 1e-06'),
    (ForwardModelConfig, 'missing', 0.0, 'expected a number from 1e-06'),
    (ForwardModelConfig, 'short', -0.1, 'expected a number from 0'),
    (ForwardModelConfig, 'short_decay', 0.0, 'expected a number from 0.001'),
    (ForwardModelConfig, 'depth', 1.1, 'expected a number from 0 to 1'),
    (ForwardModelConfig, 'kind', 'sonar', 'one of beam, gaussian'),
    (WindowConfig, 'resolution', 0.0, 'expected a number from 0.001'),
    (WindowConfig, 'beam_stride', 0, 'expected a number from 1'),
    (WindowConfig, 'cut_sigma', -1.0, 'expected a number from 0'),
    (WindowConfig, 'max_memory_mb', 0.0, 'expected a number from 1'),
    (WindowConfig, 'no_return', 'stop', 'one of clear, ignore'),
    (StopConfig, 'max_sweeps', 0, 'expected a number from 1'),
    (StopConfig, 'max_time', 0.0, 'expected a number from 0.01'),
    (StopConfig, 'r_hat', 0.5, 'expected more than 1, or 0 for no such rule'),
    (StopConfig, 'r_hat', 1.0, 'expected more than 1, or 0 for no such rule'),
    (StopConfig, 'r_hat', -1.0, 'expected a number from 0'),
    (StopConfig, 'agreeing_share', 1.01, 'expected a number from 0 to 1'),
    (RecordingConfig, 'max_scans', 0, 'expected a number from 1'),
    (RecordingConfig, 'max_seconds', -1.0, 'expected a number from 0'),
    (RecordingConfig, 'max_rays', 0, 'expected a number from 1'),
]


@pytest.mark.parametrize(('cls', 'name', 'value', 'expectation'), REFUSED)
def test_refused_with_setting_value_and_expectation(cls, name, value, expectation):
    with pytest.raises(ConfigError) as caught:
        cls(**{name: value})
    message = str(caught.value)
    assert message.startswith(f'{name} is {value!r}: ')
    assert expectation in message
    assert '\n' not in message


def test_chains_are_as_many_as_said_or_the_more_the_fewer_rays():
    def chains_for(n_rays, chains=0, **patch):
        config = SamplerConfig(chain=ChainConfig(chains=chains), patch=PatchConfig(**patch))
        return config.chains_for(n_rays)

    learned = {'prior': 'border', 'size': 9}
    by_rays = [chains_for(10**power, **learned) for power in range(8)]
    assert by_rays == sorted(by_rays, reverse=True)
    assert by_rays[-1] == 2
    for most, chains in CHAINS_BELOW:
        assert chains_for(most - 1, **learned) == chains > chains_for(most, **learned)
        assert chains_for(most, 3, **learned) == 3
        assert chains_for(most - 1) == 2  # of independent cells


def test_hits_need_a_share():
    with pytest.raises(ConfigError, match=r'clutter \+ missing \+ short is 1.0: must be below 1'):
        ForwardModelConfig(clutter=0.5, missing=0.4, short=0.1)
    with pytest.raises(ConfigError, match='must be below 1'):
        ForwardModelConfig(clutter=0.5, missing=0.5)


def test_what_may_be():
    assert StopConfig(r_hat=0.0).r_hat == 0.0
    assert StopConfig(r_hat=1.01).r_hat == 1.01
    assert ChainConfig(prior=1e-6).prior_log_odds == pytest.approx(-13.815509, abs=1e-5)
    assert ChainConfig(prior=0.5).prior_log_odds == 0.0
    assert ChainConfig(prior=0.9).prior_log_odds == pytest.approx(math.log(9.0))


def test_dotted_names_reach_every_part():
    config = build(SamplerConfig, {'model.sigma': 0.1, 'window.resolution': 0.2, 'chain.seed': 4})
    assert (config.model.sigma, config.window.resolution, config.chain.seed) == (0.1, 0.2, 4)
    assert set(flatten(config)) == {
        leaf.name for leaf in settings_of(SamplerConfig, switches=True)
    }
    with pytest.raises(ConfigError, match=r"unknown setting 'chain.sead': one of .*chain.seed"):
        build(SamplerConfig, {'chain.sead': 4})
    with pytest.raises(ConfigError, match='sigma is 0: expected a number'):
        build(SamplerConfig, {'model.sigma': 0})

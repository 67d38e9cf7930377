"""Warming up is for any cells and any sensor: its two beams always tell something."""

from dataclasses import replace

import pytest

from ogm_mcmc.config.nodes import RefineSamplerConfig
from ogm_mcmc.engine.warm_up import warm_up_changes, warm_up_sampling


@pytest.mark.jit
@pytest.mark.parametrize('resolution', [0.05, 0.4, 5.0])
@pytest.mark.parametrize('sigma', [0.0, 0.01])
def test_the_scans_that_warm_up_can_be_sampled(resolution, sigma):
    """With cells of 0.4 m a reading half way between two of them told nothing of either."""
    config = RefineSamplerConfig()
    few = replace(
        config,
        window=replace(config.window, resolution=resolution),
        model=replace(config.model, sigma=sigma),
        patch=replace(config.patch, prior='uniform', size=1),
        chain=replace(config.chain, burn_in=1),
    )
    assert warm_up_sampling(few) == 2
    assert warm_up_changes(few) > 0

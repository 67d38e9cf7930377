"""Sampling whole maps from the full posterior p(m | z, x)."""

from ogm_mcmc.sampling.cell_gibbs import CellModel, GibbsState, SweepInfo, run_chain, sweep
from ogm_mcmc.sampling.diagnostics import ChainQuality
from ogm_mcmc.sampling.posterior import (
    Estimate,
    PosteriorModel,
    PosteriorSampler,
    over_dispersed_starts,
)
from ogm_mcmc.sampling.ray_index import RayIndex, RayWindow, WindowSize

__all__ = [
    'CellModel',
    'ChainQuality',
    'Estimate',
    'GibbsState',
    'PosteriorModel',
    'PosteriorSampler',
    'RayIndex',
    'RayWindow',
    'SweepInfo',
    'WindowSize',
    'over_dispersed_starts',
    'run_chain',
    'sweep',
]

"""A pipeline of small cells, and scans for it."""

import numpy as np

from ogm_mcmc.config import MapperConfig
from ogm_mcmc.geometry import Pose2D, PoseBelief
from ogm_mcmc.pipeline import MappingPipeline
from support.strategies import fan

__all__ = ['at', 'pipeline', 'sweep']


def pipeline(**settings):
    return MappingPipeline(MapperConfig(**{'resolution': 0.1, **settings}))


def sweep(seed):
    """A scan all around."""
    rng = np.random.default_rng(seed)
    return fan(*rng.uniform(0.5, 4.0, 60), bearing=-3.1, increment=0.1)


def at(x, y, yaw=0.0):
    return PoseBelief(Pose2D(x, y, yaw))

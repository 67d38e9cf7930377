"""The first-hit mixture of a scan at many poses, by hand; `test_scan_fit` has the slow twin."""

import math

import numpy as np
import pytest

from ogm_mcmc.config import ForwardModelConfig
from ogm_mcmc.errors import ConfigError
from ogm_mcmc.geometry import GridMap, GridSpec
from ogm_mcmc.mapping import ProbabilityBeams
from ogm_mcmc.sensors import ForwardModel

MODEL = ForwardModel.from_config(ForwardModelConfig(sigma=0.1, clutter=0.1, missing=0.05))
REACH = 8.0


def test_two_cells_in_a_row_by_hand():
    """Half way through cell 1 with 1/2, through cell 3 with 1/4, unknown cell 2: prior 0."""
    probability = np.array([[0.0, 0.5, math.nan, 0.5, 0.0]], np.float32)
    fit = ProbabilityBeams(GridMap(GridSpec(2.0, 5, 1), probability), MODEL, 0.0)
    poses = np.array([(1.0, 1.0, 0.0), (5.0, 1.0, 0.0)])
    got = fit.log_likelihoods(poses, np.zeros(3), np.array([2.0, 6.0, math.inf]), REACH)
    peak = 0.85 / (0.1 * math.sqrt(2.0 * math.pi))
    clutter = 0.1 / REACH
    first = (clutter + 0.5 * peak) * (clutter + 0.25 * peak) * (0.05 + 0.85 * 0.25)
    second = (clutter + 0.5 * peak) * clutter * (0.05 + 0.85 * 0.5)
    assert np.exp(got) == pytest.approx([first, second], rel=1e-6)


def test_models_of_another_mixture_are_refused():
    grid_map = GridMap(GridSpec(1.0, 1, 1), np.zeros((1, 1), np.float32))
    for other in ({'kind': 'gaussian'}, {'short': 0.1}):
        with pytest.raises(ConfigError, match='short'):
            ProbabilityBeams(grid_map, ForwardModel.from_config(ForwardModelConfig(**other)), 0.1)

"""Joint poses in a generated building: what is counted, and that poses get better."""

import numpy as np
import pytest

from ogm_mcmc.lab.experiments import joint_sim
from ogm_mcmc.lab.experiments.pose_sim import pooled


@pytest.mark.full
def test_one_building() -> None:
    found = joint_sim.score(10, 1, 'poor filter', 1)
    errors = found['errors']
    assert errors[joint_sim.JOINT]['mean_m'] < 0.6 * errors[joint_sim.LIKELIEST]['mean_m']
    assert errors[joint_sim.EXACT]['max_m'] < 1e-9
    f1 = {name: pooled([counts]).best().f1 for name, counts in found['methods'].items()}
    assert f1[joint_sim.LIKELIEST] < f1[joint_sim.JOINT] < f1[joint_sim.EXACT]
    assert f1[joint_sim.ALL] < f1[joint_sim.JOINT] < f1[joint_sim.SPREAD]
    assert np.shape(found['coverage']) == (3,)

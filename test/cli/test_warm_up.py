"""What `warm-up` compiles is what the nodes need."""

import json

from ogm_mcmc.cli.main import run
from ogm_mcmc.engine.collision_kernels import way_risk
from ogm_mcmc.mapping.two_assumption_kernels import mark_rays
from ogm_mcmc.sampling.patch_gibbs_kernels import sweep_patches


def test_kernels_of_both_nodes_are_ready(capsys):
    assert run(['warm-up', '--json']) == 0
    assert json.loads(capsys.readouterr().out)['seconds'] >= 0.0
    for kernel in (mark_rays, sweep_patches, way_risk):
        assert kernel.signatures, kernel.__name__

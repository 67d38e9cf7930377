"""Warming up the mapping: whatever the configuration, nothing is compiled later."""

import itertools

import numpy as np
import pytest
from support.pipelines import sweep

from ogm_mcmc.config import MapperConfig, PoseUncertainConfig
from ogm_mcmc.engine.live_map import warm_up_mapping
from ogm_mcmc.geometry import PlacedScan, Pose2D, PoseBelief, SensorMount
from ogm_mcmc.mapping import METHODS, ProbabilityBeams
from ogm_mcmc.mapping.beam_evidence_kernels import sum_steps_per_beam
from ogm_mcmc.mapping.evidence_kernels import sum_per_scan
from ogm_mcmc.mapping.gaussian_field_kernels import take_in
from ogm_mcmc.mapping.quadtree_counting_kernels import count_seen
from ogm_mcmc.mapping.sonar_kernels import add_cone
from ogm_mcmc.mapping.two_assumption_kernels import fuse_per_beam, fuse_per_scan
from ogm_mcmc.pipeline import MappingPipeline

CONFIGS = [
    MapperConfig(
        method=method,
        inverse_model=model,
        fusion=fusion,
        resolution=resolution,
        no_return=no_return,
        max_range=max_range,
    )
    for method, model, fusion, resolution, no_return, max_range in itertools.product(
        sorted(METHODS),
        ('step', 'gaussian'),
        ('per_scan', 'per_beam'),
        (0.001, 0.05, 10.0),
        ('clear', 'ignore'),
        (0.0, 1e-3, 100.0),
    )
]


def test_warm_up_runs_for_every_configuration():
    assert min(warm_up_mapping(config) for config in CONFIGS) >= 1
    for method in METHODS:
        assert warm_up_mapping(MapperConfig(method=method, max_cells=4096)) > 1


@pytest.mark.jit
@pytest.mark.parametrize(
    ('method', 'fusion', 'kernel'),
    [
        ('two_assumption', 'per_scan', fuse_per_scan),
        ('two_assumption', 'per_beam', fuse_per_beam),
        ('pose_uncertain', 'per_scan', sum_per_scan),
        ('pose_uncertain', 'per_beam', sum_steps_per_beam),
        ('sonar', 'per_scan', add_cone),
        ('adaptive', 'per_scan', count_seen),
        ('random_field', 'per_scan', take_in),
    ],
)
def test_nothing_is_compiled_after_warm_up(method, fusion, kernel):
    config = MapperConfig(method=method, fusion=fusion)
    warm_up_mapping(config)
    compiled = kernel.signatures
    assert len(compiled) == 1
    belief = PoseBelief(Pose2D(1.013, 2.017), np.diag([0.01, 0.0, 0.001]))
    mount = SensorMount(Pose2D(0.1, 0.2, 0.3))
    MappingPipeline(config).update(PlacedScan.on_robot(sweep(1), belief, mount))
    assert kernel.signatures == compiled


@pytest.mark.parametrize('method', ['pose_uncertain', 'adaptive'])
def test_warm_up_weighs_poses_by_the_map(method, monkeypatch):
    weighed = []
    real = ProbabilityBeams.log_likelihoods

    def watched(self, poses, *beams):
        weighed.append(len(poses))
        return real(self, poses, *beams)

    monkeypatch.setattr(ProbabilityBeams, 'log_likelihoods', watched)
    warm_up_mapping(MapperConfig(method=method, pose_uncertain=PoseUncertainConfig(map_beams=5.0)))
    assert weighed == [100]

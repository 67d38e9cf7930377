"""What a reading says about cells (`inverse_model`)."""

from ogm_mcmc.sensors.inverse_model import (
    BeamModel,
    GaussianInverseModel,
    SonarInverseModel,
    StepInverseModel,
    beam_model,
)

__all__ = [
    'BeamModel',
    'GaussianInverseModel',
    'SonarInverseModel',
    'StepInverseModel',
    'beam_model',
]

"""What a reading says about cells (`inverse_model`), and what cells say about a reading.

`forward_model` gives p(range | first occupied cell), which the full posterior needs ([gibbs]
section III; the mixture is the field's standard one).
"""

from ogm_mcmc.sensors.forward_model import ForwardModel
from ogm_mcmc.sensors.inverse_model import (
    BeamModel,
    GaussianInverseModel,
    SonarInverseModel,
    beam_model,
)

__all__ = [
    'BeamModel',
    'ForwardModel',
    'GaussianInverseModel',
    'SonarInverseModel',
    'beam_model',
]

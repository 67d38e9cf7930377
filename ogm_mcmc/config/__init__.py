"""Settings: what may be set (`mapping`, `sampling`), how it is declared and read (`settings`)."""

from ogm_mcmc.config.evaluation import EvaluationConfig
from ogm_mcmc.config.mapping import (
    MapperConfig,
    MountConfig,
    OutputConfig,
    PlacingConfig,
    StepModelConfig,
)
from ogm_mcmc.config.sampling import (
    ChainConfig,
    ForwardModelConfig,
    RecordingConfig,
    SamplerConfig,
    StopConfig,
    WindowConfig,
)
from ogm_mcmc.config.settings import (
    Setting,
    add_arguments,
    build,
    check_bounds,
    flatten,
    given,
    read_parameter_file,
    setting,
    settings_of,
)

__all__ = [
    'ChainConfig',
    'EvaluationConfig',
    'ForwardModelConfig',
    'MapperConfig',
    'MountConfig',
    'OutputConfig',
    'PlacingConfig',
    'RecordingConfig',
    'SamplerConfig',
    'Setting',
    'StepModelConfig',
    'StopConfig',
    'WindowConfig',
    'add_arguments',
    'build',
    'check_bounds',
    'flatten',
    'given',
    'read_parameter_file',
    'setting',
    'settings_of',
]

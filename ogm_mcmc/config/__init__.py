"""Settings: what may be set (`mapping`, `sampling`, `priors`), and how (`settings`)."""

from ogm_mcmc.config.mapping import (
    MapperConfig,
    MountConfig,
    OutputConfig,
    PlacingConfig,
    StepModelConfig,
)
from ogm_mcmc.config.priors import LearningConfig, PatchTableConfig
from ogm_mcmc.config.sampling import (
    ChainConfig,
    ForwardModelConfig,
    PatchConfig,
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
    'ForwardModelConfig',
    'LearningConfig',
    'MapperConfig',
    'MountConfig',
    'OutputConfig',
    'PatchConfig',
    'PatchTableConfig',
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

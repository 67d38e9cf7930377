"""Settings: what may be set (`mapping`, `sampling`, `priors`), and how (`settings`)."""

from ogm_mcmc.config.evaluation import EvaluationConfig
from ogm_mcmc.config.mapping import (
    LIVE_MAPPING,
    CountingConfig,
    GaussianModelConfig,
    MapperConfig,
    MountConfig,
    OutputConfig,
    PlacingConfig,
    PoseUncertainConfig,
    SonarModelConfig,
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
    'LIVE_MAPPING',
    'CountingConfig',
    'EvaluationConfig',
    'GaussianModelConfig',
    'MapperConfig',
    'MountConfig',
    'OutputConfig',
    'PatchConfig',
    'PatchTableConfig',
    'PlacingConfig',
    'RecordingConfig',
    'SamplerConfig',
    'PoseUncertainConfig',
    'Setting',
    'SonarModelConfig',
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

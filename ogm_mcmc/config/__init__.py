"""Settings: what may be set (`mapping`), and how a setting is declared and read (`settings`)."""

from ogm_mcmc.config.adaptive import AdaptiveConfig
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
from ogm_mcmc.config.random_field import RandomFieldConfig
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
    'LIVE_MAPPING',
    'CountingConfig',
    'EvaluationConfig',
    'GaussianModelConfig',
    'AdaptiveConfig',
    'MapperConfig',
    'MountConfig',
    'OutputConfig',
    'PlacingConfig',
    'PoseUncertainConfig',
    'RandomFieldConfig',
    'Setting',
    'SonarModelConfig',
    'StepModelConfig',
    'add_arguments',
    'build',
    'check_bounds',
    'flatten',
    'given',
    'read_parameter_file',
    'setting',
    'settings_of',
]

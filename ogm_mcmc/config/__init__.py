"""Settings: what may be set (`mapping`, `priors`), and how it is declared (`settings`)."""

from ogm_mcmc.config.mapping import (
    MapperConfig,
    MountConfig,
    OutputConfig,
    PlacingConfig,
    StepModelConfig,
)
from ogm_mcmc.config.priors import LearningConfig, PatchTableConfig
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
    'LearningConfig',
    'MapperConfig',
    'MountConfig',
    'OutputConfig',
    'PatchTableConfig',
    'PlacingConfig',
    'Setting',
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

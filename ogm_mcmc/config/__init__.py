"""Settings: what may be set (`mapping`), and how a setting is declared and read (`settings`)."""

from ogm_mcmc.config.adaptive import AdaptiveConfig
from ogm_mcmc.config.mapping import (
    MapperConfig,
    MountConfig,
    OutputConfig,
    PlacingConfig,
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
    'AdaptiveConfig',
    'MapperConfig',
    'MountConfig',
    'OutputConfig',
    'PlacingConfig',
    'RandomFieldConfig',
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

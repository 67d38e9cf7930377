"""Settings: what may be set (`mapping`, `sampling`, `priors`), and how (`settings`)."""

from ogm_mcmc.config.adaptive import AdaptiveConfig
from ogm_mcmc.config.evaluation import (
    AlignmentConfig,
    CollisionConfig,
    EvaluationConfig,
    ExpectedScanConfig,
    HeldOutConfig,
    HeldOutPointsConfig,
)
from ogm_mcmc.config.mapping import (
    CountingConfig,
    GaussianModelConfig,
    MapperConfig,
    OutputConfig,
    PoseUncertainConfig,
    SonarModelConfig,
    StepModelConfig,
)
from ogm_mcmc.config.placing import MountConfig, PlacingConfig
from ogm_mcmc.config.priors import LearningConfig, PatchTableConfig
from ogm_mcmc.config.random_field import RandomFieldConfig
from ogm_mcmc.config.recording import KeepConfig, RecordingConfig
from ogm_mcmc.config.sampling import (
    ChainConfig,
    ForwardModelConfig,
    PatchConfig,
    SamplerConfig,
    ShownConfig,
    StopConfig,
    WindowConfig,
    check_limits,
)
from ogm_mcmc.config.settings import (
    Setting,
    add_arguments,
    build,
    check_bounds,
    flatten,
    given,
    setting,
    settings_of,
)
from ogm_mcmc.config.trajectory import PosesConfig, RefinePosesConfig, TrajectoryConfig

__all__ = [
    'AlignmentConfig',
    'ChainConfig',
    'CollisionConfig',
    'ForwardModelConfig',
    'KeepConfig',
    'LearningConfig',
    'CountingConfig',
    'EvaluationConfig',
    'ExpectedScanConfig',
    'HeldOutConfig',
    'HeldOutPointsConfig',
    'GaussianModelConfig',
    'AdaptiveConfig',
    'MapperConfig',
    'MountConfig',
    'OutputConfig',
    'PatchConfig',
    'PatchTableConfig',
    'PlacingConfig',
    'RecordingConfig',
    'RefinePosesConfig',
    'SamplerConfig',
    'PoseUncertainConfig',
    'PosesConfig',
    'TrajectoryConfig',
    'RandomFieldConfig',
    'Setting',
    'ShownConfig',
    'SonarModelConfig',
    'StepModelConfig',
    'StopConfig',
    'WindowConfig',
    'add_arguments',
    'build',
    'check_bounds',
    'check_limits',
    'flatten',
    'given',
    'setting',
    'settings_of',
]

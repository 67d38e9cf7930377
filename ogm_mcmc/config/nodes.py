"""Parameters of the nodes beyond those of mapping itself; imports no ROS."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

from ogm_mcmc.config import (
    ChainConfig,
    CollisionConfig,
    ForwardModelConfig,
    MapperConfig,
    OutputConfig,
    PatchConfig,
    PlacingConfig,
    RecordingConfig,
    RefinePosesConfig,
    SamplerConfig,
    ShownConfig,
    StopConfig,
    WindowConfig,
    build,
    check_bounds,
    check_limits,
    setting,
    settings_of,
)
from ogm_mcmc.config.pose_sources import POSE_SOURCES, POSE_SOURCES_TEXT
from ogm_mcmc.errors import PLAIN_NAME_EXPECTED, is_plain_name, require

__all__ = [
    'LIVE_PARAMETERS',
    'NODE_CONFIGS',
    'REFINE_CONFIGS',
    'REFINE_LIVE_PARAMETERS',
    'IntakeConfig',
    'ManagedConfig',
    'NodeMapperConfig',
    'NodeModelConfig',
    'OnlineMapperConfig',
    'RefineSamplerConfig',
    'RefineServerConfig',
    'ReplayConfig',
    'judging',
    'refine_settings_agree',
]


def live_parameters(configs: Iterable[type]) -> frozenset[str]:
    """Return the names of the settings that may change while a node runs.

    What was already mapped, or how the node is connected, depends on the others.
    """
    return frozenset(leaf.name for config in configs for leaf in settings_of(config) if leaf.live)


@dataclass(frozen=True)
class IntakeConfig:
    """How a node receives scans and poses."""

    map_frame: str = setting(
        'map', 'frame of the map and of the poses; with pose_source odom that of the odometry'
    )
    base_frame: str = setting(
        'base_link',
        'frame of the robot: poses are those of this frame and sensors are mounted on '
        'it; odometry names its own',
    )
    sensor_frame: str = setting('', 'use only scans with this frame_id; empty: all')
    pose_source: str = setting(
        'pose',
        f'where poses come from, and the topic: {POSE_SOURCES_TEXT}',
        choices=tuple(POSE_SOURCES),
    )
    mount_source: str = setting(
        'auto',
        'where sensors are mounted: parameters: mount.*; tf: base_frame to the frame of '
        'the scan; auto: the parameters if they name a place, else tf if it knows the '
        'frame; topic: the parameters if they name a place, else TransformStamped '
        'messages on mount, which `replay` sends for sensors that move',
        choices=('auto', 'parameters', 'tf', 'topic'),
    )
    transform_timeout: float = setting(
        1.0,
        'a scan is dropped when no pose for it comes within this time, s',
        low=0.0,
        high=3600.0,
        live=True,
    )
    max_waiting_scans: int = setting(
        1000,
        'largest number of scans that wait for a pose; the oldest are dropped first',
        low=1,
        high=100000,
    )
    stale_after: float = setting(
        10.0,
        'time without a usable scan after which the diagnostics say ERROR, s',
        low=0.1,
        high=86400.0,
        live=True,
    )
    trajectory_source: str = setting(
        'path',
        'where corrected poses of the past come from: path: nav_msgs/Path on '
        'trajectory; slam_toolbox: its new_node_event and pose_graph; cartographer: its '
        'service trajectory_query. The last two need the messages of these packages',
        choices=('path', 'slam_toolbox', 'cartographer'),
    )
    correction_warning: float = setting(
        0.3,
        'warn when one step of map -> odom moves the robot, or a wall 3 m away, by more '
        'than this, m: scans mapped before may be misplaced; 0: never',
        low=0.0,
        high=1e6,
        live=True,
    )

    def __post_init__(self) -> None:
        """Refuse what is out of bounds."""
        check_bounds(self)


@dataclass(frozen=True)
class ManagedConfig:
    """Who takes a node through its states."""

    autostart: bool = setting(
        True,
        'configure and activate at start; false: wait for a lifecycle manager (change_state)',
    )


def _check_save_name(name: str) -> None:
    require(is_plain_name(name), 'save_name', name, PLAIN_NAME_EXPECTED)


@dataclass(frozen=True)
class OnlineMapperConfig:
    """When `online_mapper` publishes, and where it saves."""

    map_update_interval: float = setting(
        1.0, 'time between published maps, s', low=0.02, high=3600.0, live=True
    )
    latched_interval: float = setting(
        10.0,
        'renew the latched map at this interval while there is no subscriber, s',
        low=0.1,
        high=86400.0,
        live=True,
    )
    keep_scans: bool = setting(
        False,
        'keep every scan, so that a corrected trajectory (topic trajectory) can move '
        'it; the map is then made again in the background',
    )
    keep_scans_mb: float = setting(
        500.0,
        'memory for the scans of keep_scans and their poses, MB. When it is full, scans '
        'whose place and heading others cover are removed; a map made again lacks them. '
        'Copies held while a map is made again are not counted',
        low=1.0,
        high=1e6,
    )
    save_directory: str = setting('.', 'folder ~/save_map writes to')
    save_name: str = setting(
        'map', 'name of the files ~/save_map writes, without folders', live=True
    )

    def __post_init__(self) -> None:
        """Refuse what is out of bounds."""
        check_bounds(self)
        _check_save_name(self.save_name)


NO_RETURN_TEXT = (
    'meaning of a range of +inf: clear: {clear} (REP 117); ignore: not used, the better choice '
    'where glass or dark walls give no return; auto: ignore where most such beams cross cells '
    'that other beams hit, else clear{live}'
)
NO_RETURN_CHOICES = ('auto', 'clear', 'ignore')


@dataclass(frozen=True)
class NodeMapperConfig(MapperConfig):
    """Defaults of `online_mapper`, `map` and `demo`: what no return means is seen in the data."""

    no_return: str = setting(
        'auto',
        NO_RETURN_TEXT.format(
            clear='the beam is free up to range_max',
            live='; a node begins with ignore and looks again as scans come',
        ),
        choices=NO_RETURN_CHOICES,
        live=True,
    )


@dataclass(frozen=True)
class NodeWindowConfig(WindowConfig):
    """Defaults of `refine_server` and `sample`: likewise."""

    no_return: str = setting(
        'auto',
        NO_RETURN_TEXT.format(clear='nothing on the ray up to range_max', live=''),
        choices=NO_RETURN_CHOICES,
    )


# No sensor is as precise as that.
LEAST_SIGMA_M = 1e-4


@dataclass(frozen=True)
class NodeModelConfig(ForwardModelConfig):
    """Defaults of `refine_server` and `sample`: how far ranges scatter is seen in the data."""

    sigma: float = setting(
        0.0,
        'standard deviation of a range, m, including the error of the poses; 0: found in the '
        'scans that are sampled (in `evaluate`: 0.05)',
        low=0.0,
        high=10.0,
    )

    grazing: float = setting(
        -1.0,
        'roughness of surfaces, m: standard deviation across the surface. This over the '
        'tangent of the angle between beam and surface adds to sigma (in quadrature); 0: not '
        'used; -1: found in the scans that are sampled',
        low=-1.0,
        high=10.0,
    )

    def __post_init__(self) -> None:
        """Refuse what is out of bounds."""
        super().__post_init__()
        possible = self.grazing == -1.0 or self.grazing >= 0.0
        require(possible, 'grazing', self.grazing, 'expected -1, or 0 or more')
        possible = self.sigma == 0.0 or self.sigma >= LEAST_SIGMA_M
        require(possible, 'sigma', self.sigma, 'expected 0, or 0.0001 or more')


# All at the top level of the node, like the names people know from slam_toolbox.
NODE_CONFIGS = (
    NodeMapperConfig,
    OutputConfig,
    PlacingConfig,
    IntakeConfig,
    OnlineMapperConfig,
    ManagedConfig,
)

LIVE_PARAMETERS = live_parameters(NODE_CONFIGS)


@dataclass(frozen=True)
class RefineServerConfig:
    """When `refine_server` publishes, and where it saves."""

    map_update_interval: float = setting(
        1.0, 'time between published maps while sampling, s', low=0.02, high=3600.0, live=True
    )
    latched_interval: float = setting(
        10.0,
        'renew the latched map at this interval while there is no subscriber, s',
        low=0.1,
        high=86400.0,
        live=True,
    )
    niceness: int = setting(
        5, 'nice value of the sampling threads: 0: normal priority, 19: lowest', low=0, high=19
    )
    collision_samples: int = setting(
        64,
        'map samples kept to answer collision_query; 0: none, and no memory for them',
        low=0,
        high=64,
    )
    state_file: str = setting(
        '',
        'file for the state of the chains, written by ~/save_map and at the end of sampling; '
        'the first ~/refine with the same scans and settings continues from it; empty: none',
    )
    save_directory: str = setting('.', 'folder ~/save_map writes to')
    save_name: str = setting(
        'map_refined', 'name of the files ~/save_map writes, without folders', live=True
    )

    def __post_init__(self) -> None:
        """Refuse what is out of bounds."""
        check_bounds(self)
        _check_save_name(self.save_name)


LEARNED = PatchConfig(prior='border', size=9, strength=1.15, min_probability=0.003, max_floor=0.02)
FITTED = ChainConfig(chains=0, sensor='fitted', reflecting=0.2, neighbours=0.02)
JUDGED = NodeWindowConfig()
SENSED = NodeModelConfig()


@dataclass(frozen=True)
class RefineSamplerConfig(SamplerConfig):
    """Defaults of `refine_server` and `sample`: the learned prior, walls also between beams."""

    model: ForwardModelConfig = SENSED
    window: WindowConfig = JUDGED
    chain: ChainConfig = FITTED
    patch: PatchConfig = LEARNED


def judging(config: RefineSamplerConfig) -> RefineSamplerConfig:
    """Return how beams are understood by a judge, who finds nothing in them."""
    model = config.model
    return replace(config, model=replace(model, sigma=model.sigma_m, grazing=model.grazing_m))


REFINE_CONFIGS = (
    RefineSamplerConfig,
    StopConfig,
    RefinePosesConfig,
    RecordingConfig,
    OutputConfig,
    ShownConfig,
    PlacingConfig,
    IntakeConfig,
    RefineServerConfig,
    CollisionConfig,
    ManagedConfig,
)

REFINE_LIVE_PARAMETERS = live_parameters(REFINE_CONFIGS)


def refine_settings_agree(values: dict[str, Any]) -> None:
    """Refuse settings of `refine_server` that contradict each other."""
    sampler = build(RefineSamplerConfig, values, ignore_unknown=True)
    check_limits(sampler.chain, build(StopConfig, values, ignore_unknown=True))


@dataclass(frozen=True)
class ReplayConfig:
    """What `replay` publishes and how fast."""

    rate: float = setting(
        1.0, '1: as recorded; 0: as fast as the subscribers keep up', low=0.0, high=10000.0
    )
    topics: str = setting('', 'only these topics, separated by commas; empty: all')
    remap: str = setting('', 'OLD=NEW topic names, separated by commas')
    pose_source: str = setting(
        'auto',
        'poses to compute at the stamps of the scans and to publish on `pose`; auto: those of tf '
        'where tf2_msgs is not installed; none: never',
        choices=('auto', 'none', *POSE_SOURCES),
    )
    trajectory: str = setting(
        '',
        'file with poses to publish on `pose`: TUM, EuRoC, KITTI or g2o; empty: none',
    )
    trajectory_stamps: str = setting('', 'file with the stamps, for KITTI and g2o')
    trajectory_deviations: bool = setting(
        False,
        'publish poses of NAME.txt with the standard deviations in NAME_deviations.csv beside it, '
        'for nodes that average over them (method pose_uncertain, adaptive). Not for poses: joint '
        'or auto if the file was made from the same scans: they would count twice',
    )
    map_frame: str = setting('', 'poses are computed in this frame of tf; empty: map')
    base_frame: str = setting(
        '',
        'poses are those of this frame of tf; empty: base_link',
    )
    scan_topic: str = setting('', 'scans to compute poses for; empty: every laser of one robot')
    clock: bool = setting(False, 'publish /clock from the times of the recording')
    start: float = setting(0.0, 'skip this many seconds at the beginning, s', low=0.0, high=1e9)
    loop: bool = setting(False, 'start again at the end')
    start_paused: bool = setting(False, 'start paused; ~/pause with data: false continues')
    wait: float = setting(
        10.0,
        'wait this long for a subscriber and then give up, s; 0: publish without waiting',
        low=0.0,
        high=3600.0,
    )
    wait_topics: int = setting(1, 'start when this many topics have subscribers', low=0, high=1000)
    wait_subscribers: int = setting(
        1, 'number of subscribers a topic needs for wait_topics', low=1, high=1000
    )
    progress: bool = setting(False, 'show a progress bar on the terminal')

    def __post_init__(self) -> None:
        """Refuse what is out of bounds."""
        check_bounds(self)

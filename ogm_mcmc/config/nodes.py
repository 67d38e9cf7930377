"""Parameters of the nodes beyond those of mapping itself; imports no ROS."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from ogm_mcmc.config import (
    MapperConfig,
    OutputConfig,
    PatchConfig,
    PlacingConfig,
    PosesConfig,
    RecordingConfig,
    SamplerConfig,
    ShownConfig,
    StopConfig,
    build,
    check_bounds,
    check_limits,
    setting,
    settings_of,
)
from ogm_mcmc.config.pose_sources import POSE_SOURCES, POSE_SOURCES_TEXT

__all__ = [
    'LIVE_PARAMETERS',
    'NODE_CONFIGS',
    'REFINE_CONFIGS',
    'REFINE_LIVE_PARAMETERS',
    'IntakeConfig',
    'OnlineMapperConfig',
    'RefineSamplerConfig',
    'RefineServerConfig',
    'ReplayConfig',
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
        'base_link', 'frame the poses are of and sensors sit on; odometry names its own'
    )
    sensor_frame: str = setting('', 'scans must carry this frame_id; empty: any')
    pose_source: str = setting(
        'pose',
        f'where poses come from, and the topic: {POSE_SOURCES_TEXT}',
        choices=tuple(POSE_SOURCES),
    )
    mount_source: str = setting(
        'auto',
        'where sensors sit: mount.* parameters, or tf from base_frame to the frame of the scan; '
        'auto: the parameters if they name a place, else tf where it is there',
        choices=('auto', 'parameters', 'tf'),
    )
    transform_timeout: float = setting(
        1.0,
        'a scan waits this long for its pose after it and the last pose came, s',
        low=0.0,
        high=3600.0,
        live=True,
    )
    max_waiting_scans: int = setting(
        1000, 'scans that may wait for a pose at once; the oldest go first', low=1, high=100000
    )
    stale_after: float = setting(
        10.0,
        'without a scan that can be used for so long the diagnostics say ERROR, s',
        low=0.1,
        high=86400.0,
        live=True,
    )
    correction_warning: float = setting(
        0.3,
        'a step of map -> odom that moves the robot, or a wall 3 m away, by more than this at '
        'once is warned about: older scans may lie wrong; 0: never, m',
        low=0.0,
        high=1e6,
        live=True,
    )

    def __post_init__(self) -> None:
        """Refuse what is out of bounds."""
        check_bounds(self)


@dataclass(frozen=True)
class OnlineMapperConfig:
    """When `online_mapper` publishes, and where it saves."""

    map_update_interval: float = setting(
        1.0, 'time between published maps, s', low=0.02, high=3600.0, live=True
    )
    latched_interval: float = setting(
        10.0,
        'while nobody listens, the latched map is renewed at this interval, s',
        low=0.1,
        high=86400.0,
        live=True,
    )
    save_directory: str = setting('.', 'folder ~/save_map writes to', live=True)
    save_name: str = setting('map', 'name of the files ~/save_map writes', live=True)

    def __post_init__(self) -> None:
        """Refuse what is out of bounds."""
        check_bounds(self)


# All at the top level of the node, like the names people know from slam_toolbox.
NODE_CONFIGS = (MapperConfig, OutputConfig, PlacingConfig, IntakeConfig, OnlineMapperConfig)

LIVE_PARAMETERS = live_parameters(NODE_CONFIGS)


@dataclass(frozen=True)
class RefineServerConfig:
    """When `refine_server` publishes, and where it saves."""

    map_update_interval: float = setting(
        1.0, 'time between published maps while sampling, s', low=0.02, high=3600.0, live=True
    )
    latched_interval: float = setting(
        10.0,
        'while nobody listens, the latched map is renewed at this interval, s',
        low=0.1,
        high=86400.0,
        live=True,
    )
    niceness: int = setting(
        5, 'sampling gives way to other programs: 0 not at all, 19 always', low=0, high=19
    )
    state_file: str = setting(
        '',
        'chains are written here by ~/save_map and when sampling ends, and taken up again by the '
        'first ~/refine with the same scans and settings; empty: nowhere',
    )
    save_directory: str = setting('.', 'folder ~/save_map writes to', live=True)
    save_name: str = setting('map_refined', 'name of the files ~/save_map writes', live=True)

    def __post_init__(self) -> None:
        """Refuse what is out of bounds."""
        check_bounds(self)


LEARNED = PatchConfig(prior='border', size=9)


@dataclass(frozen=True)
class RefineSamplerConfig(SamplerConfig):
    """Defaults of `refine_server` and `sample`: the learned prior, walls also between beams."""

    patch: PatchConfig = LEARNED


REFINE_CONFIGS = (
    RefineSamplerConfig,
    StopConfig,
    PosesConfig,
    RecordingConfig,
    OutputConfig,
    ShownConfig,
    PlacingConfig,
    IntakeConfig,
    RefineServerConfig,
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
    clock: bool = setting(False, 'publish /clock from the times of the recording')
    start: float = setting(0.0, 'leave out the first seconds', low=0.0, high=1e9)
    loop: bool = setting(False, 'start again at the end')
    start_paused: bool = setting(False, 'wait for ~/pause with data: false')
    wait: float = setting(
        10.0,
        'wait up to this long for a subscriber, s, and give up if there is none; 0: publish '
        'whether anybody listens or not',
        low=0.0,
        high=3600.0,
    )
    wait_topics: int = setting(
        1, 'go on as soon as so many topics have a subscriber', low=0, high=1000
    )
    wait_subscribers: int = setting(
        1, 'subscribers that a topic needs to count for wait_topics', low=1, high=1000
    )
    progress: bool = setting(False, 'show a progress bar on the terminal')

    def __post_init__(self) -> None:
        """Refuse what is out of bounds."""
        check_bounds(self)

"""Settings of poses that are estimated together with the map."""

from __future__ import annotations

from dataclasses import dataclass

from ogm_mcmc.config.settings import check_bounds, setting

__all__ = ['PosesConfig', 'RefinePosesConfig', 'TrajectoryConfig']


@dataclass(frozen=True)
class TrajectoryConfig:
    """How poses are refined; see `ogm_mcmc.trajectory`."""

    spread: float = setting(
        0.3,
        'standard deviation of x and y where a pose comes without a covariance or with '
        'zeros only, m',
        low=1e-4,
        high=100.0,
    )
    spread_angle: float = setting(
        0.1,
        'standard deviation of the heading of such poses, rad',
        low=1e-5,
        high=10.0,
    )
    search: bool = setting(
        False,
        'match scans one by one first: for poses with errors of more than 0.3 m or 3 '
        'degrees from one scan to the next',
    )
    max_range: float = setting(
        30.0,
        'points further away than this are not used for poses, m; 0: up to range_max of the scan',
        low=0.0,
        high=10000.0,
    )
    rescale: bool = setting(
        True,
        'estimate one factor for the covariances of all poses, which localizers often '
        'give too small or too large',
    )
    steps: bool = setting(
        True,
        'assume that the error of the localizer is similar from one scan to the next; '
        'this holds poses where scans have few beams',
    )
    correlation: float = setting(
        -1.0,
        'correlation of the errors of the localizer from one scan to the next, 0 (independent) to '
        '0.9999; below 0: estimated from the poses. If errors are correlated, many scans say no '
        'more than a few about where the map lies as a whole',
        low=-1.0,
        high=0.9999,
    )
    odometry: bool = setting(
        True,
        'use odometry for the motion from scan to scan, where there is any beside the poses: '
        'nav_msgs/Odometry, or a frame with odom in its name in tf',
    )
    beam_times: bool = setting(
        True,
        'estimate when the beams of a scan were taken, from what they saw while the sensor moved '
        '(even and odd beams in two turns of a mirror; one beam after the other in a sweep), and '
        'correct scans for it',
    )
    draws: int = setting(
        40, 'trajectories drawn for the standard deviations of poses', low=2, high=10000
    )
    inflation: float = setting(
        1.6,
        'factor on the errors that points show, for the standard deviations of the poses',
        low=0.1,
        high=10.0,
    )
    seed: int = setting(1, 'seed of the trajectories drawn', low=0, high=2**63 - 1)

    def __post_init__(self) -> None:
        """Refuse what is out of bounds."""
        check_bounds(self)

    @property
    def standard_deviations(self) -> tuple[float, float, float]:
        """Of x, y (m) and yaw (rad) of a pose that comes without any."""
        return self.spread, self.spread, self.spread_angle


POSES_TEXT = (
    'fixed: scans lie where the localizer puts them; joint: their poses are estimated from '
    'the scans themselves and what the localizer says, then the map is sampled at them; auto: '
    'joint where the localizer says that it is unsure by more than half a cell or half a '
    'degree, or poses are those of odometry (a frame with odom in its name), and scans have 20 '
    'readings or more, else fixed'
)
POSES = ('fixed', 'joint', 'auto')


@dataclass(frozen=True)
class PosesConfig:
    """Whether poses are taken as they come or estimated."""

    poses: str = setting('fixed', POSES_TEXT, choices=POSES)
    trajectory: TrajectoryConfig = TrajectoryConfig()

    def __post_init__(self) -> None:
        """Refuse what is out of bounds."""
        check_bounds(self)

    @property
    def joint(self) -> bool:
        """Whether poses are estimated, or may be."""
        return self.poses != 'fixed'


@dataclass(frozen=True)
class RefinePosesConfig(PosesConfig):
    """Defaults of `refine_server`: a map at the given poses is there at once in any case."""

    poses: str = setting('auto', POSES_TEXT, choices=POSES)

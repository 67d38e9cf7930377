"""Settings of the live map: how scans become a grid, and how it is shown."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ogm_mcmc.config.adaptive import AdaptiveConfig
from ogm_mcmc.config.random_field import RandomFieldConfig
from ogm_mcmc.config.settings import check_bounds, setting
from ogm_mcmc.errors import require

__all__ = [
    'MapperConfig',
    'MountConfig',
    'OutputConfig',
    'PlacingConfig',
    'StepModelConfig',
]


@dataclass(frozen=True)
class StepModelConfig:
    """The step inverse sensor model ([gibbs] section II; values of Haehnel)."""

    l_free: float = setting(
        -1.3863, 'log-odds added to a cell a beam went through', low=-20.0, high=0.0
    )
    l_occ: float = setting(
        1.3863, 'log-odds added to the cell a beam ended in', low=0.0, high=20.0
    )


@dataclass(frozen=True)
class MapperConfig:
    """How scans become a grid; the same for the node, `map`, `bench` and plain Python."""

    method: str = setting(
        'two_assumption', 'mapping method', choices=('two_assumption', 'adaptive', 'random_field')
    )
    fusion: str = setting(
        'per_scan',
        'per_scan: each cell once per scan, a hit beats a miss; per_beam: every beam counts',
        choices=('per_scan', 'per_beam'),
    )
    resolution: float = setting(0.05, 'side of a cell, m', low=0.001, high=10.0)
    prior: float = setting(
        0.5, 'probability that a cell is occupied before any beam', low=1e-6, high=1.0 - 1e-6
    )
    log_odds_limit: float = setting(
        100.0,
        'log-odds are kept within plus and minus this; 3.5 lets a map follow moving things',
        low=0.1,
        high=1000.0,
    )
    max_range: float = setting(
        0.0,
        "beams are used up to this range, m; longer ones clear up to it; 0: the sensor's own",
        low=0.0,
        high=10000.0,
    )
    no_return: str = setting(
        'clear',
        'clear: +inf clears up to range_max (REP 117); ignore: it says nothing, as is wiser '
        'where glass and dark walls return nothing either',
        choices=('clear', 'ignore'),
    )
    max_cells: int = setting(
        100_000_000, 'the map never grows beyond this many cells', low=4096, high=4_000_000_000
    )
    step: StepModelConfig = StepModelConfig()
    adaptive: AdaptiveConfig = AdaptiveConfig()  # noqa: RUF009 - frozen
    random_field: RandomFieldConfig = RandomFieldConfig()  # noqa: RUF009 - frozen

    def __post_init__(self) -> None:
        """Refuse what is out of bounds or contradicts itself."""
        check_bounds(self)
        prior_log_odds = math.log(self.prior) - math.log1p(-self.prior)
        require(
            abs(prior_log_odds) <= self.log_odds_limit,
            'log_odds_limit',
            self.log_odds_limit,
            f'must not be below the log-odds of the prior ({abs(prior_log_odds):.3g})',
        )


@dataclass(frozen=True)
class OutputConfig:
    """How probabilities become an OccupancyGrid or a map file."""

    output: str = setting(
        'probability',
        'probability: 0..100 in every measured cell; trinary: 0, 100 or unknown',
        choices=('probability', 'trinary'),
    )
    occupied_thresh: float = setting(
        0.65, 'occupied from this probability on (trinary, map files)', low=0.0, high=1.0
    )
    free_thresh: float = setting(
        0.25, 'free up to this probability (trinary, map files)', low=0.0, high=1.0
    )

    def __post_init__(self) -> None:
        """Refuse what is out of bounds or contradicts itself."""
        check_bounds(self)
        require(
            self.free_thresh < self.occupied_thresh,
            'free_thresh',
            self.free_thresh,
            f'must be below occupied_thresh ({self.occupied_thresh})',
        )


@dataclass(frozen=True)
class MountConfig:
    """Where the sensor sits in the base frame; used with `mount_source: parameters`."""

    x: float = setting(0.0, 'sensor ahead of the base, m', low=-100.0, high=100.0)
    y: float = setting(0.0, 'sensor to the left of the base, m', low=-100.0, high=100.0)
    yaw: float = setting(0.0, 'heading of the sensor on the base, rad', low=-6.2832, high=6.2832)
    upside_down: bool = setting(False, 'the sensor hangs head down: bearings run clockwise')


@dataclass(frozen=True)
class PlacingConfig:
    """Where a scan was taken: poses between messages, and the sensor on the robot."""

    max_pose_gap: float = setting(
        2.0, 'poses further apart than this are not interpolated, s', low=0.0, high=3600.0
    )
    mount: MountConfig = MountConfig()

    def __post_init__(self) -> None:
        """Refuse what is out of bounds."""
        check_bounds(self)

"""Settings of the live map: how scans become a grid, and how it is shown."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ogm_mcmc.config.adaptive import AdaptiveConfig
from ogm_mcmc.config.random_field import RandomFieldConfig
from ogm_mcmc.config.settings import check_bounds, setting
from ogm_mcmc.errors import require

__all__ = [
    'CountingConfig',
    'GaussianModelConfig',
    'MapperConfig',
    'OutputConfig',
    'PoseUncertainConfig',
    'SonarModelConfig',
    'StepModelConfig',
]


@dataclass(frozen=True)
class StepModelConfig:
    """The step inverse sensor model ([gibbs] section II; values of Haehnel)."""

    l_free: float = setting(
        -1.3863, 'log-odds added to a cell a beam went through', low=-20.0, high=0.0, live=True
    )
    l_occ: float = setting(
        1.3863, 'log-odds added to the cell a beam ended in', low=0.0, high=20.0, live=True
    )


@dataclass(frozen=True)
class GaussianModelConfig:
    """The Gaussian inverse sensor model ([pose] Eq. 4, corrected)."""

    sigma: float = setting(
        0.03, 'standard deviation of a range, m', low=1e-4, high=10.0, live=True
    )
    sigma_growth: float = setting(
        0.0,
        'sigma grows by this times the square of the range, 1/m; stereo: 1 / (baseline * focal '
        'length in pixels)',
        low=0.0,
        high=10.0,
        live=True,
    )
    width: float = setting(
        0.0,
        'depth that a reading declares occupied, m; 0: the diagonal of a cell',
        low=0.0,
        high=100.0,
        live=True,
    )
    l_min: float = setting(
        -1.3863, 'the lowest log-odds one scan gives a cell', low=-20.0, high=-0.01, live=True
    )
    l_max: float = setting(
        1.3863, 'the highest log-odds one scan gives a cell', low=0.01, high=20.0, live=True
    )


@dataclass(frozen=True)
class SonarModelConfig:
    """The cone of a sonar ([slides]): linear in the range, Gaussian across the angle."""

    opening_angle: float = setting(
        0.5,
        'full angle of the cone, for readings without one of their own, rad',
        low=0.001,
        high=3.1,
        live=True,
    )
    sigma_share: float = setting(
        0.5,
        'standard deviation across the cone as a multiple of half its angle',
        low=0.01,
        high=100.0,
        live=True,
    )
    strength: float = setting(
        0.3,
        'largest change of a probability from 0.5 by one reading, at range 0',
        low=0.0,
        high=0.49,
        live=True,
    )
    strength_far: float = setting(
        0.1,
        'the same at range_max; linear in between',
        low=0.0,
        high=0.49,
        live=True,
    )
    thickness: float = setting(
        0.1,
        'a reading changes cells up to this distance before and behind it, m',
        low=0.001,
        high=10.0,
        live=True,
    )


@dataclass(frozen=True)
class PoseUncertainConfig:
    """How a belief about the pose becomes samples ([pose] section V)."""

    samples: int = setting(
        100,
        'poses drawn from a Gaussian belief',
        low=1,
        high=10_000,
        live=True,
    )
    max_particles: int = setting(
        200,
        'largest number of particles used of a cloud; of a larger one so many are drawn '
        'by their weights',
        low=1,
        high=1_000_000,
        live=True,
    )
    accuracy: float = setting(
        0.0,
        'above 0: draw only as many poses as the mean beam end needs to be within this of the '
        'true one (95 %), m',
        low=0.0,
        high=100.0,
        live=True,
    )
    negligible: float = setting(
        0.001,
        'particles with the smallest weights are left out, up to this total weight',
        low=0.0,
        high=0.5,
        live=True,
    )
    draw: str = setting(
        'quasi',
        'quasi: evenly spread draws (fewer are enough); random: independent draws',
        choices=('quasi', 'random'),
        live=True,
    )
    map_beams: float = setting(
        0.0,
        'above 0: poses are weighted by how well the scan fits the map so far, in which '
        'this many of its beams count as independent; 0: the weights of the localizer '
        'are used',
        low=0.0,
        high=60.0,
        live=True,
    )
    map_sigma: float = setting(
        0.1,
        'standard deviation of a range against the map so far, m; poses and cells included',
        low=0.001,
        high=10.0,
        live=True,
    )
    seed: int = setting(1, 'seed of the draws', low=0, high=2**31 - 1)


@dataclass(frozen=True)
class CountingConfig:
    """What the counting model shows ([slides])."""

    show: str = setting(
        'reflection',
        'reflection: hits / (hits + misses); ml: the more likely of 0 and 1',
        choices=('reflection', 'ml'),
        live=True,
    )


@dataclass(frozen=True)
class MapperConfig:
    """How scans become a grid; the same for the node, `map`, `bench` and plain Python."""

    method: str = setting(
        'two_assumption',
        'mapping method, see docs/methods.md',
        choices=(
            'two_assumption',
            'pose_uncertain',
            'adaptive',
            'counting',
            'random_field',
            'sonar',
        ),
    )
    inverse_model: str = setting(
        'step',
        'inverse sensor model: how one beam changes the cells around its end (two_assumption, '
        'pose_uncertain, random_field)',
        choices=('step', 'gaussian'),
        live=True,
    )
    fusion: str = setting(
        'per_scan',
        'per_scan: each cell once per scan, a hit beats a miss; per_beam: every beam counts',
        choices=('per_scan', 'per_beam'),
        live=True,
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
        live=True,
    )
    max_range: float = setting(
        0.0,
        'beams are used up to this range, m; a longer beam frees the cells up to it; 0: up to '
        'range_max of the scan',
        low=0.0,
        high=10000.0,
        live=True,
    )
    no_return: str = setting(
        'clear',
        'meaning of a range of +inf: clear: the beam is free up to range_max (REP 117); ignore:'
        ' not used, the better choice where glass or dark walls give no return',
        choices=('clear', 'ignore'),
        live=True,
    )
    max_cells: int = setting(
        100_000_000,
        'largest map, cells; a scan that would make it larger is dropped',
        low=4096,
        high=4_000_000_000,
    )
    step: StepModelConfig = StepModelConfig()
    gaussian: GaussianModelConfig = GaussianModelConfig()
    pose_uncertain: PoseUncertainConfig = PoseUncertainConfig()
    counting: CountingConfig = CountingConfig()
    sonar: SonarModelConfig = SonarModelConfig()
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
        'trinary',
        'what `map` and `map_refined` hold; trinary: 0, 100 or unknown, which planners need: for '
        'Nav2 every value from 1 to 99 is free space; probability: 0..100 in every measured cell',
        choices=('trinary', 'probability'),
        live=True,
    )
    occupied_thresh: float = setting(
        0.65,
        'occupied from this probability on (trinary, map files)',
        low=0.0,
        high=1.0,
        live=True,
    )
    free_thresh: float = setting(
        0.25, 'free up to this probability (trinary, map files)', low=0.0, high=1.0, live=True
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

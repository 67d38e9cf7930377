"""Settings of the judges of a map: the truth, beams it has not seen, a scan that may come."""

from __future__ import annotations

from dataclasses import dataclass

from ogm_mcmc.config.settings import check_bounds, setting

__all__ = [
    'AlignmentConfig',
    'CollisionConfig',
    'EvaluationConfig',
    'ExpectedScanConfig',
    'HeldOutConfig',
    'HeldOutPointsConfig',
]


@dataclass(frozen=True)
class EvaluationConfig:
    """Which cells are compared and what unknown ones stand for."""

    mask: str = setting(
        'all',
        'cells that count: all; measured: known in the map; near: within near_cells of such',
        choices=('all', 'measured', 'near'),
    )
    near_cells: int = setting(10, 'columns and rows, with mask near', low=0, high=100_000)
    unknown: float = setting(
        0.5,
        'probability of cells the map never measured (its prior). Unless it is given, cells of '
        'sampled maps that data did not move have what the NPZ says of them '
        '(probability_everywhere) with --truth, --beams and --points, and with --path a chance '
        'by the prior that the samples name and by what is known; --pose takes it for all such '
        'cells, given or not',
        low=0.0,
        high=1.0,
    )
    truth_unknown: str = setting(
        'exclude',
        'cells unknown in the truth: exclude them, or take them as occupied or free',
        choices=('exclude', 'occupied', 'free'),
    )
    threshold: float = setting(
        0.5, 'cells are called occupied from this probability on', low=0.0, high=1.0
    )
    floor: float = setting(
        1e-6,
        'for the divergence, estimates are kept this far from 0 and 1; 0 may give infinity',
        low=0.0,
        high=0.49,
    )
    bins: int = setting(10, 'bins of the reliability curve', low=1, high=1000)
    nearest: bool = setting(
        False, 'accept maps whose cells lie between those of the truth; the nearest is taken'
    )

    def __post_init__(self) -> None:
        """Refuse what is out of bounds."""
        check_bounds(self)


@dataclass(frozen=True)
class HeldOutConfig:
    """Which beams of a recording judge a map."""

    beams_stride: int = setting(1, 'use every so many-th placed scan', low=1, high=10**7)
    leaving: str = setting(
        'unknown',
        'beams that end outside of the map: unknown: the cells out there are as those never '
        'measured; exclude: such beams do not count',
        choices=('unknown', 'exclude'),
    )

    def __post_init__(self) -> None:
        """Refuse what is out of bounds."""
        check_bounds(self)


@dataclass(frozen=True)
class AlignmentConfig:
    """Whether and where a map is looked for that has another frame than the beams."""

    align: bool = setting(
        False,
        'every second scan looks for the frame of each map, where its beams fit it best; '
        'the others judge it there',
    )
    align_reach: float = setting(
        0.0,
        'how far a map may be moved, m, at the middle of what the beams met; 0: anywhere',
        low=0.0,
        high=1e6,
    )
    align_turn: float = setting(
        180.0, 'how far it may be turned to each side, degrees', low=0.0, high=180.0
    )

    def __post_init__(self) -> None:
        """Refuse what is out of bounds."""
        check_bounds(self)


@dataclass(frozen=True)
class HeldOutPointsConfig:
    """Which points of held-out beams judge a map."""

    point_step: float = setting(
        0.5, 'a free point every so many m along a beam', low=0.001, high=1000.0
    )

    def __post_init__(self) -> None:
        """Refuse what is out of bounds."""
        check_bounds(self)


@dataclass(frozen=True)
class ExpectedScanConfig:
    """The lidar of a scan that may come."""

    lidar_beams: int = setting(360, 'beams of the scan', low=1, high=100_000)
    lidar_range_max: float = setting(12.0, 'how far they reach, m', low=0.01, high=1000.0)
    lidar_field_of_view: float = setting(
        360.0, 'angle from first to last, around straight ahead, degrees', low=0.01, high=360.0
    )

    def __post_init__(self) -> None:
        """Refuse what is out of bounds."""
        check_bounds(self)


@dataclass(frozen=True)
class CollisionConfig:
    """Who goes a way that is asked about."""

    robot_radius: float = setting(
        0.22,
        'radius of the robot for collision_query, m',
        low=0.0,
        high=100.0,
        live=True,
    )

    def __post_init__(self) -> None:
        """Refuse what is out of bounds."""
        check_bounds(self)

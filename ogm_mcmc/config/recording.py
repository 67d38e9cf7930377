"""Settings of the window of scans that are kept for sampling."""

from __future__ import annotations

from dataclasses import dataclass

from ogm_mcmc.config.settings import check_bounds, setting

__all__ = ['KeepConfig', 'RecordingConfig']


@dataclass(frozen=True)
class KeepConfig:
    """Which scans go first, and which do not come in."""

    keep: str = setting(
        'coverage',
        'which scans go when the window is full: coverage: those of places and headings that '
        'others cover, too; latest: the oldest',
        choices=('coverage', 'latest'),
        live=True,
    )
    minimum_travel_distance: float = setting(
        0.0,
        'a scan does not come in if its sensor moved less than this since the last one kept, m, '
        'and turned less than minimum_travel_heading; 0: every scan may',
        low=0.0,
        high=1000.0,
        live=True,
    )
    minimum_travel_heading: float = setting(
        0.5, 'see minimum_travel_distance, rad', low=0.0, high=6.3, live=True
    )

    def __post_init__(self) -> None:
        """Refuse what is out of bounds."""
        check_bounds(self)


@dataclass(frozen=True)
class RecordingConfig:
    """How much is kept for sampling; `window.keep` says what goes first."""

    window: KeepConfig = KeepConfig()
    max_scans: int = setting(2000, 'scans kept for sampling', low=1, high=10**7, live=True)
    max_seconds: float = setting(
        0.0,
        'scans older than this before the newest are let go, s; 0: none',
        low=0.0,
        high=1e9,
        live=True,
    )
    max_rays: int = setting(1_000_000, 'beams kept for sampling', low=1, high=10**9, live=True)

    def __post_init__(self) -> None:
        """Refuse what is out of bounds."""
        check_bounds(self)

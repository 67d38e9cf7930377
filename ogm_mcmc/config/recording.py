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
        'which scans are removed when the window is full: coverage: those whose place and '
        'heading are covered by others; latest: the oldest',
        choices=('coverage', 'latest'),
        live=True,
    )
    minimum_travel_distance: float = setting(
        0.0,
        'a scan is kept only if the sensor moved this far since the last kept scan, m, or '
        'turned by minimum_travel_heading; 0: keep every scan',
        low=0.0,
        high=1000.0,
        live=True,
    )
    minimum_travel_heading: float = setting(
        0.5,
        'smallest turn for a new scan, see minimum_travel_distance, rad',
        low=0.0,
        high=6.3,
        live=True,
    )

    def __post_init__(self) -> None:
        """Refuse what is out of bounds."""
        check_bounds(self)


@dataclass(frozen=True)
class RecordingConfig:
    """How much is kept for sampling; `window.keep` says what goes first."""

    window: KeepConfig = KeepConfig()
    max_scans: int = setting(
        2000, 'largest number of scans kept for sampling', low=1, high=10**7, live=True
    )
    max_seconds: float = setting(
        0.0,
        'scans this much older than the newest are removed, s; 0: age does not matter',
        low=0.0,
        high=1e9,
        live=True,
    )
    max_rays: int = setting(
        1_000_000, 'largest number of beams kept for sampling', low=1, high=10**9, live=True
    )

    def __post_init__(self) -> None:
        """Refuse what is out of bounds."""
        check_bounds(self)

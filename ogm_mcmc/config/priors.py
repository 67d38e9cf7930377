"""Settings of patch priors: how patches are counted, and how counts become probabilities."""

from __future__ import annotations

from dataclasses import dataclass

from ogm_mcmc.config.settings import check_bounds, setting

__all__ = ['LearningConfig', 'PatchTableConfig']


@dataclass(frozen=True)
class LearningConfig:
    """How patches of training maps are counted ([patch] section III)."""

    resolution: float = setting(
        0.05, 'side of a cell of the prior, m; finer maps are rescaled to it', low=0.001, high=10.0
    )
    coarser: str = setting(
        'as_is',
        'maps coarser than the prior are counted as_is, cell for cell, which predicts other maps '
        'better than to stretch them into blocks of equal cells; skip leaves them out',
        choices=('as_is', 'stretch', 'skip'),
    )
    unknown: str = setting(
        'occupied',
        'occupied: unknown cells are solid, as behind the walls of the maps of [patch]; skip: '
        'patches with an unknown cell are left out, and with them nearly every outer wall',
        choices=('occupied', 'skip'),
    )
    margin: float = setting(
        0.5,
        'patches are counted as far as this from the nearest known cell, m: how much blank '
        'canvas surrounds a building is no property of buildings',
        low=0.0,
        high=1000.0,
    )

    def __post_init__(self) -> None:
        """Refuse what is out of bounds."""
        check_bounds(self)


@dataclass(frozen=True)
class PatchTableConfig:
    """How counts become the table a sampler uses, see `ogm_mcmc.sampling.border_backoff`."""

    backoff_weight: float = setting(
        5.0,
        'what fewer border cells say weighs as much as this many windows for every different '
        'patch that was seen with the border',
        low=0.01,
        high=1000.0,
    )
    min_windows: int = setting(
        50, 'a border seen less often has no entry of its own', low=1, high=1_000_000_000
    )
    min_probability: float = setting(
        0.01,
        'less likely patches of a border are not listed and share a floor',
        low=0.0,
        high=0.5,
    )
    min_share: float = setting(
        1e-4,
        'the same where the border is not looked at (prior patch)',
        low=0.0,
        high=0.5,
    )
    strength: float = setting(
        1.0,
        'power that the probabilities of the table, floors too, are raised to; above 1 what is '
        'likely becomes likelier; 1: as counted',
        low=0.1,
        high=10.0,
    )
    max_floor: float = setting(
        1.0,
        'largest total probability of the patches that are treated as equally likely; '
        '1: as learned',
        low=1e-12,
        high=1.0,
    )

    def __post_init__(self) -> None:
        """Refuse what is out of bounds."""
        check_bounds(self)

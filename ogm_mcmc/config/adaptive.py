"""Settings of the adaptive map: how leaves split and merge ([pose] section VI)."""

from __future__ import annotations

from dataclasses import dataclass

from ogm_mcmc.config.settings import setting

__all__ = ['AdaptiveConfig']


@dataclass(frozen=True)
class AdaptiveConfig:
    """How leaves of the quadtree split and merge; a level says 2**level cells of `resolution`."""

    finest_level: int = setting(0, 'smallest leaf: 2**level cells a side', low=0, high=12)
    coarsest_level: int = setting(
        4,
        'largest leaf: 2**level cells a side; the tree starts with leaves of this size',
        low=0,
        high=12,
    )
    output_level: int = setting(
        0,
        'cells of the published map: 2**level cells a side, with the mean log-odds of the leaves',
        low=0,
        high=12,
    )
    unknowns: bool = setting(
        True,
        'count beams that end before a leaf in its test; false: hits and misses only',
        parameter=False,
    )
    way_to_hit: bool = setting(
        True,
        'a beam that ends in a leaf also counts as a miss, in proportion to the part of the '
        'leaf it crossed; false: as a hit only',
        parameter=False,
    )
    significance: float = setting(
        0.05,
        'significance level of the chi-square test that a leaf is all free or all occupied; a '
        'leaf that fails it splits; 1: always, 0: never',
        low=0.0,
        high=1.0,
    )
    noise: float = setting(
        0.02,
        'expected share of wrong measurements in a leaf that is all free or all occupied',
        low=1e-4,
        high=0.3,
    )
    count_limit: float = setting(
        1000.0,
        'counts of a leaf are capped at this total (both are scaled down), so that old counts '
        'do not hide new objects',
        low=1.0,
        high=1e9,
    )
    merge_free: float = setting(
        0.05,
        'four siblings merge when all are below this probability; 0: never',
        low=0.0,
        high=0.5,
    )
    merge_occupied: float = setting(
        0.95,
        'four siblings merge when all are above this probability; 1: never',
        low=0.5,
        high=1.0,
    )
    merge_spread: float = setting(
        0.02,
        'four siblings merge when the standard deviation of their probabilities is below this '
        'and their mean is near 0 or 1 (merge_margin); 0: never',
        low=0.0,
        high=0.5,
    )
    merge_margin: float = setting(
        0.1, 'largest distance of that mean from 0 or 1', low=0.0, high=0.5
    )

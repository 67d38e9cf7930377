"""Settings of the adaptive map: how leaves split and merge ([pose] section VI)."""

from __future__ import annotations

from dataclasses import dataclass

from ogm_mcmc.config.settings import setting

__all__ = ['AdaptiveConfig']


@dataclass(frozen=True)
class AdaptiveConfig:
    """How leaves of the quadtree split and merge; a level says 2**level cells of `resolution`."""

    finest_level: int = setting(0, 'no leaf is smaller than 2**this cells', low=0, high=12)
    coarsest_level: int = setting(
        4, 'no leaf is larger than 2**this cells; the tree starts with these', low=0, high=12
    )
    output_level: int = setting(
        0,
        'the map that is shown has cells of 2**this; they hold the mean log-odds',
        low=0,
        high=12,
    )
    unknowns: bool = setting(
        True,
        'beams that end before a leaf take part in its test; false: hits and misses only',
        parameter=False,
    )
    way_to_hit: bool = setting(
        True,
        'a beam that ends in a leaf is also a miss, by the share of its side it crossed first; '
        'false: a hit and nothing else',
        parameter=False,
    )
    significance: float = setting(
        0.05,
        'a leaf splits when counts like these are rarer than this in one that is all free or all '
        'occupied; 1: always, 0: never',
        low=0.0,
        high=1.0,
    )
    noise: float = setting(
        0.02, 'share of beams expected to contradict a leaf without a border', low=1e-4, high=0.3
    )
    count_limit: float = setting(
        1000.0,
        'hits and misses of a leaf shrink together to this many beams, so that it still splits '
        'when something new stands in it',
        low=1.0,
        high=1e9,
    )
    merge_free: float = setting(
        0.05, 'siblings all below this probability merge; 0: never', low=0.0, high=0.5
    )
    merge_occupied: float = setting(
        0.95, 'siblings all above this probability merge; 1: never', low=0.5, high=1.0
    )
    merge_spread: float = setting(
        0.02,
        'siblings merge when the standard deviation of their probabilities is below this and '
        'their mean is certain (merge_margin); 0: never',
        low=0.0,
        high=0.5,
    )
    merge_margin: float = setting(
        0.1, 'how near to 0 or 1 the mean of siblings counts as certain', low=0.0, high=0.5
    )

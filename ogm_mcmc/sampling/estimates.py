"""What samples of maps tell beyond their mean."""

from __future__ import annotations

import numpy as np

from ogm_mcmc.arrays import AnyArray, Float64Array
from ogm_mcmc.errors import require
from ogm_mcmc.geometry import GridMap

__all__ = [
    'at_least',
    'hide_uncertain',
    'mutual_information_bits',
    'pair_information_bits',
    'with_neighbours',
    'with_one_more_draw',
    'with_share_of',
]

# A cell that is the same in all draws is shown if the prior alone seldom does that.
SAME_BY_CHANCE = 0.05

# A guess at a probability is no surer than this: it is none of the draws. Sure to be free is told
# finely, because it orders cells: the same draws of the demo's office, all beams, 250 sweeps, have
# a ROC area of 0.985 with a millionth, as on the other side, and 0.992 like this; with reflections
# weighed 0.2, too, 0.9990 and 0.9996.
SURELY_FREE, SURELY_OCCUPIED = 1e-30, 1.0 - 1e-6

# Differences of probabilities that are smaller than this are rounding.
IMPOSSIBLE = 1e-15


def mutual_information_bits(samples: AnyArray) -> Float64Array:
    """Mutual information (c, c) between chosen cells, bits ([patch] Fig. 2).

    samples  (S, c) of 0 and 1: one row a map. I(a; b) = sum p(a, b) log2 p(a, b) / (p(a) p(b));
    on the diagonal it is the entropy of the cell. Raises ConfigError without a sample.
    """
    require(samples.shape[0] > 0, 'samples', samples.shape[0], 'expected at least one')
    # Counts are whole numbers, so what never happened is exactly 0.
    ones = samples.astype(np.float64)
    n, one = ones.shape[0], ones.sum(axis=0)
    zero = n - one
    both = ones.T @ ones
    a, b = one[:, None], one[None, :]
    joint = np.stack((both, a - both, b - both, n - a - b + both))
    product = np.stack(
        (np.outer(one, one), np.outer(one, zero), np.outer(zero, one), np.outer(zero, zero))
    )
    return _information(joint / n, product / n**2)


def pair_information_bits(p: Float64Array, both: Float64Array) -> Float64Array:
    """Mutual information (c, c), bits, of cells that are occupied with `p` (c,), two with `both`.

    both  (c, c): p(a = 1, b = 1), on the diagonal p(a = 1)
    """
    a, b, q = p[:, None], p[None, :], 1.0 - p
    joint = np.stack((both, a - both, b - both, 1.0 - a - b + both))
    joint[joint < IMPOSSIBLE] = 0.0
    product = np.stack((np.outer(p, p), np.outer(p, q), np.outer(q, p), np.outer(q, q)))
    return _information(joint, product)


def _information(joint: Float64Array, product: Float64Array) -> Float64Array:
    """Sum over the four states of two cells, bits; both (4, c, c)."""
    with np.errstate(divide='ignore', invalid='ignore'):
        terms = joint * np.log2(joint / product)
    terms[joint == 0.0] = 0.0
    information: Float64Array = terms.sum(axis=0)
    return np.maximum(information, 0.0)


def hide_uncertain(
    grid_map: GridMap,
    prior: float,
    margin: float,
    draws: int = 0,
    drawn: GridMap | None = None,
    guess: GridMap | None = None,
) -> GridMap:
    """Return a map with nan wherever what was drawn is no more certain than the prior.

    `drawn`, of the same cells, is the mean of the draws and decides; without it the map itself.
    What is mixed into the map says how solid a cell is, not how sure the draws are.
    Certain is max(p, 1 - p); a cell is shown when it exceeds that of the prior by `margin`. For a
    mean of so many `draws`, all maps that are in it and no others (of the burn-in, too, while the
    mean of these is shown), it must also differ from the prior by more than chance makes a cell
    differ of which no beam says anything: by three standard errors,
    3 sqrt(prior (1 - prior) / draws), or by being the same in all of enough draws. With `guess`,
    another map of the same beams, nan where none came, fewer will do where it says what they do:
    a cell that it knows is none of which no beam says anything. And where it has a wall a cell is
    shown if it is occupied in more draws than one half, or than the prior has, by `margin`: how
    sure the prior is of free space is no measure of walls that beams met.

    Design note. With two chains nothing is shown after a sweep without a guess, of Intel's map
    8 023 cells after four and 218 193 after eight, which is a second later; with the live map as
    guess 213 400 after one. Of these 1 341 are not shown after 100 sweeps, when 221 014 are.
    A reading at the surface of a wall that does not follow the lattice may be of two cells. With
    0.69 or more asked of both alike few walls that sparse beams met were shown: of solid cells
    that were met, a hospital turned by 40 degrees, 5 % of the beams, 0.30 (now 0.57; the live map
    0.77), of what was shown as solid 0.95 filled by 0.3 or more (0.90; 0.67).
    """
    p = grid_map.probability if drawn is None else drawn.probability
    limit = max(prior, 1.0 - prior) + margin
    with np.errstate(invalid='ignore'):
        shown = np.maximum(p, np.float32(1.0) - p) > limit
        if draws > 0:
            by_chance = 3.0 * np.sqrt(prior * (1.0 - prior) / draws)
            differs = np.abs(p - np.float32(prior)) > by_chance
            # The same in all draws, also of a map in which a guess is one more draw.
            same = np.float32(1.0 / (draws + 1))
            differs |= (p < same) & ((1.0 - prior) ** draws < SAME_BY_CHANCE)
            differs |= (np.float32(1.0) - p < same) & (prior**draws < SAME_BY_CHANCE)
            if guess is not None:
                differs |= (p < same) & (guess.probability < 0.5)
                differs |= (np.float32(1.0) - p < same) & (guess.probability > 0.5)
            shown &= differs
        if guess is not None:
            shown |= (guess.probability > 0.5) & (p > max(prior, 0.5) + margin)
    return GridMap(grid_map.spec, np.where(shown, grid_map.probability, np.float32(np.nan)))


def with_one_more_draw(mean: GridMap, guess: GridMap, draws: int) -> GridMap:
    """Return the mean of draws with a guess at it, nan for none, as one more of them.

    Cells that are the same in all n draws may be occupied in one of a hundred n or in none: the
    guess orders what they tie. It moves nothing by more than 1 / (n + 1). Demo office, one of 20
    beams: ROC area 0.982 without, 0.996 with the live map as guess (which has 0.994 by itself);
    F1, Brier score and calibration error are the same to three digits. Few draws gain most: Intel,
    every second beam mapped, nats a held-out beam, draws alone and with it: .915, 1.258 after one
    sweep, .973, 1.281 after four, 1.000, 1.286 after seven; the live map .912.
    """
    bounded = np.clip(guess.probability, SURELY_FREE, SURELY_OCCUPIED)
    return with_share_of(mean, GridMap(mean.spec, bounded), 1.0 / (draws + 1))


def with_neighbours(mean: GridMap, share: float) -> GridMap:
    """Return a map in which cells that it is sure of have a share of each cell beside them.

    p + share (1 - 2 p)^2 sum of (q - p) over its four neighbours q, but for those that are nan or
    off the map. Cells in doubt stay as they are, unknown ones unknown.
    share  of each neighbour, 0 to 0.25; more could leave 0 to 1

    Design note. Where cells begin is arbitrary. Chains whose lattice lies a fraction of a cell
    away have the rim of a wall in the next cell, and are as sure of it. Maps that are the mean of
    four such lattices predict the beams of logs better, but each needs an index of rays, and
    chains of its own to agree. Where readings may be of the cell beside the one that they end in,
    this gains a part of it, at no cost: see `docs/results.md`, Other lattices. Of doubtful cells,
    too, it would gain the same, but a thirtieth of the walls that few beams met would no longer
    be sure enough to be shown (0.65; Intel, 5 %).
    """
    p = mean.probability
    rise = np.zeros_like(p)
    across, along = (np.nan_to_num(np.diff(p, axis=axis), nan=0.0) for axis in (1, 0))
    rise[:, :-1] += across
    rise[:, 1:] -= across
    rise[:-1] += along
    rise[1:] -= along
    sure = np.square(np.float32(1.0) - np.float32(2.0) * p)
    return GridMap(mean.spec, p + np.float32(share) * sure * rise)


def with_share_of(
    mean: GridMap,
    other: GridMap,
    share: float,
    lowering: float | None = None,
    of_sure: float = 1.0,
) -> GridMap:
    """Return a map of which `other`, nan for none, has a share: (1 - share) mean + share other.

    Where that would lower the mean of a cell which `other` holds possible at all it has the share
    `lowering` instead, if any is given. Of a cell that the mean is sure of the share is `of_sure`
    times as large, of others in between: it goes along with the standard deviation of the cell, of
    which 2 sqrt(p (1 - p)) is 1 at most.

    Design note. A sampler holds cells for solid or free. Where the edge of a wall runs through a
    cell, or beams pass glass and legs, some are reflected and others pass: it calls such cells
    free for certain, and they are solid as often as not. What it ties at next to nothing the share
    of beams that a cell reflected (counting, [slides]) tells apart, whatever the number of draws.
    Best F1, F1 at 0.5, ROC area, Brier score and calibration error of the mean with the live map
    as one more draw, as finely as it orders cells, with a share for counting; the same draws in
    all rows of a map:

    =======================  =====  ===========================
    simulated                share  F1 F1 ROC Brier calibration
    =======================  =====  ===========================
    office, all beams        0      .976 .962 .9923 .0024 .0032
    the same                 0.05   .990 .963 .9996 .0023 .0034
    the same                 0.2    .990 .963 .9996 .0021 .0039
    office, 5 %              0      .969 .966 .9960 .0018 .0021
    the same                 0.05   .970 .966 .9993 .0018 .0024
    the same                 0.2    .972 .966 .9994 .0018 .0033
    building 1, 5 %          0      .976 .971 .9999 .0024 .0082
    the same                 0.05   .980 .976 .9999 .0023 .0082
    the same                 0.2    .987 .985 1.000 .0018 .0076
    uma_236_237, 5 %         0      .829 .772 .997  .0079 .0102
    the same                 0.05   .847 .791 .998  .0073 .0109
    the same                 0.2    .909 .874 .999  .0058 .0119
    the same                 0.3    .928 .906 .999  .0050 .0110
    pal_hospital, 5 %        0      .772 .722 .997  .0063 .0120
    the same                 0.2    .881 .834 .999  .0045 .0130
    the same                 0.3    .910 .887 .999  .0039 .0123
    =======================  =====  ===========================

    Nats a held-out beam of Intel, every second pose mapped: 1.102 without, 1.210 with 0.05, 1.236
    with 0.1, 1.262 with 0.2 and 1.274 with 0.3. The office, where every wall is straight and
    every reading right within a cell, pays in calibration; so 0.2.
    The live map with a share of 0.05 does as well in the office and takes a sparse building's
    calibration error to 0.015: one beam through a free cell leaves it at 0.2.
    """
    p, q = mean.probability, other.probability
    weight: AnyArray | float = share
    if of_sure < 1.0:
        doubt = 2.0 * np.sqrt(p * (np.float32(1.0) - p))
        weight = share * (of_sure + (1.0 - of_sure) * doubt)
    if lowering is not None:
        with np.errstate(invalid='ignore'):
            weight = np.where((q > 0.0) & (q < p), np.float32(lowering), np.float32(weight))
    mixed = (1.0 - weight) * p + weight * q
    return GridMap(mean.spec, np.where(np.isnan(q), p, mixed).astype(np.float32))


def at_least(mean: GridMap, least: GridMap) -> GridMap:
    """Return the mean, raised to `least`, nan for nothing, where it is below.

    Design note. A cell that the edge of a wall runs through reflected 67 of 143 beams, say. The
    sampler calls it free for certain, since so many passed, and a weight of 0.2 for the share that
    was reflected leaves it at 0.09. But 12 of the demo office's 70 847 free cells reflected more
    than two beams in ten. So the share itself is the least that is believed, as if 5 to 20 more
    beams had passed, more where readings may be of other cells (`Reflections.least`, `blur_of`):
    of a few beams it says nothing, of hundreds all.
    Best F1, F1 at 0.5, Brier score and calibration error, the weight 0.2; Intel, every second
    pose mapped: nats a held-out beam:

    ===================  ===================  =====
    share at least, as   office, all beams    Intel
    ===================  ===================  =====
    (live map)           .964 .964 .0025 .0030
    not                  .991 .957 .0024 .0045 1.262
    20 more had passed   .991 .965 .0016 .0040 1.263
    10 more              .992 .967 .0016 .0040 1.260
    5 more               .992 .969 .0015 .0040 1.252
    ===================  ===================  =====

    Where beams are few nothing changes (buildings 1 and 9, two map images, Intel's experiment 3).
    """
    p, q = mean.probability, least.probability
    return GridMap(mean.spec, np.where(np.isnan(p), p, np.fmax(p, q)).astype(np.float32))

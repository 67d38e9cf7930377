"""`evaluate --align`: where maps lie that have another frame than the beams."""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from tqdm import tqdm

from ogm_mcmc.arrays import Float64Array
from ogm_mcmc.config import AlignmentConfig, build, given
from ogm_mcmc.errors import BagError, ConfigError, GridError
from ogm_mcmc.evaluation import (
    ForwardModel,
    FoundFrame,
    FrameSearch,
    HeldOutBeams,
    beam_log_likelihood,
    find_frame,
    gain_near_by,
    held_out_beams,
)
from ogm_mcmc.geometry import GridMap, PlacedScan, Pose2D

__all__ = [
    'alignment_of',
    'found_frames',
    'frame_figures',
    'frame_hint',
    'frame_said',
    'split_for_fit',
]

# A map lies where it was put if that place is better than the next one in such a share of the
# scans. Maps of another building reached 0.74, those of the right one 0.93 and more, but for one
# that says next to nothing (0.77): see docs/evaluation.md.
SURE_FROM = 0.8
SAME_NATS = 1e-3

# Without `--align`: a map that gains so many nats a beam by a small move, or outside of which such
# a share of the beams end, may lie in another frame.
MUCH_NATS, MOST_OUTSIDE = 0.2, 0.5


def alignment_of(options: argparse.Namespace) -> AlignmentConfig:
    """Return whether and how maps are looked for. Raises ConfigError for what has no use."""
    named = given(options, AlignmentConfig)
    config = build(AlignmentConfig, named)
    if not config.align:
        for name in named:
            if name != 'align':
                raise ConfigError(f'--{name.replace("_", "-")}: expected --align with it')
        return config
    if options.bag is None:
        raise ConfigError('--align: expected --beams BAG, whose beams say where maps lie')
    for judge in ('truth', 'pose'):
        if getattr(options, judge) is not None:
            raise ConfigError(
                f'--align with --{judge}, which asks the map as given: expected --beams alone'
            )
    return config


def split_for_fit(
    bag: object, placed: list[PlacedScan]
) -> tuple[list[PlacedScan], list[PlacedScan]]:
    """Return scans that look for frames and scans that judge. Raises BagError for one scan."""
    if len(placed) < 2:
        raise BagError(
            f'{bag}: {len(placed)} scan for --align: expected at least 2, every second one fits '
            'and the others judge'
        )
    return placed[::2], placed[1::2]


def found_frames(
    maps: Mapping[str, GridMap],
    placed: Iterable[PlacedScan],
    model: ForwardModel,
    config: AlignmentConfig,
    *,
    prior: float,
    max_range_m: float,
    no_return: str,
) -> dict[str, FoundFrame]:
    """Look for the frame of every map in the same way, by the same scans. Raises GridError."""
    search = FrameSearch(config.align_reach, math.radians(config.align_turn))
    scans = list(placed)
    frames = {}
    for name, grid_map in tqdm(maps.items(), unit=' maps', desc='align', disable=None):
        try:
            beams = held_out_beams(
                scans, grid_map.spec, max_range_m=max_range_m, no_return=no_return
            )
            frames[name] = find_frame(grid_map, beams.placed, model, prior=prior, search=search)
        except GridError as error:
            raise GridError(f'{name}: {error}') from error
    return frames


def frame_figures(
    found: FoundFrame,
    grid_map: GridMap,
    beams: HeldOutBeams,
    values: Float64Array,
    model: ForwardModel,
    prior: float,
) -> dict[str, Any]:
    """Return the figures of a frame, by beams that judge; `values` (N,) are theirs there, nats."""

    def against(frame: Pose2D) -> Float64Array:
        scans = beams.seen_from(frame, grid_map.spec).placed
        return values - beam_log_likelihood(grid_map, scans, model, prior=prior)

    figures: dict[str, Any] = {
        **_as_dict(found.frame),
        'nats_per_beam_of_fit': found.nats,
        'above_as_given': _mean(beams, against(Pose2D())),
        'elsewhere': None,
        'fits': None,
    }
    if found.elsewhere is not None:
        gap = against(found.elsewhere)
        by_scan = beams.per_scan(gap)
        told = np.abs(by_scan) > SAME_NATS
        share = float((by_scan[told] > 0.0).mean()) if told.any() else 0.5
        figures['elsewhere'] = {
            **_as_dict(found.elsewhere),
            'below': _mean(beams, gap),
            'share_of_scans': share,
        }
        figures['fits'] = share >= SURE_FROM
    return figures


def frame_hint(grid_map: GridMap, beams: HeldOutBeams, model: ForwardModel, prior: float) -> str:
    """Return why a map may lie in another frame than beams that judge it; empty if not."""
    gain = gain_near_by(grid_map, beams.placed, model, prior=prior)
    if gain > MUCH_NATS:
        why = f'moved a little it has {gain:.2f} nats a beam more'
    elif (share := float(beams.leaving.mean())) > MOST_OUTSIDE:
        why = f'{share:.0%} of the beams end where it has no cells'
    else:
        return ''
    return f'{why}: does it lie in another frame? (--align)'


def frame_said(of: Mapping[str, Any], config: AlignmentConfig) -> str:
    """Return a frame and how sure it is in one line."""
    above = of['above_as_given']
    if of['x_m'] == of['y_m'] == of['yaw_rad'] == 0.0:
        line = 'as given: it fits nowhere better'
    else:
        line = (
            f'its frame at {_shown(of)}: {above["nats_per_beam"]:+.3f}'
            f' +- {above["standard_error"]:.3f} nats a beam to the map as given'
        )
    if of['fits'] is not False:
        return line
    other = of['elsewhere']
    wider = config.align_reach > 0.0 or config.align_turn < 180.0
    return (
        f'fits nowhere for sure; best {line}, but in {1.0 - other["share_of_scans"]:.0%} of the '
        f'scans worse than at {_shown(other)}'
        + ('; --align-reach 0 --align-turn 180 look everywhere' if wider else '')
    )


def _as_dict(frame: Pose2D) -> dict[str, float]:
    return {'x_m': frame.x_m, 'y_m': frame.y_m, 'yaw_rad': frame.yaw_rad}


def _shown(of: Mapping[str, float]) -> str:
    return f'{of["x_m"]:.3f} m, {of["y_m"]:.3f} m, {math.degrees(of["yaw_rad"]):.2f} degrees'


def _mean(beams: HeldOutBeams, values: Float64Array) -> dict[str, float]:
    ratio = beams.mean(values)
    return {'nats_per_beam': ratio.value, 'standard_error': ratio.standard_error}

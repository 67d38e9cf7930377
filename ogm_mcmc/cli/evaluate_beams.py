"""`evaluate MAP --beams BAG`: what a map says of beams it has not seen."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from tqdm import tqdm

from ogm_mcmc.arrays import AnyArray, Float64Array
from ogm_mcmc.cli.bag_scans import BagScans, read_bag
from ogm_mcmc.cli.evaluate_answer import Answer
from ogm_mcmc.cli.evaluate_frames import (
    alignment_of,
    found_frames,
    frame_figures,
    frame_hint,
    frame_said,
    split_for_fit,
)
from ogm_mcmc.config import HeldOutConfig, PlacingConfig, SamplerConfig, flatten
from ogm_mcmc.engine.no_returns import NoReturnChoice, no_return_of
from ogm_mcmc.errors import BagError
from ogm_mcmc.evaluation import (
    ForwardModel,
    FoundFrame,
    HeldOutBeams,
    Ratio,
    beam_log_likelihood,
    held_out_beams,
    log_likelihood_of_samples,
)
from ogm_mcmc.geometry import GridMap, Pose2D
from ogm_mcmc.io.map_files import JudgedMap
from ogm_mcmc.io.sample_files import load_samples
from ogm_mcmc.plotting import Picture, Series, curves_png, heat_png, probability_png

__all__ = ['Held', 'beam_figures', 'beam_settings', 'by_beams', 'read_figures', 'read_held_out']

# So many nats below the usual log-likelihood are a great surprise.
SURPRISE = 6.0


class Held(NamedTuple):
    """A bag, the beams of it that judge, and what a range of +inf was taken to mean.

    `beams` lie in the frame of the bag; `frames` says by name where maps were found, if asked to.
    """

    bag: BagScans
    beams: HeldOutBeams
    no_return: NoReturnChoice
    frames: dict[str, FoundFrame]

    def frame_of(self, name: str) -> Pose2D:
        """Return where the frame of a map lies."""
        return self.frames[name].frame if name in self.frames else Pose2D()

    def beams_in(self, name: str, grid_map: GridMap) -> HeldOutBeams:
        """Return the beams in the frame of a map."""
        return self.beams.seen_from(self.frame_of(name), grid_map.spec)


def by_beams(
    options: argparse.Namespace,
    judged: JudgedMap,
    unknown: float,
    choice: HeldOutConfig,
    placing: PlacingConfig,
    sampler: SamplerConfig,
) -> tuple[Answer, HeldOutBeams]:
    """Judge a map, and the maps of `options.samples`, by the beams of `options.bag`.

    Returns the beams, too. A scan is taken to come from the mean of the belief about its pose.
    """
    samples = None if options.samples is None else load_samples(options.samples, options.max_cells)
    model = ForwardModel.from_config(sampler.model)
    name = str(options.map)
    held = read_held_out(options, {name: judged.filled}, choice, placing, sampler, unknown)
    beams = held.beams_in(name, judged.filled)
    with tqdm(beams.placed, unit=' scans', desc='judge', disable=None) as bar:
        values = beam_log_likelihood(judged.filled, bar, model, prior=unknown)
    figures = {**read_figures(options, held), **beam_figures(beams, values)}
    alignment = alignment_of(options)
    rows = []
    if name in held.frames:
        figures['alignment'] = frame_figures(
            held.frames[name], judged.filled, held.beams, values, model, unknown
        )
        rows = [('aligned', frame_said(figures['alignment'], alignment))]
    elif hint := frame_hint(judged.filled, beams, model, unknown):
        rows, figures['hint'] = [('the map', hint)], hint
    if samples is not None:
        maps = tqdm(
            samples.grid_maps(), total=len(samples.maps), unit=' maps', desc='judge', disable=None
        )
        mixture = log_likelihood_of_samples(maps, beams.placed, model, prior=unknown)
        figures['samples'] = {
            'file': str(options.samples),
            'maps': len(samples.maps),
            **_figure(beams, mixture),
            'above_map': _named(beams.mean(mixture - values)),
        }
    pictures = _pictures(judged.known, beams, values)
    settings = {
        **beam_settings(choice, placing, sampler, held.no_return),
        **flatten(alignment),
    }
    answer = Answer(figures, rows + _rows(figures), [('Held-out beams', pictures)], settings)
    return answer, beams


def read_held_out(
    options: argparse.Namespace,
    maps: Mapping[str, GridMap],
    choice: HeldOutConfig,
    placing: PlacingConfig,
    sampler: SamplerConfig,
    unknown: float,
) -> Held:
    """Read `options.bag` and choose the beams that judge those maps, all the same ones.

    With `leaving` exclude they end inside of every map. Where `window.no_return` is auto, all
    scans of the bag tell what +inf means. With `--align` every second scan looks for the maps, and
    the others judge.
    """
    window = sampler.window
    bag = read_bag(options, placing)
    placed, left_out = bag.placed[:: choice.beams_stride], 0
    cell_m = min(one.spec.resolution_m for one in maps.values())
    found = no_return_of(window.no_return, bag.placed, cell_m, window.max_range)
    no_return = found.value
    frames: dict[str, FoundFrame] = {}
    alignment = alignment_of(options)
    if alignment.align:
        fitting, placed = split_for_fit(options.bag, placed)
        frames = found_frames(
            maps,
            fitting,
            ForwardModel.from_config(sampler.model),
            alignment,
            prior=unknown,
            max_range_m=window.max_range,
            no_return=no_return,
        )
    for name, grid_map in maps.items():
        beams = held_out_beams(
            placed,
            grid_map.spec,
            max_range_m=window.max_range,
            no_return=no_return,
            leaving=choice.leaving,
            frame=frames[name].frame if name in frames else None,
        )
        placed, left_out = beams.placed, left_out + beams.left_out
        no_return = 'clear'  # what has no return now is a reading beyond --max-range
    if not beams.placed:
        raise BagError(
            f'{options.bag}: no beam of {len(bag.placed)} placed scans says anything '
            f'({left_out} left out because they end outside of the map): expected some'
        )
    return Held(bag, beams._replace(left_out=left_out), found, frames)


def beam_settings(
    choice: HeldOutConfig,
    placing: PlacingConfig,
    sampler: SamplerConfig,
    no_return: NoReturnChoice,
) -> dict[str, Any]:
    """Return the settings that say how beams were chosen and understood."""
    sampler = replace(sampler, window=replace(sampler.window, no_return=no_return.value))
    return {
        **{
            name: value
            for name, value in flatten(sampler).items()
            if name.startswith('model.') or name in ('window.max_range', 'window.no_return')
        },
        **flatten(choice),
        **flatten(placing),
    }


def read_figures(options: argparse.Namespace, held: Held) -> dict[str, Any]:
    """Return what was read and used, for the JSON."""
    bag, beams = held.bag, held.beams
    return {
        'bag': str(options.bag),
        **bag.topics.as_dict(),
        'dropped': bag.dropped,
        'scans_used': len(beams.placed),
        'left_out': beams.left_out,
        'meaning_of_no_return': {**held.no_return.as_dict(), 'why': str(held.no_return)},
    }


def beam_figures(beams: HeldOutBeams, values: Float64Array) -> dict[str, Any]:
    """Figures of all beams, and of those that did and did not return or that leave the map."""
    return {
        **_figure(beams, values),
        'returned': _figure(beams, values, beams.returned),
        'no_return': _figure(beams, values, ~beams.returned),
        'ending_outside': _figure(beams, values, beams.leaving),
    }


def _figure(
    beams: HeldOutBeams, values: Float64Array, of: AnyArray | None = None
) -> dict[str, Any]:
    count = beams.scan.size if of is None else int(of.sum())
    return {'beams': count, **_named(beams.mean(values, of))}


def _named(ratio: Ratio) -> dict[str, float]:
    return {'nats_per_beam': ratio.value, 'standard_error': ratio.standard_error}


def _rows(of: dict[str, Any]) -> list[tuple[str, str]]:
    """Return the figures as name and value, for people."""
    rows = [
        ('held-out beams', f'{of["beams"]} of {of["scans_used"]} scans'),
        ('log-likelihood, nats a beam', _shown(of)),
        ('  of beams that returned', f'{_shown(of["returned"])} ({of["returned"]["beams"]})'),
    ]
    for name, key in (
        ('  of those without a return', 'no_return'),
        ('  ending outside of the map', 'ending_outside'),
    ):
        if of[key]['beams']:
            rows.append((name, f'{_shown(of[key])} ({of[key]["beams"]})'))
    if of['meaning_of_no_return']['why']:
        rows.append(('beams without a return', of['meaning_of_no_return']['why']))
    if of['left_out']:
        rows.append(('left out, ending outside', str(of['left_out'])))
    if 'samples' in of:
        mixed = of['samples']
        rows += [
            (f'mixture of {mixed["maps"]} maps', _shown(mixed)),
            ('  above the map', _shown(mixed['above_map'])),
        ]
    if of['dropped']:
        dropped = ', '.join(f'{count} {reason}' for reason, count in of['dropped'].items())
        rows.append(('scans dropped', dropped))
    return rows


def _shown(figure: dict[str, Any]) -> str:
    value, error = figure['nats_per_beam'], figure['standard_error']
    if not np.isfinite(value):
        return 'none'
    return f'{value:.4f}' + (f' +- {error:.4f}' if np.isfinite(error) else '')


def _pictures(grid_map: GridMap, beams: HeldOutBeams, values: Float64Array) -> list[Picture]:
    per_scan = beams.per_scan(values)
    ordered = np.sort(values)
    usual = float(np.median(values))
    surprise = usual - beams.per_cell(values, grid_map.spec)
    shares = (np.arange(ordered.size) + 1.0) / ordered.size
    return [
        Picture(probability_png(grid_map.probability), 'The map'),
        Picture(
            heat_png(np.maximum(surprise, 0.0), SURPRISE),
            f'Where beams ended that the map did not expect: white as usual ({usual:.2f} nats) or '
            f'better, black {SURPRISE:g} nats below or more; grey: none ended there',
        ),
        Picture(
            curves_png(
                [Series('', np.arange(per_scan.size), per_scan, '.')],
                'scan',
                'nats a beam',
            ),
            'Mean log-likelihood of the beams of each scan, in order: where it falls, the map is '
            'wrong or the pose is',
        ),
        Picture(
            curves_png(
                [Series('', ordered, shares)], 'log-likelihood, nats', 'share of beams below'
            ),
            'Log-likelihoods of single beams: what lies far left the map did not expect',
        ),
    ]

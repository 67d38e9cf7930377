"""`evaluate --path FILE --samples FILE`: how likely a way is blocked."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from ogm_mcmc.arrays import Float64Array
from ogm_mcmc.cli.evaluate_answer import Answer
from ogm_mcmc.config import CollisionConfig, flatten
from ogm_mcmc.engine.collision import BEHIND, chance_of_unknown, collision_risk
from ogm_mcmc.evaluation import probability_at
from ogm_mcmc.files.input_files import text_of
from ogm_mcmc.geometry import GridMap, SampleBits
from ogm_mcmc.io.point_files import read_points
from ogm_mcmc.io.sample_files import load_samples
from ogm_mcmc.io.trajectory_files import read_trajectory
from ogm_mcmc.plotting import Picture, Series, curves_png

__all__ = ['along_path', 'read_way']


def read_way(path: Path) -> Float64Array:
    """Read places (N, 2), m: lines `x,y` or `x,y,yaw`, or a trajectory as TUM or EuRoC.

    Raises PointsError or PoseError with the line at fault.
    """
    try:
        lines = text_of(path).splitlines()
    except (OSError, ValueError):
        lines = []  # the reader says what is wrong
    if max(map(_columns, lines), default=0) <= 3:
        return read_points(path)
    poses = read_trajectory(path).poses
    return np.array([(pose.x_m, pose.y_m) for pose in poses])


def _columns(line: str) -> int:
    said = line.partition('#')[0]
    return len(said.split(';') if ';' in said else said.replace(',', ' ').split())


def along_path(
    options: argparse.Namespace, config: CollisionConfig, unknown: float, *, told: bool
) -> Answer:
    """Say how likely a disc meets something at each place of a way, and on the whole way.

    As `refine_server` does: cells that data did not move count as unknown, with a chance by the
    prior that the file of samples names, or `unknown` where it names none, and by what is known;
    with `unknown` itself where the user `told` it.
    """
    places = read_way(options.path)
    samples = load_samples(options.samples, options.max_cells)
    bits = SampleBits.of_maps(samples.spec, samples.maps, samples.known)
    if told:
        behind = unknown
    else:
        prior = unknown if samples.prior is None else samples.prior
        unknown, behind = chance_of_unknown(bits, prior), BEHIND
    risk = collision_risk(bits, places, config.robot_radius, unknown, behind)
    shown = GridMap(samples.spec, samples.known.astype(np.float32))
    unseen = int(np.count_nonzero(probability_at(shown, places, 0.0) == 0.0))
    figures = {
        'file': str(options.path),
        'samples': {'file': str(options.samples), 'maps': bits.draws},
        'places': len(places),
        'unknown_places': unseen,
        'risk': risk[:-1].tolist(),
        'whole_way': float(risk[-1]),
    }
    worst = int(np.argmax(risk[:-1]))
    rows = [
        ('way', f'{options.path}: {len(places)} places, {bits.draws} maps'),
        ('collision on the whole way', f'{risk[-1]:.3f}'),
        (
            '  at its worst place',
            f'{risk[worst]:.3f} ({places[worst, 0]:g}, {places[worst, 1]:g})',
        ),
    ]
    if unseen:
        # A way in another frame than the maps looks like this, too.
        of = f'{unseen} of {len(places)}'
        rows.insert(1, ('  places in unknown space', of))
    picture = Picture(
        curves_png([Series('', np.arange(len(places)), risk[:-1], '.')], 'place', 'risk'),
        f'Probability of a collision at each place, for a radius of {config.robot_radius:g} m',
    )
    settings = {**flatten(config), 'unknown': unknown}
    return Answer(figures, rows, [('Way', [picture])], settings)

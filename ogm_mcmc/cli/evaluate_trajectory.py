"""`evaluate --estimate FILE`: poses before true ones, or known relations between them."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ogm_mcmc.arrays import Float64Array, Int64Array
from ogm_mcmc.cli.evaluate_answer import Answer
from ogm_mcmc.errors import ConfigError, PoseError
from ogm_mcmc.evaluation.trajectories import (
    PoseErrors,
    absolute_errors,
    aligned_trajectory,
    coverage,
    matched_stamps,
    relation_errors,
    relations_at,
    relative_errors,
)
from ogm_mcmc.io.relation_files import read_relations
from ogm_mcmc.io.trajectory_files import Trajectory, read_trajectory
from ogm_mcmc.io.tum_files import read_deviations
from ogm_mcmc.plotting import Picture, Series, curves_png

__all__ = ['add_trajectory_judges', 'asks_for_poses', 'by_trajectory', 'check_trajectory_options']

AXES = ('x', 'y', 'yaw')


def add_trajectory_judges(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    group = parser.add_argument_group('judges of poses')
    group.add_argument(
        '--estimate', type=Path, metavar='FILE',
        help='poses to be judged, as TUM or EuRoC; default: NAME_trajectory.txt '
        'beside MAP. Standard deviations are read from NAME_deviations.csv beside it',
    )  # fmt: skip
    group.add_argument(
        '--true-trajectory', type=Path, metavar='FILE',
        help='true poses, likewise: absolute and relative errors after rigid alignment as evo '
        'has them, and how many of the 95 %% intervals hold the truth',
    )  # fmt: skip
    group.add_argument(
        '--relations', type=Path, metavar='FILE',
        help='known moves between poses, lines of stamp, stamp, x, y, z, roll, pitch, yaw '
        '(Kuemmerle et al. 2009)',
    )  # fmt: skip
    group.add_argument(
        '--stamp-tolerance', type=float, default=0.01, metavar='S',
        help='poses and stamps further apart are not the same (default: 0.01 s); nothing is '
        'interpolated',
    )  # fmt: skip


def asks_for_poses(options: argparse.Namespace) -> bool:
    """Whether poses are to be judged."""
    return options.true_trajectory is not None or options.relations is not None


def check_trajectory_options(options: argparse.Namespace) -> None:
    """Find the estimate; refuse options that do not belong together."""
    tolerance = options.stamp_tolerance
    if not 0.0 <= tolerance < math.inf:
        raise ConfigError(f'--stamp-tolerance is {tolerance}: expected 0 or more')
    if not asks_for_poses(options):
        if options.estimate is not None:
            raise ConfigError(
                f'--estimate {options.estimate}: expected --true-trajectory FILE or '
                '--relations FILE to judge it by'
            )
        return
    if options.estimate is None:
        if options.map is None:
            raise ConfigError('expected --estimate FILE, the poses to be judged')
        options.estimate = options.map.with_name(f'{options.map.stem}_trajectory.txt')


class _Estimate(NamedTuple):
    """Poses (K, 3) at stamps (K,), their deviations (K, 3) where known, and their file."""

    path: Path
    stamps_ns: Int64Array
    poses: Float64Array
    deviations: Float64Array | None


def by_trajectory(options: argparse.Namespace) -> Answer:
    """Judge poses by true ones and by relations, whichever are named."""
    read = read_trajectory(options.estimate)
    deviations = read_deviations(options.estimate, read.stamps_ns)
    estimate = _Estimate(options.estimate, read.stamps_ns, _rows_of(read), deviations)
    figures: dict[str, Any] = {'estimate': str(estimate.path), 'poses': len(estimate.poses)}
    rows = [('poses', f'{estimate.path}: {len(estimate.poses)}')]
    pictures: list[Picture] = []
    if options.true_trajectory is not None:
        found, pictures = _by_truth(estimate, options.true_trajectory, options.stamp_tolerance)
        figures['truth'] = found
        rows += _truth_rows(found)
    if options.relations is not None:
        figures['relations'] = found = _by_relations(
            estimate, options.relations, options.stamp_tolerance
        )
        rows.append((f'error of {found["count"]} relations', _shown(found)))
    settings = {'stamp_tolerance': options.stamp_tolerance}
    return Answer(figures, rows, [('Poses', pictures)] if pictures else [], settings)


def _rows_of(trajectory: Trajectory) -> Float64Array:
    return np.array([(pose.x_m, pose.y_m, pose.yaw_rad) for pose in trajectory.poses])


def _by_truth(
    estimate: _Estimate, path: Path, tolerance_s: float
) -> tuple[dict[str, Any], list[Picture]]:
    read = read_trajectory(path)
    mine, theirs = matched_stamps(estimate.stamps_ns, read.stamps_ns, tolerance_s)
    if mine.size < 2:
        raise PoseError(
            f'{path}: {mine.size} of {len(estimate.poses)} poses have a true one within '
            f'{tolerance_s:g} s: expected at least 2'
        )
    poses, truth = estimate.poses[mine], _rows_of(read)[theirs]
    absolute, relative = absolute_errors(poses, truth), relative_errors(poses, truth)
    figures: dict[str, Any] = {
        'file': str(path),
        'matched': int(mine.size),
        'absolute': absolute.summary(),
        'relative': relative.summary(),
    }
    if estimate.deviations is not None:
        spread = estimate.deviations[mine]
        figures['coverage'] = _covered(truth - poses, spread)
        # The truth is moved, so that deviations stay along the axes they are of.
        figures['coverage_aligned'] = _covered(aligned_trajectory(truth, poses) - poses, spread)
    stamps_s = (estimate.stamps_ns[mine] - estimate.stamps_ns[mine[0]]) / 1e9
    return figures, _pictures(stamps_s, aligned_trajectory(poses, truth), truth, absolute)


def _covered(off: Float64Array, spread: Float64Array) -> dict[str, float]:
    off = off.copy()
    off[:, 2] = (off[:, 2] + np.pi) % (2.0 * np.pi) - np.pi
    return dict(zip(AXES, map(float, coverage(off, spread)), strict=True))


def _by_relations(estimate: _Estimate, path: Path, tolerance_s: float) -> dict[str, Any]:
    relations = relations_at(read_relations(path), estimate.stamps_ns / 1e9, tolerance_s)
    if relations.first.size == 0:
        raise PoseError(
            f'{path}: no relation has a pose of {estimate.path} within {tolerance_s:g} s of both '
            'its stamps: expected some'
        )
    summary = relation_errors(estimate.poses, relations).summary()
    return {'file': str(path), 'count': int(relations.first.size), **summary}


def _truth_rows(of: dict[str, Any]) -> list[tuple[str, str]]:
    rows = [
        ('  with a true one', str(of['matched'])),
        ('absolute error, aligned', _shown(of['absolute'])),
        ('relative error, next pose', _shown(of['relative'])),
    ]
    for name, key in (
        ('95 % intervals hold the truth', 'coverage'),
        ('  after alignment', 'coverage_aligned'),
    ):
        if key in of:
            rows.append((name, ', '.join(f'{axis} {of[key][axis]:.3f}' for axis in AXES)))
    return rows


def _shown(of: dict[str, float]) -> str:
    return (
        f'mean {of["mean_m"]:.4f} m, rmse {of["rmse_m"]:.4f} m, max {of["max_m"]:.4f} m; '
        f'mean {of["mean_deg"]:.3f} degrees, rmse {of["rmse_deg"]:.3f}'
    )


def _pictures(
    stamps_s: Float64Array, poses: Float64Array, truth: Float64Array, errors: PoseErrors
) -> list[Picture]:
    ways = [
        Series('true', truth[:, 0], truth[:, 1]),
        Series('estimated, aligned', poses[:, 0], poses[:, 1], '--'),
    ]
    distance = Series('', stamps_s, 100.0 * errors.distance_m, '.')
    return [
        Picture(curves_png(ways, 'x, m', 'y, m'), 'Where the robot went'),
        Picture(curves_png([distance], 'time, s', 'cm'), 'Absolute error, aligned'),
    ]

"""Poses and map of MIT CSAIL together, from the particles that a SLAM system believed in.

The scans and particles are those of `pose-particles`. Every method maps half the beams of all
scans, and only these move a pose. The others judge, each method at its own poses: that asks
whether map and poses agree, and needs no benchmark made by one of the contestants. Points along
the held-out beams give ROC curves of that kind: free on the way, occupied at the end. ROC curves
against the map of the final trajectory of the SLAM system stand beside it: they punish whatever
is put elsewhere than that trajectory has it, right or wrong; as it is, and moved rigidly to where
each method has the scans.

Two beams are taken, the next two held out. The lidar gives whole degrees in one turn of its mirror
and half degrees in the next, so where the robot turns even and odd beams come from two headings:
the heading in which odd beams fit best the map of poses from even ones is off by 0.55 degrees
(standard deviation; even ones 0.12), and correlates with how the robot turns by 0.86. Odd beams
are no judge of poses from even ones; of pairs both halves have both turns.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ogm_mcmc.arrays import Float64Array
from ogm_mcmc.config import ForwardModelConfig, MapperConfig, TrajectoryConfig
from ogm_mcmc.engine.live_map import map_of
from ogm_mcmc.evaluation import (
    ForwardModel,
    ThresholdCounts,
    aligned,
    beam_log_likelihood,
    confusion_counts,
    held_out_beams,
    held_out_points,
    probability_at,
)
from ogm_mcmc.evaluation.trajectories import absolute_errors, aligned_trajectory
from ogm_mcmc.geometry import GridMap, PlacedScan, PoseBelief, Scan
from ogm_mcmc.lab.experiments.pose_particles import LOG, Believed, read_log
from ogm_mcmc.lab.experiments.recordings import data_folder
from ogm_mcmc.lab.experiments.results import row, save_picture
from ogm_mcmc.mapping import PoseUncertainMapper
from ogm_mcmc.plotting import Series, curves_png
from ogm_mcmc.trajectory import TrajectoryRefinement
from ogm_mcmc.trajectory.points import poses_of, xyyaw

__all__ = ['run']

JUDGE = ForwardModelConfig(sigma=0.05)
LIKELIEST, MEAN, ALL = 'likeliest particle', 'mean pose', 'all particles (pose_uncertain)'
WEIGHTED = 'all particles, weighed by the map so far'
FINAL, JOINT = 'final trajectory', 'joint'
SPREAD = 'joint, spread over what poses leave open'

POINT_STEP_M = 0.5

# Of a scan's beams that are mapped as many count as independent.
MAP_BEAMS = 5.0

NOTES = [
    'All particles: the map of pose_uncertain, held-out beams from the mean pose.',
    f'Weighed by the map so far: `map_beams` {MAP_BEAMS:g}, held-out beams from the mean of the '
    'weighed particles.',
    'Spread over what poses leave open: the map of pose_uncertain at joint poses, with the '
    'covariances they have in the end.',
    'The final trajectory is what the SLAM system (GMapping) came to after all loops.',
    'Log recorded at MIT CSAIL by Cyrill Stachniss (Radish, CC-BY).',
]


class Mapped(NamedTuple):
    """A map, and the poses (K, 3) from which the beams that it has not seen are cast."""

    grid_map: GridMap
    poses: Float64Array


def run(folder: Path, *, quick: bool, seed: int) -> dict[str, Any]:
    """Refine the whole log; quick: its first hundred scans."""
    believed = read_log(data_folder(LOG, f'OGM_MCMC_DATA to name a folder with {LOG}') / LOG)
    if quick:
        believed = believed[:100]
    settings = TrajectoryConfig(seed=seed)
    refinement = refined(believed, settings)
    maps = maps_of(believed, refinement.beliefs())
    rows = []
    for name, one in maps.items():
        rows.append(row(f'{name}: nats a held-out beam', nats_of(believed, one)))
    for name, one in maps.items():
        area = area_of_points(believed, one)
        rows.append(row(f'{name}: ROC area, points of held-out beams', area))
    found, curves = by_benchmark(believed, maps)
    save_picture(
        folder / 'roc.png',
        curves_png(curves, 'false positive rate', 'true positive rate', x_limits=(0.0, 0.3)),
    )
    final = maps[FINAL].poses
    for name in (LIKELIEST, MEAN, WEIGHTED, JOINT):
        errors = absolute_errors(maps[name].poses, final).summary()
        remark = f'{errors["mean_deg"]:.3f} degrees, after rigid alignment'
        rows.append(row(f'{name}: from the final trajectory, m', errors['mean_m'], None, remark))
    return {
        'rows': [*rows, *found],
        'pictures': {'roc.png': 'ROC curves against the map of the final trajectory'},
        'settings': {**asdict(settings), 'scans': len(believed), 'resolution_m': 0.05},
        'notes': NOTES,
    }


def refined(believed: Sequence[Believed], settings: TrajectoryConfig) -> TrajectoryRefinement:
    """Return the poses that the mapped half of the beams leads to."""
    placed = [(every_other_pair(one.placed.scan, 0), one.placed.belief) for one in believed]
    refinement = TrajectoryRefinement(placed, settings)  # scans have no stamps here
    for _ in refinement.run():
        pass
    return refinement


def every_other_pair(scan: Scan, first: int) -> Scan:
    """Return the scan with only pairs of beams first, first + 2, ... that say anything."""
    kept = np.arange(scan.ranges_m.size) // 2 % 2 == first % 2
    return replace(scan, ranges_m=np.where(kept, scan.ranges_m, np.nan))


def maps_of(believed: Sequence[Believed], joint: Sequence[PoseBelief]) -> dict[str, Mapped]:
    """Map half of the beams with every method; `joint` is what has become of the poses."""
    plain = MapperConfig(resolution=0.05, no_return='ignore')
    averaging = replace(plain, method='pose_uncertain')
    scans = [every_other_pair(one.placed.scan, 0) for one in believed]
    poses = {
        LIKELIEST: xyyaw([one.likeliest for one in believed]),
        MEAN: xyyaw([one.placed.pose for one in believed]),
        JOINT: xyyaw([belief.mean for belief in joint]),
        FINAL: xyyaw([one.known for one in believed]),
    }
    maps = {
        name: Mapped(map_of(map(PlacedScan.at, scans, poses_of(found)), plain), found)
        for name, found in poses.items()
    }
    particles = [one.placed.belief for one in believed]
    maps[ALL] = Mapped(map_of(map(PlacedScan, scans, particles), averaging), poses[MEAN])
    maps[SPREAD] = Mapped(map_of(map(PlacedScan, scans, joint), averaging), poses[JOINT])
    chosen = replace(averaging.pose_uncertain, map_beams=MAP_BEAMS)
    maps[WEIGHTED] = weighted(believed, replace(averaging, pose_uncertain=chosen))
    return maps


def weighted(believed: Sequence[Believed], config: MapperConfig) -> Mapped:
    """Map half of the beams; poses are the means of what each scan was mapped at."""
    mapper, means = PoseUncertainMapper(config), []
    for one in believed:
        mapper.update(PlacedScan(every_other_pair(one.placed.scan, 0), one.placed.belief))
        assert mapper.samples is not None
        means.append(mapper.samples.mean())
    whole = GridMap(mapper.spec, mapper.probabilities(mapper.spec.box))
    return Mapped(whole.cropped(), xyyaw(means))


def nats_of(believed: Sequence[Believed], mapped: Mapped) -> float:
    """Return the mean log-likelihood of a held-out beam."""
    placed = held_out(believed, mapped)
    model, prior = ForwardModel.from_config(JUDGE), MapperConfig().prior
    beams = beam_log_likelihood(mapped.grid_map, placed, model, prior=prior, no_return='ignore')
    return float(beams.mean())


def area_of_points(believed: Sequence[Believed], mapped: Mapped) -> float:
    """Return the ROC area of points of held-out beams: free on the way, occupied at the end."""
    placed = held_out(believed, mapped)
    beams = held_out_beams(placed, mapped.grid_map.spec, no_return='ignore')
    points = held_out_points(beams, POINT_STEP_M)
    found = probability_at(mapped.grid_map, points.xy_m, MapperConfig().prior)
    return confusion_counts(found, points.occupied).roc_area()


def held_out(believed: Sequence[Believed], mapped: Mapped) -> list[PlacedScan]:
    """Return the beams that no map has seen, where a method has their scans."""
    scans = [every_other_pair(one.placed.scan, 1) for one in believed]
    return list(map(PlacedScan.at, scans, poses_of(mapped.poses)))


def by_benchmark(
    believed: Sequence[Believed], maps: dict[str, Mapped]
) -> tuple[list[dict[str, Any]], list[Series]]:
    """Compare with the map that all beams make at the final trajectory, as it is and moved.

    The curves are those of the map that was moved.
    """
    final = maps[FINAL].poses
    as_it_is = benchmark_at(believed, final)
    rows, curves = [], []
    for name, mapped in maps.items():
        if name == FINAL:
            continue
        moved = benchmark_at(believed, aligned_trajectory(final, mapped.poses))
        for where, benchmark in (('', as_it_is), (', moved', moved)):
            counts = compared(mapped.grid_map, benchmark)
            rows += [
                row(f'{name}: ROC area{where}', counts.roc_area()),
                row(f'{name}: best F1{where}', counts.best().f1),
            ]
        curves.append(Series(name, counts.false_positive_rate(), counts.recall()))
    return rows, curves


def benchmark_at(believed: Sequence[Believed], poses: Float64Array) -> GridMap:
    """Return the traditional map of all beams at poses (K, 3)."""
    placed = map(PlacedScan.at, [one.placed.scan for one in believed], poses_of(poses))
    return map_of(placed, MapperConfig(resolution=0.05, no_return='ignore')).cropped()


def compared(found: GridMap, benchmark: GridMap) -> ThresholdCounts:
    """Judge a map by the cells that the benchmark knows; unknown ones are at 0.5."""
    counted = np.isfinite(benchmark.probability)
    probability = np.nan_to_num(aligned(found.cropped(), benchmark)[counted], nan=0.5)
    return confusion_counts(probability, benchmark.probability[counted] >= 0.5)

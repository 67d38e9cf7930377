"""Poses and map of the Intel Research Lab estimated together, judged by what neither has seen.

Maps come from the even beams of every scan, poses were moved by even beams only, and the odd beams
judge both at the same poses. Relations between poses that people checked by hand (Kuemmerle et al.
2009) judge the poses alone: those with a scan at both ends, within a millisecond, and those whose
stamps are exactly those of scans. The log's own stamps were rounded, so those of the robot's
middleware, by which relations name scans, come from a table beside it.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ogm_mcmc.arrays import AnyArray, Float64Array, Int64Array
from ogm_mcmc.config import (
    ChainConfig,
    ForwardModelConfig,
    MapperConfig,
    PatchConfig,
    SamplerConfig,
    StopConfig,
    TrajectoryConfig,
    WindowConfig,
)
from ogm_mcmc.engine.beam_times import BentScans
from ogm_mcmc.engine.live_map import map_of
from ogm_mcmc.engine.refinement import Refinement
from ogm_mcmc.evaluation import ForwardModel, beam_log_likelihood
from ogm_mcmc.evaluation.trajectories import Relations, relation_errors, relations_at
from ogm_mcmc.geometry import GridMap, PlacedScan, PoseBelief, Scan
from ogm_mcmc.io.carmen import read_carmen
from ogm_mcmc.io.relation_files import read_relations
from ogm_mcmc.lab.experiments.leaderboard import UNKNOWN
from ogm_mcmc.lab.experiments.recordings import as_scan, data_folder
from ogm_mcmc.lab.experiments.results import row
from ogm_mcmc.trajectory import TrajectoryRefinement
from ogm_mcmc.trajectory.points import poses_of, xyyaw

__all__ = ['run']

FOLDER = Path('intel')
LOG, RELATIONS = 'intel.gfs.log', 'intel.relations'
STAMPS, ROUGH = 'intel_raw_odometry_910.csv', 'occupancy_slam_start.txt'
FILES = (LOG, RELATIONS, STAMPS, ROUGH)
EXPECTED = 'OGM_MCMC_DATA to name a folder with intel/ (log, relations, stamps and rough start)'
JUDGE = ForwardModelConfig(sigma=0.05)
# Stamps are of a millionth of a second.
SAME_STAMP_S = 1e-5
ONE_DEGREE = math.radians(1.0)

# What Occupancy-SLAM (Zhao et al. 2022), its counter mended, comes to: held-out nats of the
# traditional and the border map (from the given poses), error of 97 relations, m.
PEER_NATS = {'given': (1.194, 1.242)}
PEER_RELATIONS = {'given': 0.017, 'noise': 0.019, 'drift': 0.019, 'rough': 0.018}

NOTES = [
    'Published: Occupancy-SLAM (RSS 2022) as measured with the same judge.',
    'noise: 5 cm and 1 degree, independent; drift: waves of 0.3 m and 3 degrees; rough: the start '
    'published with Occupancy-SLAM, half a metre and six degrees off.',
    'Where the lattice of cells lies moves a traditional map by 0.01 nats either way.',
]


class Recorded(NamedTuple):
    """The scans, where the log puts them, the order of their stamps, and what is known.

    exact    those relations that hold at the very stamps of scans
    times_s  when scans were taken
    """

    scans: list[Scan]
    given: Float64Array
    order: Int64Array
    relations: Relations
    rough: Float64Array
    exact: Relations
    times_s: Float64Array


def run(folder: Path, *, quick: bool, seed: int) -> dict[str, Any]:
    """Refine from every start; quick: from the given poses only, with shorter chains."""
    recorded = read_recorded(intel_folder())
    rows = judged('given, as it is', recorded, recorded.given, quick=quick, seed=seed)
    config = TrajectoryConfig(seed=seed)
    for name, start, spread in starts_of(recorded, seed)[: 1 if quick else None]:
        began = time.process_time()
        found = refined(recorded, start, spread, replace(config, search=name == 'rough'))
        seconds = time.process_time() - began
        if name != 'given':
            rows += relations_rows(f'{name}, start', recorded, start)
        nats, error = PEER_NATS.get(name), PEER_RELATIONS[name]
        bent = BentScans().bent(recorded.scans, found.speeds, found.beam_times.seconds)
        moved = recorded._replace(scans=bent)
        rows += judged(f'{name}, refined', moved, found.poses, nats, error, quick=quick, seed=seed)
        sweep_s = float(found.beam_times.seconds[1])
        rows.append(row(f'{name}: from the first beam to the last, s', sweep_s))
        rows.append(row(f'{name}: time, s', seconds, None, 'of processors, draws included'))
    settings = {**asdict(config), 'scans': len(recorded.scans), 'seed': seed}
    return {'rows': rows, 'settings': settings, 'notes': NOTES}


def intel_folder() -> Path:
    """Return the folder of the log and what lies beside it; ConfigError where one is missing."""
    for name in FILES:
        data = data_folder(FOLDER / name, EXPECTED)
    return data / FOLDER


def read_stamps(folder: Path) -> Float64Array:
    """Read the table of stamps and odometry, (K, 8), in the order of time.

    Stamp of the robot's middleware and of the log, s; odometry and corrected pose, m, m, rad.
    """
    return np.loadtxt(folder / STAMPS, delimiter=',', comments='#')


def read_recorded(folder: Path) -> Recorded:
    """Read the log and what lies beside it."""
    logged = read_carmen(folder / LOG).scans
    order = np.argsort([scan.time_s for scan in logged], kind='stable')
    stamps = np.empty(len(logged))
    stamps[order] = read_stamps(folder)[:, 0]
    known = read_relations(folder / RELATIONS)
    return Recorded(
        [as_scan(scan) for scan in logged],
        xyyaw([scan.laser_pose for scan in logged]),
        order.astype(np.int64),
        relations_at(known, stamps),
        np.loadtxt(folder / ROUGH),
        relations_at(known, stamps, SAME_STAMP_S),
        stamps - stamps.min(),
    )


def starts_of(
    recorded: Recorded, seed: int
) -> list[tuple[str, Float64Array, Sequence[float] | None]]:
    """Return name, poses (K, 3) and their standard deviations (m, m, rad) of every start.

    Of the given poses none are known.
    """
    given = recorded.given
    noise = np.random.default_rng(seed).normal(size=given.shape)
    share = np.empty(len(given))
    share[recorded.order] = np.linspace(0.0, 2.0 * np.pi, len(given))
    drift = np.stack(
        (0.3 * np.sin(share), 0.3 * np.sin(1.5 * share), 3.0 * ONE_DEGREE * np.sin(0.7 * share)),
        axis=1,
    )
    return [
        ('given', given, None),
        ('noise', given + noise * (0.05, 0.05, ONE_DEGREE), (0.05, 0.05, ONE_DEGREE)),
        ('drift', given + drift, (0.3, 0.3, 0.1)),
        ('rough', recorded.rough, (0.5, 0.5, 0.1)),
    ]


def refined(
    recorded: Recorded,
    start: Float64Array,
    spread: Sequence[float] | None,
    config: TrajectoryConfig,
) -> TrajectoryRefinement:
    """Return the poses (K, 3) that the even beams lead to, and when beams were taken."""
    covariance = None if spread is None else np.diag(np.square(np.asarray(spread)))
    placed = [
        (every_other(scan, 0), PoseBelief(pose, covariance))
        for scan, pose in zip(recorded.scans, poses_of(start), strict=True)
    ]
    refinement = TrajectoryRefinement(
        placed, config, order=recorded.order, times_s=recorded.times_s
    )
    for _ in refinement.run():
        pass
    return refinement


def every_other(scan: Scan, first: int) -> Scan:
    """Return the scan with only the beams first, first + 2, ... that say anything."""
    ranges = np.full_like(scan.ranges_m, np.nan)
    ranges[first::2] = scan.ranges_m[first::2]
    return replace(scan, ranges_m=ranges)


def judged(
    name: str,
    recorded: Recorded,
    poses: AnyArray,
    nats: tuple[float, float] | None = None,
    error_m: float | None = None,
    *,
    quick: bool,
    seed: int,
) -> list[dict[str, Any]]:
    """Return the rows of some poses; `nats` and `error_m` are those of the peer."""
    placed = poses_of(poses)
    mapped = [
        PlacedScan.at(every_other(scan, 0), pose)
        for scan, pose in zip(recorded.scans, placed, strict=True)
    ]
    held_out = [
        PlacedScan.at(every_other(scan, 1), pose)
        for scan, pose in zip(recorded.scans, placed, strict=True)
    ]
    model = ForwardModel.from_config(JUDGE)
    rows = []
    maps = {
        'traditional': traditional(mapped),
        'border': border(mapped, 60 if quick else 100, seed),
    }
    for k, (kind, grid_map) in enumerate(maps.items()):
        beams = beam_log_likelihood(grid_map, held_out, model, prior=UNKNOWN, no_return='ignore')
        peer = None if nats is None else nats[k]
        rows.append(row(f'{name}: {kind}, nats a held-out beam', float(beams.mean()), peer))
    return [*rows, *relations_rows(name, recorded, poses, error_m)]


def relations_rows(
    name: str, recorded: Recorded, poses: Float64Array, peer: float | None = None
) -> list[dict[str, Any]]:
    """Return the rows of the relations, of all and of the exact ones."""
    rows = []
    chosen = (('relations', recorded.relations, peer), ('exact relations', recorded.exact, None))
    for which, relations, published in chosen:
        errors = relation_errors(poses, relations).summary()
        remark = f'{errors["mean_deg"]:.3f} degrees, {relations.first.size} {which}'
        rows.append(row(f'{name}: error of {which}, m', errors['mean_m'], published, remark))
    return rows


def traditional(mapped: Sequence[PlacedScan]) -> GridMap:
    """Return the live map."""
    return map_of(mapped, MapperConfig(resolution=0.05, no_return='ignore'))


def border(mapped: Sequence[PlacedScan], sweeps: int, seed: int) -> GridMap:
    """Return the mean of maps drawn with the border prior."""
    config = SamplerConfig(
        model=JUDGE,
        window=WindowConfig(no_return='ignore'),
        patch=PatchConfig(prior='border', size=9),
        chain=ChainConfig(chains=2, start='live', burn_in=30, seed=seed),
    )
    refinement = Refinement(config)
    refinement.take(mapped)
    for _ in refinement.run(StopConfig(max_sweeps=sweeps, max_time=1e6, r_hat=0.0)):
        pass
    return refinement.map()

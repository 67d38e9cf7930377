"""The fixed scene: 100 scans of 180 beams in a cluttered square, 0.1 m cells, range 7.5 m."""

from __future__ import annotations

import math
import zipfile
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ogm_mcmc.arrays import Float64Array
from ogm_mcmc.errors import BagError
from ogm_mcmc.geometry import PlacedScan, Pose2D, PoseBelief, Scan
from ogm_mcmc.simulation import true_ranges

__all__ = ['Scene', 'generated_scene', 'load_scene']

SCANS, BEAMS, SIDE_M, RANGE_M, SIGMA_M, RESOLUTION_M = 100, 180, 50.0, 7.5, 0.2, 0.1

# So many that the beams cross about as many cells as in the recorded scene (629 004).
WALLS = 750


class Scene(NamedTuple):
    """Placed scans and the resolution to map them at, m."""

    placed: list[PlacedScan]
    resolution_m: float
    source: str


def load_scene(path: Path) -> Scene:
    """Read the NPZ: `poses` (N, 3) in cells and rad, `ang` (B,), `z` (N, B) cells, `res`, `F`.

    A range of F cells means that nothing was hit. Raises BagError when it is not such a file.
    """
    try:
        # Opened here: numpy leaves a file open that it cannot read.
        with path.open('rb') as stream, np.load(stream) as data:
            resolution, limit = float(data['res']), float(data['F'])
            poses, angles, cells = data['poses'], data['ang'], data['z']
    except (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile) as error:
        reason = ' '.join(str(error).split())
        raise BagError(
            f'{path}: expected an NPZ with poses, ang, z, res and F ({reason})'
        ) from error
    ranges = np.where(cells >= limit, np.inf, cells * resolution)
    return Scene(
        [
            _placed(
                ranges[k], poses[k] * (resolution, resolution, 1.0), angles, limit * resolution
            )
            for k in range(len(poses))
        ],
        resolution,
        path.name,
    )


def generated_scene(seed: int = 20) -> Scene:
    """Return an equivalent of the scene: random walls in a square of 50 m, noisy exact ranges.

    Scans are taken at free places with a mean range like that of the recorded scene.
    """
    rng = np.random.default_rng(seed)
    centres = rng.uniform(0.0, SIDE_M, (WALLS, 2))
    angle = rng.choice((0.0, math.pi / 2.0), WALLS) + rng.normal(0.0, 0.1, WALLS)
    half = 0.5 * rng.uniform(0.5, 4.0, WALLS)
    step = np.stack((np.cos(angle), np.sin(angle)), axis=1) * half[:, None]
    outside = np.array([(0, 0, SIDE_M, 0), (SIDE_M, 0, SIDE_M, SIDE_M)], np.float64)
    walls = np.concatenate(
        (np.hstack((centres - step, centres + step)), outside, SIDE_M - outside)
    )
    angles: Float64Array = np.arange(BEAMS, dtype=np.float64) * (2.0 * math.pi / BEAMS) - math.pi
    placed: list[PlacedScan] = []
    while len(placed) < SCANS:
        x, y = rng.uniform(1.0, SIDE_M - 1.0, 2)
        pose = np.array([x, y, rng.uniform(-math.pi, math.pi)])
        exact = true_ranges(walls, Pose2D(*map(float, pose)), angles)
        if exact.min() < 0.3:
            continue
        noisy = exact + rng.normal(0.0, SIGMA_M, BEAMS)
        noisy[noisy >= RANGE_M] = np.inf
        placed.append(_placed(noisy, pose, angles, RANGE_M))
    return Scene(placed, RESOLUTION_M, f'generated, seed {seed}')


def _placed(
    ranges: Float64Array, pose: Float64Array, angles: Float64Array, range_max_m: float
) -> PlacedScan:
    scan = Scan.checked(
        ranges,
        angle_min_rad=float(angles[0]),
        angle_increment_rad=float(angles[1] - angles[0]),
        range_min_m=0.0,
        range_max_m=range_max_m,
    )
    return PlacedScan(scan, PoseBelief(Pose2D(*map(float, pose))))

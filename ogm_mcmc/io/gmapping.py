"""What a full GMapping log knows in the end: the trajectory of its best particle."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ogm_mcmc.errors import LogError
from ogm_mcmc.geometry import Pose2D
from ogm_mcmc.io.carmen import LogScan

__all__ = ['best_trajectory']


def best_trajectory(scans: Sequence[LogScan]) -> list[Pose2D]:
    """Return the laser's pose at each scan along the ancestry of the best last particle.

    Log-weights start anew at every resampling, so those of a line of descent add up; GMapping
    itself names the particle with the greatest sum the best. What a filter believed at the time
    is in `LogScan.particles`; this is what it believed at the end, loops closed.
    Raises LogError for a log without particles, or whose lines of descent are damaged.
    """
    lines: list[np.ndarray] = []  # before each scan: the particle of the scan before
    total = np.zeros(0)
    for scan in scans:
        if scan.particles is None or scan.log_weights is None:
            raise LogError(f'line {scan.line}: a scan without SM_UPDATE: expected a full .gfs log')
        count = scan.log_weights.size
        if not lines:
            total = np.zeros(count)
        if count != total.size:
            raise LogError(f'line {scan.line}: {count} particles: expected {total.size}')
        parents = np.arange(count) if scan.parents is None else scan.parents
        if parents.size != count:
            raise LogError(
                f'line {scan.line}: the RESAMPLE after it is damaged: expected its parents'
            )
        if scan is scans[-1]:
            total = total + scan.log_weights
            break
        if scan.parents is not None:
            total = (total + scan.log_weights)[parents]
        lines.append(parents)
    best = int(np.argmax(total))
    poses = []
    for scan, parents in zip(reversed(scans), [None, *reversed(lines)], strict=True):
        if parents is not None:
            best = int(parents[best])
        assert scan.particles is not None
        poses.append(Pose2D(*map(float, scan.particles.poses[best])))
    return poses[::-1]

"""Which scans a saved state is of."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence

import numpy as np

from ogm_mcmc.geometry import PlacedScan

__all__ = ['fingerprint']


def fingerprint(scans: Sequence[PlacedScan]) -> str:
    """Return a digest of everything in the scans and poses that decides the posterior."""
    digest = hashlib.sha256()
    for scan, belief in scans:
        pose = belief.mean
        numbers = (
            scan.angle_min_rad,
            scan.angle_increment_rad,
            scan.range_min_m,
            scan.range_max_m,
            pose.x_m,
            pose.y_m,
            pose.yaw_rad,
        )
        digest.update(np.array(numbers, np.float64).tobytes())
        digest.update(scan.ranges_m.tobytes())
        if scan.bearings_rad is not None:
            digest.update(scan.bearings_rad.tobytes())
    return digest.hexdigest()

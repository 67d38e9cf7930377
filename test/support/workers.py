"""Settings, scans and waiting for tests of the worker."""

import time

import numpy as np

from ogm_mcmc.config import ChainConfig, SamplerConfig, StopConfig, WindowConfig
from ogm_mcmc.geometry import PlacedScan, Pose2D, PoseBelief, Scan

__all__ = ['CONFIG', 'ENDLESS', 'idle', 'scans', 'until']

CONFIG = SamplerConfig(
    window=WindowConfig(resolution=0.1), chain=ChainConfig(burn_in=5, start='free')
)
ENDLESS = StopConfig(max_sweeps=10**8, max_time=1e6, r_hat=0.0)


def scans(count, beams=24, start=0):
    """Scans of a round room of 1 m, from places along a line."""
    angles = 2.0 * np.pi * np.arange(beams) / beams
    result = []
    for i in range(start, start + count):
        x = 0.02 * i
        ranges = -x * np.cos(angles) + np.sqrt(1.0 - (x * np.sin(angles)) ** 2)
        scan = Scan.checked(
            ranges.astype(np.float32),
            angle_min_rad=0.0,
            angle_increment_rad=2.0 * np.pi / beams,
            range_min_m=0.0,
            range_max_m=3.0,
            stamp_ns=1_000_000_000 + i,
        )
        result.append(PlacedScan(scan, PoseBelief(Pose2D(x + 0.03, 0.04))))
    return result


def until(condition, timeout_s=20.0):
    deadline = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < deadline, 'not in time'
        time.sleep(0.002)


def idle(worker, stopped):
    return worker.status.state == 'idle' and worker.status.stopped == stopped

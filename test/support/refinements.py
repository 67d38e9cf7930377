"""Small scans, and refinements of them by few chains and large cells."""

import math

import numpy as np

from ogm_mcmc.config import (
    ChainConfig,
    ForwardModelConfig,
    SamplerConfig,
    StopConfig,
    WindowConfig,
)
from ogm_mcmc.engine.refinement import Refinement
from ogm_mcmc.geometry import GridMap, GridSpec, PlacedScan, Pose2D, PoseBelief
from support.strategies import fan

__all__ = [
    'FAR',
    'FIRST',
    'NOTHING',
    'S',
    'SECOND',
    'THIRD',
    'lattice_map',
    'maps',
    'run',
    'scan_at',
    'settings',
    'taken',
]


S = 1_000_000_000


def scan_at(x, y, *ranges, yaw=0.0, stamp_ns=0):
    """Return a placed scan of beams half a radian apart, the first one radian to the right."""
    scan = fan(*ranges, bearing=-1.0, increment=0.5, range_max_m=4.0, stamp_ns=stamp_ns)
    return PlacedScan(scan, PoseBelief(Pose2D(x, y, yaw)))


FIRST = scan_at(0.13, 0.22, 1.1, 1.6, 2.3, math.inf)


SECOND = scan_at(0.63, -0.42, 1.0, math.inf, 1.3, yaw=1.2)


THIRD = scan_at(-2.3, 1.4, 2.1, 2.2, 1.9, yaw=-2.0)


FAR = scan_at(40000.0, 40000.0, 1.0, 2.0)


NOTHING = scan_at(50.0, 50.0, math.nan, -1.0, 0.0)


def settings(window=None, model=None, **chain):
    """Return settings of large cells; changes are of the chain."""
    return SamplerConfig(
        model=ForwardModelConfig(**{'sigma': 0.3, 'clutter': 0.2, **(model or {})}),
        window=WindowConfig(**{'resolution': 0.5, **(window or {})}),
        chain=ChainConfig(**{'burn_in': 10, **chain}),
    )


def taken(*scans, start=None, **changes):
    """Return a refinement that took these scans."""
    refinement = Refinement(settings(**changes))
    refinement.take(list(scans), start)
    return refinement


def run(refinement, **stop):
    """Sample and return all progress; by time and convergence it does not stop."""
    return list(refinement.run(StopConfig(**{'max_time': 60.0, 'r_hat': 0.0, **stop})))


def maps(refinement):
    """Every chain's map as the set of occupied lattice cells."""
    spec = refinement.window.spec
    found = []
    for state in refinement.sampler.states:
        rows, columns = np.nonzero(state.cells.reshape(spec.height, spec.width))
        found.append(set(zip(columns + spec.column0, rows + spec.row0, strict=True)))
    return found


def lattice_map(values, column0=0, row0=0, **spec):
    """Return a map of these probabilities on the lattice of the refinement."""
    probability = np.array(values, np.float32)
    height, width = probability.shape
    where = {'width': width, 'height': height, 'column0': column0, 'row0': row0}
    return GridMap(GridSpec(**{'resolution_m': 0.5, **where, **spec}), probability)

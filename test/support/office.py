"""The simulated walk through the office: how much of it the shared bag holds, and few sweeps."""

import numpy as np

__all__ = ['CELLS', 'COARSE', 'EVERY', 'FEW', 'OFFICE_SCANS', 'probability']

OFFICE_SCANS = 290
EVERY = 4
"""Every so many-th of 1158 scans is taken: all of the office is seen, and replays take less."""

# Options of `sample`: single cells, coarse ones of some beams, and so few sweeps of these.
CELLS = ('--prior', 'uniform', '--patch-size', '1')
COARSE = ('--resolution', '0.2', '--beam-stride', '6', *CELLS, '--json')
FEW = (*COARSE, '--max-sweeps', '80', '--burn-in', '16', '--r-hat', '0')


def probability(folder):
    """Return the map that `sample` left."""
    with np.load(folder / 'map.npz') as data:
        return data['probability']

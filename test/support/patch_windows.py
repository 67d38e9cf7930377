"""Small windows, maps and tables of patterns to draw patches of."""

import math

import numpy as np

from ogm_mcmc.config import ForwardModelConfig, WindowConfig
from ogm_mcmc.geometry import CellBox, PlacedScan, Pose2D
from ogm_mcmc.sampling import RayWindow
from ogm_mcmc.sampling.patch_prior import PatchTable, make_table
from support.strategies import fan

__all__ = [
    'HEIGHT',
    'MODELS',
    'PLACES',
    'WIDTH',
    'handmade_table',
    'some_map',
    'table_of',
    'two_scans',
    'window_of',
]

# Two patches of 3 x 3, one beside the other.
WIDTH, HEIGHT = 6, 5
PLACES = ((1, 1), (1, 2))
MODELS = ForwardModelConfig(sigma=0.9), ForwardModelConfig(kind='gaussian', sigma=1.1)


def window_of(scans, width=WIDTH, height=HEIGHT, model=MODELS[0], cut_sigma=0.0):
    """Window of cells of 1 m with its lower left corner at the origin."""
    window = RayWindow(
        WindowConfig(resolution=1.0, cut_sigma=cut_sigma),
        model,
        limits=CellBox(0, 0, width, height),
    )
    for placed in scans:  # one by one, as they come in
        window.add([placed])
    return window


def two_scans():
    """From inside and from the rim, into all directions, with readings of all kinds."""
    around = fan(1.3, 2.2, 2.9, 0.7, math.inf, 1.6, 2.4, increment=0.9, range_max_m=7.0)
    ahead = fan(2.4, 4.6, 3.1, 5.2, 0.4, bearing=-0.5, increment=0.25, range_max_m=7.0)
    return [
        PlacedScan.at(around, Pose2D(3.3, 2.6, 0.1)),
        PlacedScan.at(ahead, Pose2D(0.4, 2.3, 0.05)),
    ]


def handmade_table():
    """Four listed patterns beside every border, the others share a floor of 0.06."""
    listed = np.array([0, 511, 7, 73], np.int32)
    shares = np.array([0.5, 0.2, 0.14, 0.1])
    return PatchTable(
        3,
        np.zeros(1, np.int32),
        np.array([0, 4], np.int32),
        listed,
        np.log(shares),
        np.log(np.array([0.06 / 508])),
    )


def table_of(name, buildings):
    if name == 'handmade':
        return handmade_table()
    if name == 'uniform':
        return make_table('uniform', 9, p_occupied=0.3)
    return make_table('border', 9, buildings)


def some_map(rng, share=0.3, width=WIDTH, height=HEIGHT):
    return (rng.random(width * height) < share).astype(np.uint8)

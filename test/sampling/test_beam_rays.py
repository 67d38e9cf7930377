"""How far readings of single beams scatter, and what an index makes of it."""

import math

import numpy as np
import pytest
from support.strategies import fan

from ogm_mcmc.config import ForwardModelConfig, WindowConfig
from ogm_mcmc.geometry import PlacedScan, Pose2D
from ogm_mcmc.geometry.slants import slants_of
from ogm_mcmc.sampling import CellModel, RayWindow
from ogm_mcmc.sampling.beam_rays import MOST_GRAZED, most_near_cells, rays_of_scan
from ogm_mcmc.sensors.forward_model import ForwardModel

CELL = 0.1
STEP = math.radians(3.0)


def grazed(lost=()):
    """A wall 1 m to the left, met from square to grazing, nothing ahead."""
    bearings = math.pi / 2.0 - STEP * np.arange(29)
    ranges = 1.0 / np.sin(bearings)
    ranges[list(lost)] = math.inf
    scan = fan(*ranges, bearing=bearings[0], increment=-STEP, range_max_m=30.0)
    return PlacedScan.at(scan, Pose2D(0.03, 0.04))


def test_ranges_of_grazing_beams_scatter_more_up_to_some_cells():
    placed, config = grazed(), WindowConfig(CELL)
    rays = rays_of_scan(placed, config, 0.02, 0.05)
    more = np.minimum(0.05 * slants_of(placed.scan, CELL), MOST_GRAZED * CELL)
    assert rays.sigma == pytest.approx(np.hypot(0.02, more))
    assert rays.sigma[0] < 0.025
    assert rays.sigma[-1] == pytest.approx(np.hypot(0.02, MOST_GRAZED * CELL))
    assert rays.length * CELL == pytest.approx(rays.reading + config.cut_sigma * rays.sigma)
    assert (rays_of_scan(placed, config, 0.02).sigma == 0.02).all()


def test_beams_that_are_left_out_tell_of_the_surface_between_others():
    placed = grazed(lost=[5])
    every, third = (
        rays_of_scan(placed, WindowConfig(CELL, beam_stride=stride), 0.02, 0.05)
        for stride in (1, 3)
    )
    assert np.array_equal(third.sigma, every.sigma[::3])


@pytest.mark.parametrize('kind', ['beam', 'gaussian'])
def test_maps_are_as_likely_as_readings_that_each_scatter_by_their_own(kind):
    """Beam for beam, a window of each against its equation, as far as rays are followed."""
    config, given = WindowConfig(CELL), ForwardModelConfig(kind, 0.05, grazing=0.05)
    window = RayWindow(config, given)
    placed = grazed()
    window.add([placed])
    rays = rays_of_scan(placed, config, 0.05, 0.05)
    cells = np.zeros(window.index.n_cells, np.uint8)
    cells[9 * window.spec.width : 10 * window.spec.width] = 1
    row = 9 + window.spec.row0
    model = CellModel(window.index, 0.0, window.spec.width)
    expected = 0.0
    for n in range(rays.length.size):
        # Where the beam is in the row; the column it enters by is what the first hit is of.
        y = (np.array([row, row + 1]) - rays.y[n]) / rays.uy[n]
        x = np.floor(rays.x[n] + y[0] * rays.ux[n] + 1e-9)
        leaves = (x + 1.0 - rays.x[n]) / rays.ux[n] if rays.ux[n] > 1e-9 else math.inf
        middle = (y[0] + min(y[1], leaves)) / 2.0 * CELL
        own = ForwardModel.from_config(given)._replace(sigma_m=rays.sigma[n])
        expected += own.log_likelihood(rays.reading[n], rays.reach[n], middle)
    assert model.log_likelihood(model.start(cells)) == pytest.approx(expected, abs=2e-3)


def test_no_list_gets_more_entries_than_were_counted_on():
    config, given = WindowConfig(CELL), ForwardModelConfig(sigma=0.03, grazing=0.06)
    window = RayWindow(config, given)
    placed = grazed(lost=[3, 4])
    window.add([placed])
    rays = rays_of_scan(placed, config, given.sigma_m, given.grazing_m)
    most = most_near_cells(rays, window.model, CELL)
    assert 0.5 * most.sum() < window.index.near.shape[0] <= most.sum()

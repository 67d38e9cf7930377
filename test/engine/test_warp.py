"""Maps that go with their scans, cell by cell."""

import math

import numpy as np
import pytest
from support.strategies import fan

from ogm_mcmc.engine.warp import cells_before, laid_on, warped
from ogm_mcmc.geometry import GridSpec, PlacedScan, Pose2D

OLD = GridSpec(0.1, 60, 40, -30, -20)
NEW = GridSpec(0.1, 70, 50, -25, -18)


def at(x, y=0.0, yaw=0.0):
    return PlacedScan.at(fan(1.0), Pose2D(x, y, yaw))


def moved(scans, step):
    return [PlacedScan.at(one.scan, step.compose(one.pose)) for one in scans]


@pytest.mark.parametrize(
    'step',
    [Pose2D(0.1, 0.0), Pose2D(0.3, -0.2), Pose2D(0.5, 0.1, math.pi / 2.0), Pose2D(9.0, 0.0, 0.3)],
)
def test_a_map_goes_along_as_one_body_with_all_its_scans(step):
    scans = [at(-1.0), at(0.5, 0.7), at(2.0)]
    values = np.random.default_rng(1).integers(0, 200, (OLD.height, OLD.width), np.uint8)
    before = cells_before(OLD, NEW, scans, moved(scans, step))
    found = warped(values.reshape(-1), before, 255).reshape(NEW.height, NEW.width)
    back = step.inverse()
    for row in range(0, NEW.height, 3):
        for column in range(NEW.width):
            here = Pose2D(
                NEW.origin_x_m + (column + 0.5) * 0.1, NEW.origin_y_m + (row + 0.5) * 0.1
            )
            was = back.compose(here)
            c = math.floor((was.x_m - OLD.origin_x_m) / 0.1 + 1e-9)
            r = math.floor((was.y_m - OLD.origin_y_m) / 0.1 + 1e-9)
            if 0 <= c < OLD.width and 0 <= r < OLD.height:
                near = values[max(r - 1, 0) : r + 2, max(c - 1, 0) : c + 2]
                assert found[row, column] in near  # rounding may take the next cell
            elif not (-1 <= c <= OLD.width and -1 <= r <= OLD.height):
                assert found[row, column] == 255


def test_nothing_moves_where_no_scan_moved():
    scans = [at(-2.0), at(2.0)]
    assert cells_before(OLD, OLD, scans, []) is None
    assert cells_before(OLD, OLD, scans, [*scans, at(0.0)]) is None
    placed = [scans[0], *moved(scans[1:], Pose2D(0.0, 0.3))]
    before = cells_before(OLD, OLD, scans, placed)
    index = np.arange(OLD.width * OLD.height).reshape(OLD.height, OLD.width)
    assert np.array_equal(before[:, :16], index[:, :16])
    assert np.array_equal(before[3:, -12:], index[:-3, -12:])


def test_a_map_laid_on_another_window_of_its_lattice():
    values = np.random.default_rng(2).integers(0, 2, (OLD.height, OLD.width), np.uint8)
    found = laid_on(values.reshape(-1), OLD, NEW, 7).reshape(NEW.height, NEW.width)
    assert np.array_equal(found[:38, :55], values[2:, 5:])
    assert (found[38:] == 7).all()
    assert (found[:, 55:] == 7).all()
    same = laid_on(values.reshape(-1), OLD, OLD, 7)
    assert np.array_equal(same, values.reshape(-1))
    assert same is not values  # chains change it in place

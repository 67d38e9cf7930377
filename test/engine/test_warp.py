"""Maps that go with their scans, cell by cell."""

import math

import numpy as np
from support.strategies import fan

from ogm_mcmc.engine.warp import laid_on, moved_cells
from ogm_mcmc.geometry import GridSpec, PlacedScan, Pose2D

OLD = GridSpec(0.1, 60, 40, -30, -20)
NEW = GridSpec(0.1, 70, 50, -25, -18)


def at(x, y=0.0, yaw=0.0):
    return PlacedScan.at(fan(1.0), Pose2D(x, y, yaw))


def moved(scans, step):
    return [PlacedScan.at(one.scan, step.compose(one.pose)) for one in scans]


def test_cells_go_with_the_nearest_place_of_a_scan():
    """Moved are those where a scan came to, and where it was; the others stay."""
    scans = [at(-2.0), at(2.0), at(0.0, 9.0)]
    placed = [scans[0], *moved(scans[1:2], Pose2D(0.0, 3.0)), scans[2]]
    found = moved_cells(NEW, scans, placed).reshape(NEW.height, NEW.width)
    places = [(-2.0, 0.0, 0), (2.0, 0.0, 1), (2.0, 3.0, 1), (0.0, 9.0, 0)]
    for row in range(NEW.height):
        for column in range(NEW.width):
            first = row - row % 16, column - column % 16
            last = min(first[0] + 16, NEW.height), min(first[1] + 16, NEW.width)
            y = NEW.origin_y_m + 0.1 * (first[0] + last[0]) / 2.0
            x = NEW.origin_x_m + 0.1 * (first[1] + last[1]) / 2.0
            *_, expected = min(places, key=lambda p: math.hypot(p[0] - x, p[1] - y))
            assert found[row, column] == expected
    assert 0 < np.count_nonzero(found) < found.size


def test_nothing_moves_where_no_scan_moved():
    scans = [at(-2.0), at(2.0)]
    assert moved_cells(OLD, scans, []) is None
    assert moved_cells(OLD, scans, [*scans, at(0.0)]) is None
    # A reading of 1 m turns by less than a quarter of a cell, or by more.
    for hardly in (Pose2D(1e-6, -1e-6, 1e-6), Pose2D(0.024, 0.0)):
        assert moved_cells(OLD, scans, moved(scans, hardly)) is None
    turned = [at(-2.0, yaw=0.024), at(2.0)]
    assert (
        moved_cells(
            OLD, scans, [one._replace(scan=o.scan) for one, o in zip(turned, scans, strict=True)]
        )
        is None
    )
    turned = [at(-2.0, yaw=0.026), at(2.0)]
    assert moved_cells(
        OLD, scans, [one._replace(scan=o.scan) for one, o in zip(turned, scans, strict=True)]
    ).any()
    assert moved_cells(OLD, scans, moved(scans, Pose2D(0.1, 0.0))).all()


def test_a_map_laid_on_another_window_of_its_lattice():
    values = np.random.default_rng(2).integers(0, 2, (OLD.height, OLD.width), np.uint8)
    found = laid_on(values.reshape(-1), OLD, NEW, 7).reshape(NEW.height, NEW.width)
    assert np.array_equal(found[:38, :55], values[2:, 5:])
    assert (found[38:] == 7).all()
    assert (found[:, 55:] == 7).all()
    same = laid_on(values.reshape(-1), OLD, OLD, 7)
    assert np.array_equal(same, values.reshape(-1))
    assert same is not values  # chains change it in place

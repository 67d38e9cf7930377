"""Turned worlds: what is true of a cell, and poses that agree with it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from ogm_mcmc.geometry import GridSpec, PlacedScan, Pose2D, Scan
from ogm_mcmc.simulation import GridWorld, Turned


def a_world():
    occupied = np.zeros((6, 8), np.uint8)
    occupied[0], occupied[3:5, 2:4] = 1, 1
    return GridWorld.checked(GridSpec(0.1, 8, 6, column0=5, row0=-2), occupied)


def test_the_truth_is_that_of_a_plain_look_at_points():
    turned = Turned.about_middle(a_world(), 0.4)
    truth = turned.truth(turned.spec(0.15))
    spec, own = truth.spec, turned.world.spec
    points, expected = 5, np.full((spec.height, spec.width), np.nan)
    middle = np.array([own.origin_x_m + 0.4, own.origin_y_m + 0.3])
    for row in range(spec.height):
        for column in range(spec.width):
            solid, outside = 0, False
            for k in range(points**2):
                at = (column + (k % points + 0.5) / points, row + (k // points + 0.5) / points)
                x, y = np.array([spec.origin_x_m, spec.origin_y_m]) + 0.15 * np.array(at) - middle
                there_x = math.cos(0.4) * x + math.sin(0.4) * y + 0.4
                there_y = -math.sin(0.4) * x + math.cos(0.4) * y + 0.3
                if 0.0 <= there_x < 0.8 and 0.0 <= there_y < 0.6:
                    solid += turned.world.occupied[int(there_y / 0.1), int(there_x / 0.1)]
                else:
                    outside = True
            if not outside and (solid == 0 or 2 * solid >= points**2):
                expected[row, column] = solid > 0
    np.testing.assert_array_equal(truth.probability, expected)
    assert {0.0, 1.0} < set(np.unique(np.nan_to_num(expected, nan=-1.0)))


def test_a_world_that_is_not_turned_is_its_own_truth():
    world = a_world()
    turned = Turned.about_middle(world, 0.0)
    truth = turned.truth(world.spec)
    np.testing.assert_array_equal(truth.probability, world.occupied)


@pytest.mark.parametrize('turn', [math.pi / 2, -math.pi / 2, math.pi])
def test_a_quarter_turn_turns_the_cells(turn):
    cells = np.zeros((4, 4), np.uint8)
    cells[0, 1], cells[2, 3] = 1, 1
    turned = Turned.about_middle(GridWorld.checked(GridSpec(0.5, 4, 4), cells), turn)
    truth = turned.truth(GridSpec(0.5, 4, 4))
    # rot90 turns clockwise where rows go up.
    np.testing.assert_array_equal(truth.probability, np.rot90(cells, -round(turn / (math.pi / 2))))


def test_a_beam_ends_where_the_turned_wall_is():
    turned = Turned.about_middle(a_world(), 0.4)
    in_world = Pose2D(0.55, 0.25, 0.3)
    (length,) = turned.world.ranges(in_world, np.zeros(1), 2.0, depth=0.5)
    scan = Scan.checked(
        np.array([length], np.float32), angle_min_rad=0.0, angle_increment_rad=0.1,
        range_min_m=0.0, range_max_m=2.0,
    )  # fmt: skip
    ((same, belief),) = turned.placed([PlacedScan.at(scan, in_world)])
    assert same is scan
    pose = belief.mean
    x, y = pose.x_m + length * math.cos(pose.yaw_rad), pose.y_m + length * math.sin(pose.yaw_rad)
    truth = turned.truth(turned.spec(0.01))
    column, row = truth.spec.cell_of(x, y)
    assert truth.probability[row, column] == 1.0
    here, beside = truth.spec.cell_of(pose.x_m, pose.y_m)
    assert truth.probability[beside, here] == 0.0

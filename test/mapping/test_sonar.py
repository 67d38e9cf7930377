"""Cones in a map: against the model cell by cell, and a ring of sonars in a room."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.naive import measured_cells
from support.strategies import REPEATABLE, fan

from ogm_mcmc.config import MapperConfig, SonarModelConfig
from ogm_mcmc.errors import GridError
from ogm_mcmc.geometry import CellBox, PlacedScan, Pose2D, PoseBelief, Scan
from ogm_mcmc.mapping import SonarMapper
from ogm_mcmc.mapping.sonar_kernels import add_cone
from ogm_mcmc.sensors import SonarInverseModel

approx = pytest.approx


def mapper(**settings):
    return SonarMapper(MapperConfig(**{'method': 'sonar', 'resolution': 0.1, **settings}))


def cone(reading, width=0.5, bearing=0.0, range_max_m=5.0):
    return Scan.checked(
        np.array([reading]),
        angle_min_rad=bearing,
        angle_increment_rad=0.0,
        range_min_m=0.0,
        range_max_m=range_max_m,
        beam_width_rad=width,
    )


def expected_cells(config, scan, sensor, reading, hit):
    """Every cell whose centre is in the cone, with its log-odds by the model's own function."""
    model, half = SonarInverseModel(config.sonar), scan.beam_width_rad / 2
    cells = {}
    reach = reading + (config.sonar.thickness if hit else 0.0)
    n = math.ceil(reach / config.resolution) + 2
    column, row = (math.floor(v / config.resolution) for v in (sensor.x_m, sensor.y_m))
    heading = sensor.yaw_rad + scan.angle_min_rad
    for c in range(column - n, column + n + 1):
        for r in range(row - n, row + n + 1):
            x = (c + 0.5) * config.resolution - sensor.x_m
            y = (r + 0.5) * config.resolution - sensor.y_m
            distance = math.hypot(x, y)
            angle = (math.atan2(y, x) - heading + math.pi) % (2 * math.pi) - math.pi
            if distance <= reach and abs(angle) <= half:
                value = model.log_odds(
                    np.array(distance if hit else min(distance, 0.5 * reading)),
                    np.array(angle), reading, scan.range_max_m, scan.beam_width_rad,
                )  # fmt: skip
                cells[c, r] = float(value)
    return cells


@given(
    reading=st.one_of(st.floats(0.8, 3.0), st.just(math.inf)),
    width=st.floats(0.1, 3.0),
    yaw=st.floats(-3.0, 3.0),
    bearing=st.floats(-3.0, 3.0),
    x=st.floats(-3.0, 3.0),
    y=st.floats(-3.0, 3.0),
)
@settings(REPEATABLE, max_examples=80)
def test_a_cone_is_the_model_cell_by_cell(reading, width, yaw, bearing, x, y):
    method = mapper()
    scan, sensor = cone(reading, width, bearing, range_max_m=3.2), Pose2D(x, y, yaw)
    box = method.update(PlacedScan.at(scan, sensor))
    hit = math.isfinite(reading)
    length = float(np.float32(reading)) if hit else 3.2
    expected = expected_cells(method.config, scan, sensor, length, hit)
    found = measured_cells(method.log_odds(method.spec.box), method.spec.box)
    assert all(box.covers(CellBox(c, r, c + 1, r + 1)) for c, r in found)
    same = set(found) & set(expected)
    assert [found[cell] for cell in same] == approx([expected[c] for c in same], abs=1e-5)
    # Beyond the cone only what the axis passes; missing only what rounding put on its edge.
    assert len(set(expected) - set(found)) <= 2
    for c, r in set(found) - set(expected):
        dx, dy = (c + 0.5) * 0.1 - x, (r + 0.5) * 0.1 - y
        across = abs(dy * math.cos(yaw + bearing) - dx * math.sin(yaw + bearing))
        assert across <= 0.0501 or len(set(found) - set(expected)) <= 2


def test_a_cone_narrower_than_a_cell_leaves_no_holes():
    """Along a diagonal, cells of the axis are measured from the sensor to the echo."""
    method = mapper()
    method.update(PlacedScan.at(cone(3.0, width=0.002), Pose2D(0.013, 0.017, 0.7)))
    for step in np.arange(0.05, 3.0, 0.02):
        x, y = 0.013 + step * math.cos(0.7), 0.017 + step * math.sin(0.7)
        column, row = method.spec.cell_of(x, y)
        near = method.grid.log_odds[row - 1 : row + 2, column - 1 : column + 2]
        assert np.isfinite(near).any()


@pytest.mark.parametrize('width', [5e-324, 1e-310, 1e-20])
def test_a_cone_as_thin_as_a_line(width):
    method = mapper()
    method.update(PlacedScan.at(cone(1.0, width), Pose2D(0.05, 0.05)))
    shown = measured_cells(method.probabilities(method.spec.box), method.spec.box)
    assert {cell for cell, p in shown.items() if p < 0.5} >= {(c, 0) for c in range(1, 5)}
    assert all(row == 0 for _, row in shown)


def test_the_field_of_view_of_the_reading_counts_before_the_parameter():
    def measured(width, **sonar):
        method = mapper(sonar=SonarModelConfig(**sonar))
        method.update(PlacedScan.at(cone(3.0, width), Pose2D(0.05, 0.05)))
        return int(np.isfinite(method.grid.log_odds).sum())

    assert measured(0.4, opening_angle=1.0) == measured(0.4)
    assert measured(0.0, opening_angle=0.4) == measured(0.4)
    assert measured(0.0, opening_angle=1.0) > 2 * measured(0.4)


def test_readings_that_say_nothing_and_those_that_clear():
    belief = PoseBelief(Pose2D(0.05, 0.05))
    for reading in (math.nan, -math.inf, 9.0):
        assert mapper().update(PlacedScan(cone(reading), belief)).empty
    assert mapper(no_return='ignore').update(PlacedScan(cone(math.inf), belief)).empty
    method = mapper(max_range=2.0)
    method.update(PlacedScan(cone(3.0), belief))
    probabilities = method.probabilities(method.spec.box)
    assert np.nanmax(probabilities) < 0.5
    assert not method.update(PlacedScan(cone(math.inf), belief)).empty


def test_max_cells_is_respected_with_nothing_changed():
    method = mapper(max_cells=4096)
    method.update(PlacedScan.at(cone(2.0), Pose2D(2.0, 3.0)))
    before = method.grid.log_odds.copy()
    with pytest.raises(GridError, match='would grow'):
        method.update(PlacedScan.at(cone(2.0), Pose2D(500.0, 3.0)))
    assert np.array_equal(method.grid.log_odds, before, equal_nan=True)


@pytest.mark.jit
def test_one_specialization_of_the_kernel():
    for change in ({}, {'resolution': 1, 'max_range': 2, 'prior': 0.25}):
        method = mapper(**change)
        for scan in (cone(1.5), cone(math.inf), fan(2.0, 3.0)):
            method.update(PlacedScan.at(scan, Pose2D(1, 2, 3)))
    assert len(add_cone.signatures) == 1

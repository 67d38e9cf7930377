"""The random-field map: the field of the two-assumption map, and what is shown of it."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.strategies import REPEATABLE, fan, poses, scans

from ogm_mcmc.config import MapperConfig, RandomFieldConfig, StepModelConfig
from ogm_mcmc.errors import GridError
from ogm_mcmc.geometry import CellBox, PlacedScan, Pose2D, PoseBelief
from ogm_mcmc.lab.benchmarks.scene import load_scene
from ogm_mcmc.mapping import RandomFieldMapper, TwoAssumptionMapper
from ogm_mcmc.mapping.gaussian_field import solve_field

approx = pytest.approx


def mapper(field=None, radius=None, max_cells=10**8, fusion='per_scan'):
    """A map of 1 m cells."""
    config = MapperConfig(
        resolution=1.0,
        max_cells=max_cells,
        fusion=fusion,
        step=StepModelConfig(l_free=-0.75, l_occ=2.0),
        random_field=field or RandomFieldConfig(),
    )
    return RandomFieldMapper(config, radius=radius)


def at(x=0.5, y=0.5, yaw=0.0):
    return PoseBelief(Pose2D(x, y, yaw))


@pytest.mark.jit
@given(
    placed=st.lists(st.tuples(scans(), poses(2.0)), min_size=1, max_size=3),
    often=st.booleans(),
    fusion=st.sampled_from(['per_scan', 'per_beam']),
)
@settings(REPEATABLE, max_examples=12)
def test_it_is_the_field_of_the_two_assumption_map(fusion, placed, often):
    """Whether the map is read after every scan or once at the end; nothing is dropped."""
    method = mapper(RandomFieldConfig(length_scale=0.5), radius=20, fusion=fusion)
    known = TwoAssumptionMapper(method.config)
    for scan, sensor in placed:
        method.update(PlacedScan.at(scan, sensor))
        known.update(PlacedScan.at(scan, sensor))
        if often:
            method.probabilities(method.spec.box)
    box = CellBox(-10, -10, 11, 11)
    method.observed.grid.cover(box)
    known.grid.cover(box)
    observed = method.observed.log_odds(box)
    assert np.array_equal(known.log_odds(box), observed, equal_nan=True)
    solved = solve_field(observed.astype(float), method.settings)
    assert method.log_odds(box) == approx(solved.mean, abs=1e-9)
    assert method.variance(box) == approx(solved.variance, abs=1e-9)


def test_cells_beside_a_beam_are_predicted_and_those_far_off_unknown():
    field = RandomFieldConfig(length_scale=1.0, max_variance=0.8)
    method = mapper(field=field)
    box = method.update(PlacedScan(fan(8.0), at()))
    assert box == CellBox(-4, -4, 13, 5)
    shown = ~np.isnan(method.probabilities(CellBox(-4, -4, 13, 5)))
    variance = method.variance(CellBox(-4, -4, 13, 5))
    assert np.array_equal(shown, variance <= 0.8)
    rows = shown.any(axis=1)
    assert rows.tolist() == [False] * 3 + [True] * 3 + [False] * 3
    # Next to the way of the beam it is free, next to its end it is not.
    assert method.probabilities(CellBox(3, 1, 4, 2))[0, 0] < 0.5
    assert method.probabilities(CellBox(8, 1, 9, 2))[0, 0] > 0.5


def test_centres_of_cells_are_points_like_others():
    method = mapper(field=RandomFieldConfig(length_scale=0.5), radius=20)
    method.update(PlacedScan(fan(8.0, 7.0, increment=0.3), at(0.5, 0.5, 0.2)))
    box = CellBox(-2, -3, 10, 5)
    columns, rows = np.meshgrid(np.arange(-2, 10), np.arange(-3, 5))
    centres = np.stack((columns, rows), axis=-1).reshape(-1, 2) + 0.5
    found = method.at(centres)
    assert found.mean == approx(method.log_odds(box).ravel(), abs=1e-9)
    assert found.variance == approx(method.variance(box).ravel(), abs=1e-9)
    far = method.at(np.array([[1e4, -1e4]]))
    assert (far.mean[0], far.variance[0]) == (0.0, 1.0)


@pytest.mark.parametrize(('limit', 'rows'), [(0.0, 1), (1.0, 9)])
def test_ends_of_the_variance_scale(limit, rows):
    """0: measured cells alone; 1: every cell that an observation reaches, and no other."""
    method = mapper(field=RandomFieldConfig(length_scale=1.0, max_variance=limit))
    method.update(PlacedScan(fan(8.0), at()))
    shown = ~np.isnan(method.probabilities(method.spec.box))
    assert shown.any(axis=1).sum() == rows


def test_a_hole_in_a_wall_is_closed_and_a_door_is_not():
    """Two beams hit the wall left and right of one cell; further on two pass by a wide gap."""
    method = mapper(field=RandomFieldConfig(length_scale=2.0))
    wall = [(2, 5), (4, 5), (9, 5)]
    for x, y in wall:
        for _ in range(4):
            method.update(PlacedScan(fan(y - 0.5), at(x + 0.5, 1.0, math.pi / 2)))
    mean = method.log_odds(CellBox(0, 5, 12, 6))[0]
    assert mean[3] > 2.0
    assert mean[6] < 0.5 * mean[3]


def test_the_prior_of_the_field_is_a_setting():
    method = mapper(field=RandomFieldConfig(mean=-2.0))
    method.update(PlacedScan(fan(8.0), at()))
    spec = method.spec
    assert method.log_odds(CellBox(spec.column0, spec.row0, spec.column0 + 1, spec.row0 + 1)) == -2


def test_a_map_that_would_be_too_large_is_refused_and_unchanged():
    method = mapper(max_cells=3 * 4096)
    method.update(PlacedScan(fan(5.0), at(10.5, 10.5)))
    spec, before = method.spec, method.probabilities(method.spec.box)
    with pytest.raises(GridError, match='max_cells = 12288'):
        method.update(PlacedScan(fan(5.0), at(500.5, 0.5)))
    assert method.spec == spec
    assert np.array_equal(method.probabilities(spec.box), before, equal_nan=True)


def test_at_the_end_of_its_memory_the_map_shows_what_it_can():
    """One block of 64 x 64 cells: what lies beyond is predicted, and not shown."""
    small, large = mapper(max_cells=4096), mapper()
    boxes = [one.update(PlacedScan(fan(5.0), at(0.5, 0.5))) for one in (small, large)]
    assert small.spec.box == CellBox(0, 0, 64, 64)
    assert boxes == [CellBox(0, 0, 10, 5), CellBox(-4, -4, 10, 5)]
    shown = small.probabilities(boxes[0])
    assert np.array_equal(shown, large.probabilities(boxes[0]), equal_nan=True)
    assert np.isfinite(shown[1:3]).any()


def test_a_scan_that_says_nothing_changes_nothing():
    method = mapper()
    spec = method.spec
    assert method.update(PlacedScan(fan(math.nan, -1.0), at(1000.0, 1000.0))).empty
    assert method.spec == spec


@pytest.mark.jit
@pytest.mark.data
def test_recorded_scene_against_the_linear_system(data_folder):
    """Windows around cells that were predicted, at the default settings."""
    scene = load_scene(data_folder / 'bench' / 'scene.npz')
    method = RandomFieldMapper(MapperConfig(resolution=scene.resolution_m))
    for scan, belief in scene.placed:
        method.update(PlacedScan(scan, belief))
    box = method.spec.box
    mean, observed = method.log_odds(box), method.observed.log_odds(box).astype(float)
    predicted = np.argwhere(np.isnan(observed) & (method.variance(box) < 0.9))
    errors = []
    for row, column in predicted[:: len(predicted) // 3]:
        top, left = np.clip((row - 18, column - 18), 0, np.array(observed.shape) - 37)
        window = slice(top, top + 37), slice(left, left + 37)
        solved = solve_field(observed[window], method.settings)
        errors.append((mean[window] - solved.mean)[9:28, 9:28])
    size = np.sqrt(np.nanmean(observed**2))
    assert np.sqrt(np.mean(np.square(errors))) < 0.01 * size
    assert np.max(np.abs(errors)) < 0.1 * size

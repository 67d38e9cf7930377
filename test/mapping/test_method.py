"""What every registered mapping method must hold (`MappingMethod`)."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.naive import measured_cells
from support.strategies import REPEATABLE, fan, poses, scans

from ogm_mcmc.config import MapperConfig, settings_of
from ogm_mcmc.geometry import CellBox, PlacedScan, Pose2D, PoseBelief, PoseSamples, Scan
from ogm_mcmc.mapping import METHODS, all_tables, extras_of, make_method

# Methods that take either inverse model.
BEAM_MODELS = ('two_assumption', 'pose_uncertain', 'random_field')

# Every method in every way it can be configured.
CONFIGS = [
    MapperConfig(method=method, fusion=fusion, inverse_model=model, resolution=0.1)
    for method in sorted(METHODS)
    for fusion in (('per_scan',) if method == 'sonar' else ('per_scan', 'per_beam'))
    for model in (('step', 'gaussian') if method in BEAM_MODELS else ('step',))
]
every_method = pytest.mark.parametrize(
    'config', CONFIGS, ids=[f'{c.method}-{c.fusion}-{c.inverse_model}' for c in CONFIGS]
)

# Beside the borders of cells; what happens upon them is in test_memory_safety.py.
sensors = poses(5.0).map(lambda p: Pose2D(p.x_m + 0.0123, p.y_m + 0.0171, p.yaw_rad))


def shown(method):
    return measured_cells(method.probabilities(method.spec.box), method.spec.box)


def test_the_config_offers_exactly_the_registered_methods():
    choices = next(leaf.choices for leaf in settings_of(MapperConfig) if leaf.name == 'method')
    assert set(choices) == set(METHODS)


@every_method
@pytest.mark.parametrize('reading', [5e-324, 1e-310, 1e-39, 1e-20])
@pytest.mark.parametrize('doubt', [0.0, 1e-4])
def test_a_reading_that_ends_where_it_starts_is_about_the_sensors_own_cell(config, reading, doubt):
    method = make_method(config)
    scan = Scan.checked(
        np.array([reading, reading, reading], np.float32),
        angle_min_rad=-1.0,
        angle_increment_rad=1.0,
        range_min_m=0.0,
        range_max_m=5.0,
    )
    method.update(PlacedScan(scan, PoseBelief(Pose2D(0.05, 0.05), doubt * np.eye(3))))
    after = shown(method)
    assert all(0.0 <= value <= 1.0 for value in after.values())
    if config.method in ('two_assumption', 'counting') and config.inverse_model == 'step':
        assert set(after) <= {(0, 0)}


@every_method
@given(placed=st.lists(st.tuples(scans(), sensors), min_size=1, max_size=5))
@settings(REPEATABLE, max_examples=60)
def test_update_returns_a_box_with_every_changed_cell(config, placed):
    method = make_method(config)
    before = {}
    for scan, sensor in placed:
        box = method.update(PlacedScan.at(scan, sensor))
        assert method.spec.box.covers(box)
        after = shown(method)
        for cell in set(before) | set(after):
            if before.get(cell) != after.get(cell):
                assert box.covers(CellBox(*cell, cell[0] + 1, cell[1] + 1))
        assert all(0.0 <= value <= 1.0 for value in after.values())
        before = after


@every_method
def test_starts_unknown_and_probabilities_are_float32(config):
    method = make_method(config)
    values = method.probabilities(method.spec.box)
    assert values.dtype == np.float32
    assert values.shape == (method.spec.height, method.spec.width)
    assert np.isnan(values).all()


@every_method
def test_walls_become_likely_and_the_way_there_unlikely(config):
    method = make_method(config)
    for _ in range(20):
        method.update(PlacedScan.at(fan(2.0), Pose2D(0.05, 0.05)))
    values = method.probabilities(CellBox(0, 0, 21, 1))[0]
    assert values[20] > 0.9
    assert (values[:18] < 0.1).all()


@every_method
def test_probabilities_of_a_part_are_that_part(config):
    method = make_method(config)
    method.update(PlacedScan.at(fan(2.0, 2.5, math.inf, increment=0.8), Pose2D(0.31, 0.27)))
    box = CellBox(3, 2, 20, 9)
    whole = method.probabilities(method.spec.box)[method.spec.slices(box)]
    assert np.array_equal(method.probabilities(box), whole, equal_nan=True)


@every_method
def test_reading_the_map_does_not_change_it(config):
    method = make_method(config)
    method.update(PlacedScan.at(fan(2.0), Pose2D(0.05, 0.05)))
    before = shown(method)
    method.probabilities(method.spec.box)[:] = 0.5
    assert shown(method) == before


@every_method
def test_reset_gives_an_unknown_map_that_starts_like_a_new_one(config):
    method, fresh = make_method(config), make_method(config)
    method.update(PlacedScan.at(fan(2.0), Pose2D(40.05, -30.05)))
    method.reset()
    assert shown(method) == {}
    for one in (method, fresh):
        one.update(PlacedScan.at(fan(3.0, 4.0, increment=0.5), Pose2D(1.23, 4.56, 0.7)))
    assert method.spec == fresh.spec
    assert shown(method) == shown(fresh)


@every_method
def test_forgotten_cells_leave_the_extent(config):
    method, fresh = make_method(config), make_method(config)
    method.update(PlacedScan.at(fan(2.0), Pose2D(40.05, -30.05)))
    spec = method.spec
    method.forget_cells()
    assert method.spec == spec
    assert shown(method) == {}
    for one in (method, fresh):
        one.update(PlacedScan.at(fan(3.0, 4.0, increment=0.5), Pose2D(39.23, -29.56, 0.7)))
    assert shown(method) == shown(fresh)


@every_method
def test_every_kind_of_belief_is_accepted(config):
    cloud = PoseSamples.checked([[0.05, 0.05, 0.0], [0.15, 0.05, 0.1]])
    for belief in (
        PoseBelief(Pose2D(0.05, 0.05)),
        PoseBelief(Pose2D(0.05, 0.05), np.diag([0.01, 0.01, 0.001])),
        PoseBelief(cloud.mean(), cloud.covariance(), cloud),
    ):
        method = make_method(config)
        assert not method.update(PlacedScan(fan(2.0), belief)).empty


@every_method
def test_what_a_method_saves_beside_its_map_is_registered(config):
    method = make_method(config)
    method.update(PlacedScan.at(fan(2.0), Pose2D(0.05, 0.05)))
    box = CellBox(2, 0, 21, 1)
    extras = extras_of(config.method, method, box)
    assert set(extras.tables) == set(METHODS[config.method].tables) == set(extras.statistics)
    assert bool(extras.summary) == bool(extras.statistics)
    for layer in extras.layers.values():
        assert layer.shape == (1, 19)
    assert all_tables() == {'tree'}

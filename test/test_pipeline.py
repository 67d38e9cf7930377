"""The pipeline of scans to a map: placing, counting, many at once, settings that change."""

import contextlib
import math

import numpy as np
import pytest
from support import pictures
from support.pipelines import at, pipeline, sweep
from support.strategies import fan

from ogm_mcmc.config import MapperConfig, StepModelConfig, settings_of
from ogm_mcmc.errors import ConfigError, GridError
from ogm_mcmc.geometry import (
    CellBox,
    GridMap,
    GridSpec,
    PlacedScan,
    Pose2D,
    PoseBelief,
    Scan,
    SensorMount,
)
from ogm_mcmc.mapping import METHODS, live_settings


def same_map(one, other):
    a, b = one.map(), other.map()
    return a.spec == b.spec and np.array_equal(a.probability, b.probability, equal_nan=True)


# -- MappingPipeline ----------------------------------------------------------------------------


def test_picture_of_a_scan():
    """Three beams of a robot that looks up: left, ahead and right."""
    source = pipeline(resolution=1.0)
    scan = fan(2.0, 3.0, 1.0, bearing=math.pi / 2, increment=-math.pi / 2)
    source.update(PlacedScan(scan, at(2.5, 0.5, math.pi / 2)))
    result = source.map()
    expected = """
        ??#?
        ??.?
        ??.?
        #..#
    """
    assert result.spec == GridSpec(1.0, 4, 4)
    drawn = pictures.draw(np.log(result.probability) - np.log1p(-result.probability))
    assert np.array_equal(pictures.read(drawn), pictures.read(expected))


def test_the_mount_carries_the_sensor():
    """Half a metre ahead of a robot that looks up, turned to the left."""
    mounted, direct = pipeline(), pipeline()
    mount = SensorMount(Pose2D(0.5, 0.2, 1.0))
    mounted.update(PlacedScan.on_robot(sweep(1), at(1.013, 2.017, math.pi / 2), mount))
    direct.update(PlacedScan(sweep(1), at(1.013 - 0.2, 2.017 + 0.5, math.pi / 2 + 1.0)))
    assert same_map(mounted, direct)


@pytest.mark.parametrize('upside_down', [True, False])
def test_an_upside_down_mount_negates_the_bearings(upside_down):
    scan = sweep(2)
    mirrored = Scan.checked(
        scan.ranges_m,
        angle_min_rad=-scan.angle_min_rad,
        angle_increment_rad=-scan.angle_increment_rad,
        range_min_m=scan.range_min_m,
        range_max_m=scan.range_max_m,
    )
    mounted, direct = pipeline(), pipeline()
    mount = SensorMount(upside_down=upside_down)
    mounted.update(PlacedScan.on_robot(scan, at(0.013, 0.017, 0.4), mount))
    direct.update(PlacedScan(mirrored if upside_down else scan, at(0.013, 0.017, 0.4)))
    assert same_map(mounted, direct)
    other = pipeline()
    other.update(PlacedScan(scan if upside_down else mirrored, at(0.013, 0.017, 0.4)))
    assert not same_map(mounted, other)


def test_map_is_cropped_to_the_measured_cells():
    source = pipeline()
    box = source.update(PlacedScan(sweep(1), at(7.013, -3.017)))
    result = source.map()
    assert isinstance(result, GridMap)
    assert result.spec.box == box
    assert np.isfinite(result.probability[[0, -1]]).any(axis=1).all()


def test_counts_and_changes_since_the_last_reset():
    source = pipeline()
    boxes = [source.update(PlacedScan(sweep(k), at(3.0 * k + 0.01, 0.02))) for k in range(3)]
    assert source.scans_used == 3
    assert source.changed == boxes[0].union(boxes[1]).union(boxes[2])
    source.reset()
    assert (source.scans_used, source.changed.empty) == (0, True)
    assert np.isnan(source.map().probability).all()


def test_a_refused_scan_is_not_counted():
    source = pipeline(max_cells=4096)
    source.update(PlacedScan(fan(1.0), at(0.05, 0.05)))
    before, changed = source.map(), source.changed
    with pytest.raises(GridError, match='max_cells'):
        source.update(PlacedScan(fan(1.0), at(100.0, 0.0)))
    assert (source.scans_used, source.changed) == (1, changed)
    assert np.array_equal(source.map().probability, before.probability)


# -- many scans at once -------------------------------------------------------------------------


@pytest.mark.parametrize('method', ['two_assumption', 'counting', 'pose_uncertain'])
def test_many_scans_at_once_make_the_map_of_one_after_the_other(method):
    """Also where one of them leads too far away; of uncertain poses all the doubt is used."""
    doubt = np.diag([0.01, 0.02, 0.003])
    places = [Pose2D(0.1 * k, 0.2) for k in range(5)]
    places.insert(2, Pose2D(1e5, 0.0))
    scans = [PlacedScan(sweep(k), PoseBelief(p, doubt)) for k, p in enumerate(places)]
    one, together = pipeline(method=method), pipeline(method=method)
    for scan in scans:
        with contextlib.suppress(GridError):
            one.update(scan)
    changed = together.update_all(scans)
    assert same_map(one, together)
    assert together.scans_used == one.scans_used == 5
    assert together.changed == one.changed == changed
    given_up = pipeline(method=method)
    given_up.update_all(scans, lambda: True)
    assert not np.isfinite(given_up.method.probabilities(given_up.method.spec.box)).any()
    assert given_up.scans_used == 0


@pytest.mark.parametrize('method', ['two_assumption', 'counting'])
def test_scans_that_were_added_before_it_was_cancelled_are_counted(method):
    scans = [PlacedScan(sweep(k), at(0.1 * k, 0.2)) for k in range(5)]
    one, cancelled = pipeline(method=method), pipeline(method=method)
    for scan in scans[:2]:
        one.update(scan)
    asked = iter((False, False, True))
    cancelled.update_all(scans, lambda: next(asked))
    assert cancelled.scans_used == 2
    box = cancelled.method.spec.box
    assert np.array_equal(
        one.method.probabilities(box), cancelled.method.probabilities(box), equal_nan=True
    )


# -- settings that change while the map grows ---------------------------------------------------


def test_a_safe_change_counts_from_then_on():
    source = pipeline()
    source.update(PlacedScan(fan(1.0), at(0.05, 0.05)))
    changed = MapperConfig(resolution=0.1, step=StepModelConfig(l_occ=3.0), max_range=2.0)
    source.configure(changed)
    source.update(PlacedScan(fan(1.0), at(0.05, 0.05)))
    assert source.config == changed
    cell = CellBox(10, 0, 11, 1)
    assert source.method.log_odds(cell)[0, 0] == pytest.approx(1.3863 + 3.0)


@pytest.mark.parametrize(
    'change', [{'resolution': 0.2}, {'prior': 0.3}, {'method': 'sonar'}, {'max_cells': 10_000}]
)
def test_an_unsafe_change_is_refused_and_changes_nothing(change):
    source = pipeline()
    before = source.config
    with pytest.raises(ConfigError, match=f'^{next(iter(change))} is .* has it fixed or unused'):
        source.configure(MapperConfig(**{'resolution': 0.1, **change}))
    assert source.config == before


@pytest.mark.parametrize('method', sorted(METHODS))
def test_only_settings_that_the_method_uses_are_live(method):
    live = live_settings(method)
    assert live <= {leaf.name for leaf in settings_of(MapperConfig)}
    assert not live & {'method', 'resolution', 'prior', 'max_cells'}
    assert ('step.l_occ' in live) == (method not in ('counting', 'sonar'))


def test_a_setting_without_effect_is_refused():
    source = pipeline(method='counting')
    with pytest.raises(ConfigError, match=r'^step.l_occ is 3.0: method counting .* unused'):
        source.configure(
            MapperConfig(resolution=0.1, method='counting', step=StepModelConfig(l_occ=3.0))
        )
    source.configure(MapperConfig(resolution=0.1, method='counting', fusion='per_beam'))
    assert source.config.fusion == 'per_beam'

"""Localizing in maps: a filter that finds its way, and what counts as lost and found."""

import json
from dataclasses import replace

import numpy as np
import pytest

from ogm_mcmc.config import ForwardModelConfig
from ogm_mcmc.errors import ConfigError
from ogm_mcmc.evaluation import LikelihoodField, aligned
from ogm_mcmc.geometry import GridMap, GridSpec, Pose2D
from ogm_mcmc.lab.experiments import joint_intel, localization, localization_logs
from ogm_mcmc.lab.experiments.localization_logs import Log, log_of
from ogm_mcmc.lab.experiments.localization_maps import (
    MEAN,
    READERS,
    SAMPLES,
    THREE,
    maps_of,
    some_beams,
)
from ogm_mcmc.lab.experiments.localization_table import tables_of
from ogm_mcmc.mapping import ProbabilityBeams
from ogm_mcmc.sensors import ForwardModel
from ogm_mcmc.simulation import GridWorld, Lidar, OdometryNoise
from ogm_mcmc.trajectory.points import poses_of

LIDAR = Lidar(60, range_max_m=8.0, noise_m=0.02, dropout=0.0)
# Where odometry has its origin.
AWAY = np.array([5.0, 1.0, 0.0])
MODEL = ForwardModel.from_config(ForwardModelConfig(sigma=0.1))


@pytest.fixture(scope='module')
def room():
    """A room of 6 m x 4 m without symmetry, and a log of a way through it."""
    occupied = np.zeros((40, 60), np.uint8)
    occupied[[0, -1]] = occupied[:, [0, -1]] = 1
    occupied[1:14, 20:24] = occupied[28:39, 45:48] = occupied[18:21, 1:8] = 1
    world = GridWorld(GridSpec(0.1, 60, 40), occupied)
    along = np.linspace(0.0, 1.0, 40)
    poses = np.column_stack((1.2 + 3.6 * along, 2.3 + 0.3 * np.sin(6 * along), 2 * along - 1))
    rng = np.random.default_rng(1)
    scans = [
        LIDAR.scan(LIDAR.observe(world.ranges(pose, LIDAR.bearings(), 8.0), rng), k)
        for k, pose in enumerate(poses_of(poses))
    ]
    return world.truth(), Log(scans, poses, poses + AWAY, OdometryNoise(), 0.1)


def test_a_filter_keeps_to_its_way_in_a_room_without_symmetry(room):
    truth, log = room
    fit = ProbabilityBeams(truth, MODEL, 0.05)
    tracked = localization.track(log, fit, 0.2, np.random.default_rng(2))
    assert tracked['lost'] == 0
    assert tracked['error_m'] < 0.03
    assert tracked['error_deg'] < 1.0


def test_a_filter_finds_back_where_the_map_says_where_it_is(room):
    truth, log = room
    fit = ProbabilityBeams(truth, MODEL, 0.05)
    assert localization.recover(log, fit, 0.2, np.random.default_rng(2), 8) >= 0.75
    nothing = GridMap(truth.spec, np.full_like(truth.probability, np.nan))
    nowhere = LikelihoodField(nothing)
    assert localization.recover(log, nowhere, 1.0, np.random.default_rng(2), 8) <= 0.25


def test_each_loss_counts_once(room):
    """Odometry that jumps by 3 m once, and a map that says nothing: lost once, then right."""
    truth, log = room
    told = log.reference.copy()
    told[20:, 0] += 3.0
    nothing = LikelihoodField(GridMap(truth.spec, np.full_like(truth.probability, np.nan)))
    sure = OdometryNoise(1e-3, 1e-3, 1e-3, 1e-3)
    tracked = localization.track(
        log._replace(odometry=told, noise=sure), nothing, 1.0, np.random.default_rng(3)
    )
    assert tracked['lost'] == 1
    assert tracked['error_m'] < 0.2


def test_wrong_starts_are_as_wrong_as_they_are_said_to_be():
    pose, rng = Pose2D(1.0, 2.0, 3.0), np.random.default_rng(4)
    for _ in range(10):
        away, turned = localization._off(localization._wrong(pose, rng), pose)
        assert away == pytest.approx(localization.OFF_M)
        assert turned == pytest.approx(localization.OFF_RAD)


def test_errors_over_runs_leave_out_those_without_one():
    mean, error = localization._with_error([1.0, 3.0, None])
    assert (mean, error) == (pytest.approx(2.0), pytest.approx(1.0))
    assert localization._with_error([1.0, None]) == (1.0, None)
    assert localization._with_error([None]) == (None, None)


def test_a_reader_that_is_always_lost_has_no_error(room):
    """Nor is there a number in its place: JSON knows no NaN."""
    truth, log = room
    nothing = LikelihoodField(GridMap(truth.spec, np.full_like(truth.probability, np.nan)))
    away = log.reference + 3.0 * np.arange(len(log.reference))[:, None] * (1.0, 0.0, 0.0)
    tracked = localization.track(
        log._replace(odometry=away), nothing, 1.0, np.random.default_rng(3)
    )
    assert tracked == {'error_m': None, 'error_deg': None, 'lost': 19}
    line = localization._row('one', 1.0, 'a', [{'a': {**tracked, 'found': 0.0}}] * 2)
    assert line['ours'] is None
    assert line['remark'] == '+- -; - +- - degrees; lost 19.00 +- 0.00; found 0.00 +- 0.00'
    json.dumps(line, allow_nan=False)


@pytest.mark.slow
def test_every_reader_is_scored(room, monkeypatch):
    _, log = room
    few = replace(localization.TRACKING, particles=60)
    monkeypatch.setattr(localization, 'log_of', lambda name, seed, reference: log)
    monkeypatch.setattr(localization, 'TRACKING', few)
    monkeypatch.setattr(localization, 'SEARCHING', replace(few, spread_m=1.0, spread_rad=0.5))
    monkeypatch.setattr(localization, 'TRIALS', 2)
    scored = localization.score('room', 1.0, 1, 3, scans=30)
    assert set(scored) == set(READERS)
    for reader, judged in scored.items():
        assert judged['lost'] == 0, reader
        assert judged['error_m'] < 0.1, reader
        assert judged['found'] in {0.0, 0.5, 1.0}, reader


@pytest.mark.parametrize(
    'missing',
    [
        'intel.gfs.log',
        'intel.relations',
        'intel_raw_odometry_910.csv',
        'occupancy_slam_start.txt',
        'freiburg-101-corrected.log.gz',
    ],
)
def test_missing_data_is_said_before_anything_is_done(tmp_path, monkeypatch, missing):
    data = tmp_path / 'data'
    files = (
        *(joint_intel.FOLDER / name for name in joint_intel.FILES),
        localization_logs.FREIBURG,
    )
    for file in files:
        (data / file).parent.mkdir(parents=True, exist_ok=True)
        if file.name != missing:
            (data / file).touch()
    monkeypatch.setenv('OGM_MCMC_DATA', str(data))
    monkeypatch.setattr(localization, 'run_all', lambda *_, **__: pytest.fail('begun'))
    with pytest.raises(ConfigError, match=f'{missing}: no such file; expected OGM_MCMC_DATA to'):
        localization.run(tmp_path / 'out', quick=False, seed=1)


def test_behind_the_walls_of_a_border_map_nothing_is_known(room):
    """Its walls are there, and what chains draw behind them is no knowledge."""
    truth, log = room
    maps = maps_of(log.placed(slice(0, None, 2)), 0.1, 3)
    spec = maps.mean.spec
    rows, columns = np.nonzero(np.isfinite(maps.mean.probability))
    x, y = (columns + spec.column0) - 30, (rows + spec.row0) - 20
    outside = np.maximum(np.abs(x + 0.5) - 30, np.abs(y + 0.5) - 20)
    assert np.count_nonzero(outside > 2.0) < 0.01 * outside.size
    wall = aligned(maps.mean, truth)[39, 5:40]
    assert np.isfinite(wall).mean() > 0.9
    assert np.nanmedian(wall) > 0.5
    assert np.array_equal(maps.bits.known, np.isfinite(maps.mean.probability))


def test_some_beams_are_a_share_of_all(room):
    _, log = room
    placed = log.placed(slice(0, None, 2))
    kept = some_beams(placed, 0.25, np.random.default_rng(5))
    count = sum(int(scan.measured().sum()) for scan, _ in kept)
    assert count == pytest.approx(0.25 * 60 * len(placed), rel=0.2)
    assert [one.pose for one in kept] == [one.pose for one in placed]


@pytest.mark.slow
def test_log_of_a_building_is_scans_along_a_way():
    log = log_of('building-10', 3)
    steps = np.diff(log.reference, axis=0)
    assert len(log.scans) == len(log.reference) == len(log.odometry) > 50
    assert np.hypot(steps[:, 0], steps[:, 1]).max() < 1.0
    drift = np.hypot(*(log.odometry - log.reference)[-1, :2])
    assert drift > 0.5


def test_rows_say_what_each_reader_came_to(tmp_path, monkeypatch):
    def pretended(folder, work, datasets, **_):
        return {
            name: {
                reader: {
                    'error_m': 0.1 * arguments['number'],
                    'error_deg': 1.0,
                    'lost': arguments['number'] - 1,
                    'found': arguments['share'],
                }
                for reader in READERS
            }
            for name, arguments in datasets.items()
        }

    monkeypatch.setattr(localization, 'run_all', pretended)
    result = localization.run(tmp_path, quick=True, seed=1)
    rows = {line['what']: line for line in result['rows']}
    assert len(rows) == len(result['rows']) == 2 * (len(READERS) + 2)
    line = rows['building-9, 25 %: border mean, first hits, m']
    assert line['ours'] == pytest.approx(0.15)
    expected = '+- 0.050; 1.00 +- 0.00 degrees; lost 0.50 +- 0.50; found 0.25 +- 0.00'
    assert line['remark'] == expected
    # Errors of a run are the same whoever reads: paired, nothing is left of them.
    line = rows['building-9, 25 %: border mean, first hits less three values, first hits, m']
    assert (line['ours'], line['remark']) == (0.0, '+- 0.000, paired by run')
    assert all((tmp_path / name).exists() for name in result['pictures'])
    table = (tmp_path / 'table.md').read_text()
    assert '| buildings: the filter reads | 25 % (2 runs) | 1 % (2 runs) |' in table
    assert '| border mean, first hits | 0.150 +- 0.050 (0.5, 0.25) | 0.150' in table


def test_errors_of_a_log_are_over_runs_and_of_buildings_over_their_means():
    def came_to(first, second, lost=0):
        others = dict.fromkeys(READERS, second)
        return {
            reader: {'error_m': error, 'lost': lost, 'found': 0.5}
            for reader, error in {**others, MEAN: first}.items()
        }

    table = tables_of(
        {
            'building-1': {0.05: [came_to(0.1, 0.2), came_to(0.3, 0.2)]},
            'building-5': {0.05: [came_to(0.4, 0.2), came_to(0.4, 0.4)]},
            'intel': {0.05: [came_to(0.1, 0.2, lost=1), came_to(0.2, None, lost=2)]},
        }
    )
    intel, buildings, paired = table.split('\n\n')
    assert '| intel: the filter reads | 5 % (2 runs) |\n| --- | --- |\n' in intel
    assert f'| {MEAN} | 0.150 +- 0.050 (1.5, 0.50) |' in intel
    assert f'| {SAMPLES} | 0.200 (1.5, 0.50) |' in intel  # one run was always lost
    assert f'| {MEAN} | 0.300 +- 0.100 (0, 0.50) |' in buildings
    assert f'| intel: {MEAN} less {THREE} | -0.100 |' in paired
    assert f'| buildings: {MEAN} less {THREE} | +0.050 +- 0.050 |' in paired


def test_joint_poses_of_a_log_are_estimated_once_for_all_runs(tmp_path, monkeypatch):
    """Parts of recorded logs get them, others do not: their truth is known."""
    asked = []

    def pretended(folder, work, datasets, **_):
        asked.append((work, datasets))
        return {name: {'poses': [[0.5, 1.0, 2.0]]} for name in datasets}

    monkeypatch.setattr(localization, 'run_all', pretended)
    monkeypatch.setattr(localization, 'check_data', lambda _: None)
    monkeypatch.setattr(localization, 'tables_of', lambda _: '')
    monkeypatch.setattr(localization, '_row', lambda *_: {})
    monkeypatch.setattr(localization, '_less', lambda *_: {})
    monkeypatch.setattr(localization, '_draw', lambda *_: {})
    localization.run(tmp_path, quick=False, seed=1)
    (first, references), (second, parts) = asked
    assert (first, second) == (localization_logs.reference_of, localization.score)
    assert [one['log'] for one in references.values()] == list(localization_logs.RECORDED)
    for one in parts.values():
        told = {'reference': [[0.5, 1.0, 2.0]]} if one['log'] in ('intel', 'freiburg') else {}
        assert one.get('reference') == told.get('reference')


def test_a_recorded_log_stands_at_the_poses_it_is_told(room, monkeypatch):
    _, log = room
    monkeypatch.setattr(localization_logs, '_recorded', lambda _: (log.scans, log.reference))
    monkeypatch.setattr(localization_logs, '_joint', lambda *_: pytest.fail('estimated again'))
    told = (log.reference + 0.25).tolist()
    held = log_of('freiburg', 1, told)
    assert np.array_equal(held.reference, log.reference + 0.25)
    assert np.array_equal(held.odometry[0], held.reference[0])
    assert log_of('freiburg', 1, told) is held

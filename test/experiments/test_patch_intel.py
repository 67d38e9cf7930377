"""Who gets which beams, what counts, and the whole experiment in coarse cells."""

import math

import numpy as np
import pytest

from ogm_mcmc.errors import ConfigError
from ogm_mcmc.experiments import intel
from ogm_mcmc.experiments.patch_intel import score
from ogm_mcmc.experiments.unseen_space import unseen
from ogm_mcmc.geometry import CellBox, Pose2D
from ogm_mcmc.io.carmen import LogScan
from ogm_mcmc.testing.strategies import fan


def logged(*ranges_m, x=0.0):
    step = math.radians(1.0)
    return LogScan(1, '', 0.0, np.array(ranges_m), -math.pi / 2, step, 0.0, Pose2D(x, 0.0))


@pytest.mark.parametrize(('number', 'used_scans'), [(1, 20), (2, 10), (3, 2)])
def test_every_beam_is_used_or_held_out(number, used_scans):
    logs = [logged(*np.arange(1.0, 8.0) + 0.1 * k, x=k) for k in range(20)]
    used, held_out = intel.split(logs, number)
    assert len(used) == used_scans
    beams = {'used': set(), 'held out': set()}
    for name, scans in (('used', used), ('held out', held_out)):
        for scan, pose in scans:
            for i, reading in enumerate(scan.ranges_m.tolist()):
                bearing = scan.angle_min_rad + i * scan.angle_increment_rad
                beam = round(math.degrees(bearing) + 90.0), round(pose.x_m)
                assert reading == pytest.approx(1.0 + beam[0] + 0.1 * beam[1])
                beams[name].add(beam)
    assert not beams['used'] & beams['held out']
    assert len(beams['used'] | beams['held out']) == 7 * 20
    assert {bearing for bearing, _ in beams['used']} == {0, 2, 4, 6}


def test_codes_of_the_laser_are_no_readings():
    scan = intel.as_scan(logged(1.0, 81.83, 81.91, 79.0))
    assert scan.ranges_m.tolist() == [1.0, math.inf, math.inf, 79.0]


def test_beams_that_leave_the_window_do_not_count():
    box = CellBox(0, 0, 10, 4)
    scan = fan(0.3, 0.8, math.inf)
    (kept, pose), *_ = intel.without_beams_that_leave([(scan, Pose2D(0.35, 0.25))], box, 0.1)
    assert pose == Pose2D(0.35, 0.25)
    assert kept.ranges_m[0] == pytest.approx(0.3)
    assert np.isnan(kept.ranges_m[1:]).all()


def test_window_is_that_of_the_paper():
    assert intel.window_box(0.02).n_cells == 2_250_000
    assert intel.window_box(0.05).n_cells == 360_000


def test_missing_log_is_named(tmp_path, monkeypatch):
    monkeypatch.setenv('OGM_MCMC_DATA', str(tmp_path))
    with pytest.raises(ConfigError, match=r'intel\.gfs\.log: no such file'):
        intel.data_folder()


@pytest.mark.data
def test_mapped_share_is_that_of_table_iii(data_folder):
    logs = intel.read_intel(data_folder)
    assert len(logs) == 910
    benchmark = intel.benchmark_of(logs, 0.02)
    assert benchmark.mapped_share == pytest.approx(0.5963, abs=0.01)
    assert benchmark.near_share == pytest.approx(0.7304, abs=0.01)
    shares = [
        np.isfinite(intel.traditional_map(intel.split(logs, k).used, 0.02).probability).mean()
        for k in (1, 2, 3)
    ]
    # Table III: 0.5578, 0.5027, 0.2822.
    assert shares == pytest.approx([0.5732, 0.5284, 0.3222], abs=0.001)


@pytest.mark.data
def test_border_beats_traditional_in_coarse_cells(data_folder, tmp_path):
    common = {
        'data': str(data_folder), 'pictures': str(tmp_path), 'resolution': 0.1, 'number': 3,
        'kind': 'beam', 'seed': 1, 'held_out_stride': 32,
    }  # fmt: skip
    by = {
        method: score(**common, method=method, sweeps=sweeps)
        for method, sweeps in (('traditional', [0, 0]), ('border9', [30, 40]))
    }
    for one in by.values():
        precision, recall = one['precision'], one['recall']
        assert one['max_f1'] == pytest.approx(2 * precision * recall / (precision + recall))
        assert one['max_f1'] == pytest.approx(max(one['f1_curve']), abs=1e-5)
        # Every mistake is one of the four kinds.
        wrong = one['mistakes_per_occupied_cell']
        missed = sum(share for what, share in wrong.items() if 'missed' in what)
        assert missed == pytest.approx(1.0 - recall)
        extra = sum(share for what, share in wrong.items() if 'none' in what)
        assert extra == pytest.approx(recall / precision - recall)
    assert by['traditional']['seconds_per_sample'] is None
    assert by['border9']['seconds_per_sample'] > 0.0
    assert by['border9']['max_f1'] > by['traditional']['max_f1'] + 0.02
    gain = [by[name]['heldout_loglik_per_beam'] for name in ('border9', 'traditional')]
    assert gain[0] > gain[1]
    assert by['border9']['settings']['patch.prior_file'] == 'buildings.npz'


@pytest.mark.data
def test_dispersed_chains_say_unknown_where_nothing_was_measured(data_folder, tmp_path):
    common = {
        'data': str(data_folder), 'pictures': str(tmp_path), 'resolution': 0.1, 'number': 3,
        'sweeps': [20, 20], 'seed': 1,
    }  # fmt: skip
    by = {start: unseen(**common, start=start) for start in ('live', 'dispersed')}
    assert (
        by['dispersed']['unknown_of_never_measured']
        > by['live']['unknown_of_never_measured'] + 0.1
    )
    assert by['dispersed']['unknown_of_measured'] < 0.2

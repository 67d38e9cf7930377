"""What a user reads of a refinement: limits, progress, and by how much agreement is missed."""

import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed: no ROS tests')

from ogm_mcmc.config import StopConfig, WindowConfig
from ogm_mcmc.engine.grazing import Grazing
from ogm_mcmc.engine.progress import Progress
from ogm_mcmc.engine.range_spread import Spread
from ogm_mcmc.engine.refined_map import WorkerStatus
from ogm_mcmc.engine.sensor_fit import SensorNumbers, Share
from ogm_mcmc.ros.refine_report import (
    disagreement,
    nothing_refined,
    order_text,
    progress_text,
    sensor_values,
    size_refusal,
    status_values,
)
from ogm_mcmc.trajectory import TrajectoryProgress

STOP = StopConfig(max_time=40.0, max_sweeps=500, r_hat=1.1, agreeing_share=0.99)


def progress(share, sweeps=120):
    return Progress(sweeps, 100, 10.0, 12.0, share, 1.3, 50.0, 0.1, -100.0, 4)


def test_the_answer_says_how_much_how_long_and_from_where():
    text = order_text(8, 900, STOP, 0, False)
    assert text == (
        'sampling 8 scans, 900 rays, for at most 40 s and 500 sweeps; begins with new chains'
    )
    assert order_text(8, 900, STOP, 120, True).endswith(
        'goes on from the chains of 120 earlier sweeps'
    )
    assert 'state file' in order_text(8, 900, STOP, 0, True)


@pytest.mark.parametrize(
    ('status', 'said'),
    [
        (WorkerStatus(), 'call ~/refine first'),
        (WorkerStatus('indexing', 48), 'not there yet (indexing, 48 scans)'),
        (WorkerStatus(stopped='stopped'), 'ended before its first map (stopped)'),
        (WorkerStatus(stopped='error', error='no room'), 'before its first map (no room)'),
    ],
)
def test_why_there_is_no_map_yet_is_said(status, said):
    assert said in nothing_refined(status)


def test_progress_is_in_percent_of_the_limit():
    status = WorkerStatus('sampling', progress=progress(0.957))
    assert progress_text(status, STOP) == '120 sweeps, 25 % of the time, 95.7 % of the cells agree'
    assert progress_text(WorkerStatus('indexing'), STOP) == ''


def test_progress_of_poses_says_what_was_done_last():
    poses = TrajectoryProgress('aligned', 0.4, 0.02, 0.01, 0.001, 0, 3.14)
    status = WorkerStatus('refining poses', poses=poses, poses_of_map='as given')
    text = 'aligned in squares of 0.4 m after 3.1 s'
    assert progress_text(status, STOP) == text
    values = status_values(status, 'auto')
    assert (values['poses of the map'], values['joint poses']) == ('as given', text)
    looked = status._replace(poses=poses._replace(doing='looked around', side_m=0.0))
    assert progress_text(looked, STOP) == 'looked around after 3.1 s'
    assert 'joint poses' not in status_values(WorkerStatus(), 'auto')


@pytest.mark.parametrize('reason', ['time', 'sweeps', 'stopped'])
def test_an_end_without_agreement_says_by_how_much(reason):
    status = WorkerStatus('idle', progress=progress(0.957), stopped=reason)
    assert disagreement(status, STOP) == (
        f'ended without agreement ({reason}): R-hat is below 1.1 in 95.7 % of the cells, '
        'expected 99 %'
    )


@pytest.mark.parametrize(
    'status',
    [
        WorkerStatus('idle', progress=progress(0.995), stopped='time'),
        WorkerStatus('idle', progress=progress(0.5), stopped='cleared'),
        WorkerStatus('sampling', progress=progress(0.5)),
        WorkerStatus(),
    ],
)
def test_nothing_is_said_where_all_is_well_or_under_way(status):
    assert disagreement(status, STOP) == ''


def test_without_the_rule_nothing_is_missed():
    status = WorkerStatus('idle', progress=progress(0.5), stopped='time')
    assert disagreement(status, StopConfig(r_hat=0.0)) == ''


def test_what_was_found_out_about_the_sensor():
    clutter, missing = (
        Share(0.02, 0.003, 1000, 0.0145, 0.0262),
        Share(0.1, 0.01, 500, 0.081, 0.121),
    )
    assert sensor_values(SensorNumbers(clutter, missing)) == {
        'clutter beams (share, 95 % interval)': '0.0200 (0.0145 to 0.0262)',
        'missing beams (share, 95 % interval)': '0.1000 (0.0810 to 0.1210)',
    }
    assert list(sensor_values(SensorNumbers(clutter, None))) == [
        'clutter beams (share, 95 % interval)'
    ]
    only = SensorNumbers(
        None,
        None,
        Spread(0.0193, 0.004, 81, 0.0117, 0.027),
        Grazing(Spread(0.03, 0.0, 9, 0.02, 0.04), used=0.03),
    )
    assert sensor_values(only) == {
        'sigma of ranges (95 % interval)': '0.0193 m (0.0117 to 0.0270)',
        'grazing (95 % interval)': '0.0300 m (0.0200 to 0.0400)',
        'grazing used (m)': '0.0300',
    }
    assert sensor_values(None) == {}


@pytest.mark.parametrize(
    ('rays', 'n_bytes', 'expected'),
    [
        (0, 0, 'no beam of 3 scans says anything within max_range = 4 m: nothing to sample'),
        (9, 3_000_000, '9 rays may need 3.0 MB: expected at most window.max_memory_mb = 2'),
        (9, 2_000_000, ''),
    ],
)
def test_orders_that_say_nothing_or_are_too_large_are_refused(rays, n_bytes, expected):
    window = WindowConfig(max_memory_mb=2.0, max_range=4.0)
    assert size_refusal(3, rays, n_bytes, window) == expected

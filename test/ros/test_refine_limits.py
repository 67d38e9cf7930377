"""The refine server where there is nothing to sample, too much, or a wrong parameter."""

import math
import signal

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed: no ROS tests')

from geometry_msgs.msg import PoseWithCovarianceStamped
from rcl_interfaces.msg import ParameterType
from rclpy.parameter import Parameter
from sensor_msgs.msg import LaserScan
from support.local_ros import Logs, local_node, pose, refusal, scan
from support.refine_client import (
    ENDLESS,
    QUICK,
    SCANS,
    Client,
    as_array,
    server,
    server_here,
    stop,
)
from support.ros import NodeProcess, Observer

from ogm_mcmc.ros.refine_server import RefineServer, main

pytestmark = [pytest.mark.ros]


def test_nothing_to_sample():
    """No scan at all, a scan whose pose never came, and a scan that says nothing."""
    # The scan waits for its pose however slow the machine is.
    with server_here(transform_timeout=60.0), Observer() as observer:
        client = Client(observer)
        scans = observer.node.create_publisher(LaserScan, 'scan', 10)
        poses = observer.node.create_publisher(PoseWithCovarianceStamped, 'pose', 10)
        observer.until(lambda: all(p.get_subscription_count() for p in (scans, poses)))
        answer = client.call('refine')
        assert not answer.success
        assert answer.message.startswith('no scan was recorded yet: nothing to sample')
        early = client.call('save_map')
        assert not early.success
        assert early.message == 'nothing to save: nothing was refined yet: call ~/refine first'

        msg = LaserScan(range_min=0.05, range_max=5.0, ranges=[math.nan])
        msg.header.stamp.sec = 1
        scans.publish(msg)
        client.wait_for(scans_received=1)
        answer = client.call('refine')
        assert '(0 scans wait for a pose, 1 messages dropped)' in answer.message
        msg.ranges, msg.header.stamp.sec = [1.0], 2
        scans.publish(msg)
        client.wait_for(scans_received=2)
        answer = client.call('refine')
        assert not answer.success
        assert '(1 scans wait for a pose, 1 messages dropped)' in answer.message
        pose = PoseWithCovarianceStamped()
        pose.header.frame_id, pose.header.stamp.sec = 'map', 2
        pose.pose.pose.orientation.w = 1.0
        poses.publish(pose)
        client.wait_for(scans_recorded=1)


def test_publisher_vanishes_and_the_end_comes_in_mid_sweep(walks):
    """The player is killed half way; what was recorded is refined; SIGINT brings a last map."""
    with server(**ENDLESS, map_update_interval=3000.0) as node, Observer() as observer:
        client = Client(observer)
        arguments = [str(walks[0]), '--rate', '20', '--wait', '200', '--wait-topics', '2']
        with NodeProcess('replay', arguments) as player:
            observer.until(lambda: int(client.values()['scans recorded']) > 40)
            player.process.kill()
            player.wait()
        seen = len(client.reports)
        observer.until(lambda: len(client.reports) >= seen + 2)
        recorded = client.values()['scans recorded']
        client.refine()
        observer.until(lambda: client.sweeps() > 200)
        client.wait_for(scans_recorded=recorded, scans_sampled=recorded)
        # One map when sampling began, the next one only at the end.
        assert len(client.maps) == 1
        node.process.send_signal(signal.SIGINT)
        observer.until(lambda: len(client.maps) == 2)
        assert node.wait() == 0, node.output
        assert 'Traceback' not in node.output, node.output
        assert (as_array(client.maps[1]) > 90).sum() > 100


def test_parameters_while_running(walks):
    latest = {'window__keep': 'latest'}
    with (
        server_here(max_sweeps=60, max_time=1000.0, r_hat=0.0, **latest),
        Observer() as observer,
    ):
        client = Client(observer)
        client.record(walks[0])
        too_few = client.set('max_sweeps', ParameterType.PARAMETER_INTEGER, 'integer_value', 50)
        assert not too_few.successful
        assert too_few.reason == (
            'max_sweeps is 50: expected more than burn_in (50), or no sweep counts'
        )
        fixed = client.set('chain.prior', ParameterType.PARAMETER_DOUBLE, 'double_value', 0.3)
        assert not fixed.successful
        assert 'chain.prior is fixed at start' in fixed.reason
        longer = client.set('max_sweeps', ParameterType.PARAMETER_INTEGER, 'integer_value', 70)
        assert longer.successful
        client.refine()
        client.wait_for(state='idle', stopped_because='sweeps', sweeps=70)
        known = (as_array(client.maps[-1]) >= 0).sum()
        assert client.set(
            'unknown_margin', ParameterType.PARAMETER_DOUBLE, 'double_value', 0.08
        ).successful
        observer.until(lambda: (as_array(client.maps[-1]) >= 0).sum() < known)
        assert client.set(
            'output', ParameterType.PARAMETER_STRING, 'string_value', 'probability'
        ).successful
        observer.until(lambda: set(np.unique(as_array(client.maps[-1]))) > {-1, 0, 100})
        few = client.set('max_scans', ParameterType.PARAMETER_INTEGER, 'integer_value', 20)
        assert few.successful
        client.replay(walks[1])
        client.wait_for(scans_received=2 * SCANS, scans_recorded=20, scans_let_go=2 * SCANS - 20)


@pytest.mark.parametrize(
    ('parameters', 'reason'),
    [
        ({'chain.prior': 0.0}, 'chain.prior'),
        ({'chain.prior': 1.0}, 'chain.prior'),
        ({'model.sigma': 1e-9}, 'model.sigma'),
        ({'model.sigma': -1.0}, 'model.sigma'),
        ({'model.clutter': 0.5, 'model.missing': 0.5}, 'clutter + missing + short is 1.0'),
        ({'chain.burn_in': 2000}, 'max_sweeps is 2000: expected more than burn_in (2000)'),
        ({'r_hat': 0.9}, 'r_hat is 0.9: expected more than 1'),
        ({'free_thresh': 0.9}, 'free_thresh'),
        ({'state_file': '~nosuchuser/chains.npz'}, "state_file is '~nosuchuser/chains.npz'"),
        ({'state_file': '/proc/none/chains.npz'}, '/proc/none: expected a writable folder'),
    ],
)
def test_wrong_parameters_end_the_node_with_one_line(capfd, parameters, reason):
    assert reason in refusal(main, capfd, **parameters)


def test_a_wrong_parameter_ends_the_process_with_one_line():
    with NodeProcess('refine_server', parameters={'chain.prior': 0.0}) as node:
        assert node.wait() == 2, node.output
    errors = [line for line in node.output.splitlines() if line.startswith('error: ')]
    assert len(errors) == 1, node.output
    assert 'chain.prior' in errors[0]
    assert 'Traceback' not in node.output


def test_memory_is_a_limit_like_the_others(walks):
    """A window of 1 MB: scans go, and what is left can be sampled."""
    parameters = {'window__max_memory_mb': 1.0, 'max_sweeps': 60, 'r_hat': 0.0}
    with server_here(**parameters), Observer() as observer:
        client = Client(observer)
        client.replay(walks[0])
        client.wait_for(scans_received=SCANS)
        values = client.values()
        assert 5 < int(values['scans recorded']) < SCANS - 20
        assert int(values['scans recorded']) + int(values['scans let go']) == SCANS
        client.refine()
        client.wait_for(state='idle', stopped_because='sweeps', last_error='')
    # One scan that is too large for any window is refused as it comes.
    with (
        server(window__max_memory_mb=1.0, window__resolution=0.01) as node,
        Observer() as observer,
    ):
        client = Client(observer)
        client.replay(walks[0])
        client.wait_for(scans_received=SCANS)
        assert int(client.values()['dropped: scan_off_map']) > 20
        stop(node)
    assert 'expected at most max_memory_mb = 1 [scan_off_map' in node.output


def test_a_scan_that_leads_too_far_away_is_left_out_and_said():
    """A localizer is lost for a moment; the scans of before and after can be sampled."""
    chosen = [
        Parameter(name, value=value)
        for name, value in {**QUICK, 'window.resolution': 0.05}.items()
    ]
    with local_node(RefineServer, parameter_overrides=chosen) as node:
        logs = Logs(node)
        for k, x in enumerate((0.0, 0.1, 510.0, 510.0, 0.2, 0.3), 1):
            node.intake.on_pose(pose(float(k), x, x))
            node.intake.on_scan(scan(float(k), (1.0, 1.5, 2.0)))
        assert [one.pose.x_m for one in node.recording.snapshot()] == [0.0, 0.1, 0.2, 0.3]
        assert node.intake.problems.all()['scan_off_map'] == 2
        line = next(one for one in logs.of('warning') if 'scan_off_map' in one)
        assert 'at (510.0, 510.0) m it leads too far from the others: map would grow to' in line

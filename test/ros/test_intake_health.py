"""Whether a node gets what it needs: the level, who publishes, and one line for each change."""

import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed: no ROS tests')

from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from sensor_msgs.msg import LaserScan
from support.local_ros import Logs, local_node

from ogm_mcmc.ros import intake_health
from ogm_mcmc.ros.intake_health import IntakeHealth

pytestmark = [pytest.mark.ros]

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR


@pytest.fixture(scope='module')
def node():
    with local_node(namespace='robot') as local:
        yield local


class Clock:
    """Time that stands still until it is moved on."""

    def __init__(self):
        self.now = 100.0

    def monotonic(self):
        return self.now


@pytest.fixture
def clock(monkeypatch):
    clock = Clock()
    monkeypatch.setattr(intake_health, 'time', clock)
    return clock


@pytest.fixture
def watch(node, clock):
    return IntakeHealth(node, ['/robot/scan'], ['/robot/pose'])


def test_before_the_first_scan_it_waits(watch):
    health = watch.judge(10.0)
    assert health.level == WARN
    assert health.message == 'waiting: /robot/scan has 0 publishers, /robot/pose has 0'


def test_who_publishes_is_named(node, watch):
    publishers = [
        node.create_publisher(LaserScan, 'scan', 5),
        node.create_publisher(PoseStamped, 'pose', 5),
        node.create_publisher(PoseStamped, 'pose', 5),
    ]
    text = (
        'waiting: /robot/scan has 1 publisher (/robot/local), '
        '/robot/pose has 2 (/robot/local, /robot/local)'
    )
    node.until(lambda: watch.judge(10.0).message == text)
    for publisher in publishers:
        node.destroy_publisher(publisher)


def test_used_scans_are_well_and_the_want_of_them_is_an_error(node, watch, clock):
    logs = Logs(node)
    watch.scan_came()
    watch.scan_used()
    assert watch.judge(10.0).level == OK
    clock.now += 9.0
    watch.pose_came()
    assert watch.judge(10.0).level == OK
    clock.now += 2.0
    health = watch.judge(10.0)
    assert health.level == ERROR
    assert health.message.startswith('no scan for 11 s: /robot/scan has 0 publishers')
    watch.judge(10.0)
    watch.scan_came()
    watch.scan_used()
    assert watch.judge(10.0).level == OK
    assert [level for level, _ in logs.said] == ['error', 'info']


@pytest.mark.parametrize(
    ('comes', 'what'),
    [
        ((), 'no scan and no pose'),
        (('scan',), 'no pose'),
        (('pose',), 'no scan'),
        (('scan', 'pose'), 'scans and poses come, but none was used'),
    ],
)
def test_what_is_missing_is_named(watch, clock, comes, what):
    clock.now += 20.0
    if 'scan' in comes:
        watch.scan_came()
    if 'pose' in comes:
        watch.pose_came()
    health = watch.judge(10.0)
    assert health.level == ERROR
    assert health.message.startswith(f'{what} for 20 s: ')


def test_a_start_is_quiet_for_a_while(node, watch, clock):
    logs = Logs(node)
    watch.judge(10.0)
    assert logs.said == []
    clock.now += 4.0
    watch.judge(10.0)
    watch.judge(10.0)
    ((level, text),) = logs.said
    assert level == 'warning'
    assert text.startswith('waiting: ')


def test_what_came_before_it_began_does_not_count(watch, clock):
    """Kernels may take long to compile."""
    clock.now += 60.0
    watch.begin()
    assert watch.judge(10.0).level == WARN


def test_who_is_paused_misses_nothing(watch, clock):
    clock.now += 100.0
    assert watch.judge(10.0, paused=True) == (OK, 'paused')
    assert watch.judge(10.0).level == WARN

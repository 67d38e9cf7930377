import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed: no ROS tests')

from support.local_ros import Logs

from ogm_mcmc.ros.problems import MAX_REMARKS, Problems

pytestmark = [pytest.mark.ros]


class Node:
    """Something that logs."""


@pytest.fixture
def logs():
    return Logs(Node())


def problems(logs, elsewhere=None):
    node = Node()
    node.get_logger = lambda: logs
    return Problems(node, lambda: elsewhere or {})


def test_every_problem_is_counted_and_one_is_said(logs):
    several = problems(logs, {'pose_gap': 2})
    for _ in range(3):
        several.warn('scan_invalid', 'no beams')
    several.warn('pose_gap', lambda: 'too far apart', count=False)
    assert several.all() == {'scan_invalid': 3, 'pose_gap': 2}
    assert several.values() == {'dropped: pose_gap': 2, 'dropped: scan_invalid': 3}
    assert logs.of('warning') == ['no beams [scan_invalid: 1]', 'too far apart [pose_gap: 2]']


def test_what_is_new_is_new_once(logs):
    several = problems(logs)
    several.warn('scan_invalid', 'no beams')
    assert several.new() == {'scan_invalid': 1}
    assert not several.new()


def test_a_remark_is_said_once_and_many_are_not_said(logs):
    several = problems(logs)
    for k in range(3 * MAX_REMARKS):
        several.remark(f'odd {k // 2}')
    assert logs.of('warning') == [f'odd {k}' for k in range(MAX_REMARKS)]

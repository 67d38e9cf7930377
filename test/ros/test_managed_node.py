"""States of the nodes, and what may be done to a running one."""

import gc
import signal
import threading
import time
import weakref
from pathlib import Path
from types import SimpleNamespace

import pytest

pytest.importorskip('rclpy', reason='rclpy is not installed: no ROS tests')

from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger
from support.local_ros import Logs, local_node, spinning
from support.nav2_manager import LifecycleManager
from support.ros import NodeProcess, Observer

from ogm_mcmc.config.nodes import ManagedConfig
from ogm_mcmc.errors import ConfigError
from ogm_mcmc.ros.managed_node import ManagedNode
from ogm_mcmc.ros.online_mapper import OnlineMapper
from ogm_mcmc.ros.refine_server import RefineServer

pytestmark = [pytest.mark.ros]


class Small(ManagedNode):
    """Its kernels are ready when the test says so; it begins, or not, as the test says."""

    def __init__(self, fault='', **options):
        self.kernels, self.fault = threading.Event(), fault
        super().__init__('small', [ManagedConfig], frozenset(), **options)
        self.logs = Logs(self)
        self.start()

    def set_up(self):
        self.create_service(Trigger, '~/ask', lambda asked, answer: answer)

    def warm_up(self):
        self.kernels.wait(60.0)

    def begin(self):
        self.create_client(Trigger, 'somebody')
        if self.fault:
            raise ConfigError(self.fault)

    def end(self):
        pass

    tear_down = parameters_changed = end


def managed():
    return [Parameter('autostart', value=False)]


def state_of(node):
    return node._state_machine.current_state[1]


def test_an_activation_that_fails_after_the_kernels_may_be_tried_again():
    with local_node(Small, ready=False, fault='no laser', parameter_overrides=managed()) as node:
        assert node.trigger_configure() == TransitionCallbackReturn.SUCCESS
        assert node.trigger_activate() == TransitionCallbackReturn.SUCCESS
        assert state_of(node) == 'active'
        node.kernels.set()
        node.until(lambda: state_of(node) == 'inactive')
        assert node.logs.of('error') == ['not activated: no laser']
        assert not node.working
        assert node.trigger_activate() == TransitionCallbackReturn.FAILURE  # now they are ready
        assert state_of(node) == 'inactive'
        node.fault = ''
        assert node.trigger_activate() == TransitionCallbackReturn.SUCCESS
        assert node.working


def test_a_node_that_starts_by_itself_ends_where_it_cannot():
    with local_node(Small, ready=False, fault='no laser') as node:
        node.kernels.set()
        with pytest.raises(ConfigError, match='no laser'):
            node.until(lambda: False)


def test_a_node_that_cannot_start_is_gone_although_its_kernels_are_compiled(monkeypatch):
    """A signal while it starts; the thread of its kernels holds on to the node."""
    made = []

    def interrupted(node):
        made.append(node)
        observer.until(lambda: 'small' in observer.node.get_node_names(), 10.0)
        raise KeyboardInterrupt

    monkeypatch.setattr(Small, 'trigger_activate', interrupted)
    with Observer() as observer:
        with pytest.raises(KeyboardInterrupt), local_node(Small):
            pass
        observer.lets_go_of('small')
        made[0].kernels.set()


def test_a_state_that_somebody_asked_for_does_not_end_the_process():
    """Also of a node that was starting by itself, while its kernels are compiled."""
    with local_node(Small, ready=False, fault='no laser') as node:
        assert node.trigger_deactivate() == TransitionCallbackReturn.SUCCESS
        assert node.trigger_activate() == TransitionCallbackReturn.SUCCESS
        node.kernels.set()
        node.until(lambda: state_of(node) == 'inactive')
        assert node.logs.of('error') == ['not activated: no laser']


def test_refine_says_that_kernels_are_compiled_first(monkeypatch):
    kernels = threading.Event()
    monkeypatch.setattr(RefineServer, 'warm_up', lambda node: kernels.wait(60.0))
    with local_node(RefineServer, ready=False) as node:
        node.until(lambda: bool(node.compiling))
        answer = node.on_refine(Trigger.Request(), Trigger.Response())
        kernels.set()
    assert not answer.success
    assert answer.message.startswith('loading or compiling kernels, ')
    assert answer.message.endswith('scans are taken after that')


def test_a_transition_that_does_not_fit_is_refused_with_those_that_do():
    with local_node(Small, ready=False, parameter_overrides=managed()) as node:
        node.kernels.set()
        for asked, expected in (
            (Transition(id=Transition.TRANSITION_ACTIVATE), 'no transition 3 from unconfigured'),
            (Transition(label='fly'), 'no transition fly from unconfigured'),
        ):
            request = ChangeState.Request(transition=asked)
            assert not node._on_change_state(request, ChangeState.Response()).success
            (said,) = node.logs.of('warning')
            assert said == f'~/change_state: {expected}: expected configure (1), shutdown (5)'
            node.logs.said.clear()
        request = ChangeState.Request(transition=Transition(label='configure'))
        assert node._on_change_state(request, ChangeState.Response()).success


def test_what_the_active_node_made_is_gone_when_it_is_not():
    with local_node(Small, ready=False, parameter_overrides=managed()) as node:
        node.kernels.set()
        node.trigger_configure()
        node.until(lambda: not node.compiling and node._warming is None)
        for _ in range(3):
            node.trigger_activate()
            assert len(list(node.clients)) == 1
            node.trigger_deactivate()
            assert not list(node.clients)
        node.trigger_cleanup()
        assert not any(one.srv_name == '/small/ask' for one in node.services)


@pytest.mark.parametrize(
    ('make', 'held'),
    [
        (OnlineMapper, ('intake', 'pipeline', 'kept', 'trajectory')),
        (RefineServer, ('intake', 'odometry', 'recording', 'orders', 'collisions', 'worker')),
    ],
)
def test_what_was_taken_in_is_let_go_by_a_cleanup(monkeypatch, make, held):
    monkeypatch.setattr(make, 'warm_up', lambda node: None)
    options = [Parameter('keep_scans', value=True)] if make is OnlineMapper else []
    with local_node(make, parameter_overrides=options) as node:
        node.trigger_deactivate()
        known = [weakref.ref(getattr(node, name)) for name in held]
        assert node.trigger_cleanup() == TransitionCallbackReturn.SUCCESS
        gc.collect()
        left = [name for name, one in zip(held, known, strict=True) if one() is not None]
        assert left == []
        node.trigger_configure()
        node.trigger_activate()
        node.until(lambda: node.working)


def test_nav2s_manager_leads_both_nodes_through_their_states(monkeypatch):
    """By a stand-in that does as its published code does: see `support.nav2_manager`."""
    for make in (OnlineMapper, RefineServer):
        monkeypatch.setattr(make, 'warm_up', lambda node: None)
    names = ('online_mapper', 'refine_server')
    options = {'ready': False, 'parameter_overrides': managed()}
    with (
        local_node(OnlineMapper, **options) as mapper,
        local_node(RefineServer, **options) as server,
        Observer() as observer,
        spinning(mapper, server),
    ):
        manager = LifecycleManager(observer, names)

        def states():
            return [state_of(node) for node in (mapper, server)]

        for command, state in (
            (manager.startup, 'active'),
            (manager.pause, 'inactive'),
            (manager.resume, 'active'),
            (manager.reset, 'unconfigured'),
            (manager.startup, 'active'),
            (manager.shutdown, 'finalized'),
        ):
            assert command(), (command.__name__, states())
            assert states() == [state, state]
        assert not manager.startup()


def test_two_nodes_of_one_name_warn():
    """Here: two in this process, of a name of their own."""
    name = ['--ros-args', '-r', '__node:=twin']
    with (
        local_node(OnlineMapper, cli_args=name) as first,
        local_node(OnlineMapper, cli_args=name) as second,
    ):
        said = []
        first.get_logger = lambda: SimpleNamespace(warning=said.append, info=print, error=print)
        first.until(lambda: bool(said), 20.0)
        assert '1 more node named /twin' in said[0]
        assert second.working


@pytest.mark.skipif(not Path('/proc/self/status').exists(), reason='looks into /proc')
@pytest.mark.parametrize('how', [signal.SIGINT, signal.SIGTERM])
def test_a_signal_while_the_node_starts_ends_it_quietly(how):
    """While modules are imported, and while kernels are compiled."""
    for seconds in (0.0, 0.5, 1.4):
        with NodeProcess('online_mapper') as node:
            node.until_it_handles(signal.SIGTERM)  # that comes after SIGINT
            time.sleep(seconds)
            assert node.stop(how) == 0, node.output
        assert 'Traceback' not in node.output

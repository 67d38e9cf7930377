"""What the mapping nodes share: states, parameters, kernels that are compiled beside the rest.

    unconfigured --configure--> inactive --activate--> active
         ^---------cleanup---------|  ^-----deactivate-----|

With `autostart` (the default) a node takes itself to `active`, so that `ros2 run` is enough.
Without it, it waits for `~/change_state`: Nav2's lifecycle manager, `ros2 lifecycle set`, and is
bonded while it is active, where the messages of bond are installed.

Kernels are compiled in a thread from configure on. Services answer meanwhile; scans are
subscribed to as soon as the node is active and the kernels are there.
"""

from __future__ import annotations

import threading
import time
from abc import abstractmethod
from collections.abc import Callable, Iterable
from typing import Any

from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock, ClockType
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.timer import Timer

from ogm_mcmc.config.nodes import ManagedConfig
from ogm_mcmc.engine.compiling import uncollected
from ogm_mcmc.errors import OgmError
from ogm_mcmc.ros.bond import Bond
from ogm_mcmc.ros.parameters import ParameterSet
from ogm_mcmc.ros.python_log import PythonLog

__all__ = ['ManagedNode']

LOOK_EVERY_S = 0.1
SAY_EVERY_S = 5.0
NAMES_EVERY_S = 3.0

SUCCESS, FAILURE = TransitionCallbackReturn.SUCCESS, TransitionCallbackReturn.FAILURE


class ManagedNode(LifecycleNode):
    """A node with states.

    A subclass has `set_up` (make everything; raises OgmError), `warm_up` (compile kernels, in a
    thread), `begin` and `end` (subscribe, and stop work), `tear_down` (forget what was mapped),
    `parameters_changed`, and calls `start` when it is made. Topics, services and timers that
    `begin` makes are gone after `end`, those of `set_up` after `tear_down`, without its doing.
    """

    def __init__(
        self,
        name: str,
        configs: Iterable[type],
        live: frozenset[str],
        agree: Callable[[dict[str, Any]], None] = lambda values: None,
        **node_options: Any,
    ) -> None:
        super().__init__(name, **node_options)
        self.parameters = ParameterSet(self, configs, live, agree)
        self.configured = False
        self.active = False  # asked to work
        self.working = False  # active, and the kernels are there
        self.compiling = ''  # what to say of kernels that are not there yet
        self.steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._failure: OgmError | None = None
        self._starting = False  # by itself, until it works or somebody asks for a state
        self._warming: _Warming | None = None
        self._bond = Bond(self)
        self._python_log = PythonLog(self)
        self._python_log.begin()
        # rclpy raises, and the node ends, when somebody asks for a transition that does not fit.
        self._change_state = self._service_change_state.callback
        self._service_change_state.callback = self._on_change_state
        self.create_timer(NAMES_EVERY_S, self._look_for_namesakes, clock=self.steady)
        self._lasting = self._entities()
        self._idle: set[Any] = set()
        self._namesakes = 0
        self.add_on_set_parameters_callback(self.check_parameters)
        self.add_post_set_parameters_callback(self._on_parameters_set)

    @abstractmethod
    def set_up(self) -> None:
        """Read the parameters and make what the node needs; raises OgmError."""

    @abstractmethod
    def warm_up(self) -> None:
        """Compile the kernels; runs in a thread."""

    @abstractmethod
    def begin(self) -> None:
        """Subscribe and work."""

    @abstractmethod
    def end(self) -> None:
        """Stop work; topics that `begin` subscribed to are left afterwards."""

    @abstractmethod
    def tear_down(self) -> None:
        """Forget what was mapped and recorded."""

    @abstractmethod
    def parameters_changed(self) -> None:
        """Take over what may change while the node runs."""

    def start(self) -> None:
        """Go to `active`, unless somebody else shall see to it; raises OgmError."""
        if not self.parameters.read(ManagedConfig).autostart:
            self.get_logger().info('waits for ~/change_state (autostart is false)')
            return
        self._starting = True
        try:
            for trigger in (self.trigger_configure, self.trigger_activate):
                if trigger() != SUCCESS:
                    raise self._failure or OgmError(f'{self.get_name()}: cannot start')
        except BaseException:
            self.destroy_node()  # nobody else has it yet, and threads may hold on to it
            raise

    def destroy_node(self) -> None:
        """Leave the ROS graph: rclpy destroys all but the state machine, which holds the node."""
        self._bond.end()
        self._python_log.end()
        super().destroy_node()
        # Not by `destroy_when_not_in_use`: one that is asked for its state after that crashes.
        self.__dict__.pop('_state_machine', None)

    # -- states -----------------------------------------------------------------------------

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Set up, and begin to compile."""
        try:
            self.set_up()
        except OgmError as error:
            self._failure = error
            self.get_logger().error(f'not configured: {error}')
            self._destroy_since(self._lasting)
            return FAILURE
        self.configured = True
        self._warming = _Warming(self.warm_up)
        self.create_timer(LOOK_EVERY_S, self._look_after_kernels, clock=self.steady)
        return SUCCESS

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Work from now on, or as soon as the kernels are compiled."""
        self.active = True
        try:
            self._begin_if_ready()
        except OgmError as error:
            self._not_activated(error)
            return FAILURE
        if not self.parameters.read(ManagedConfig).autostart:
            self._bond.begin()
        return SUCCESS

    def _not_activated(self, error: OgmError) -> None:
        self._failure = error
        self.get_logger().error(f'not activated: {error}')
        self.active = False
        self._end()

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Pause: no scans, no maps; what was mapped stays."""
        self.active = self._starting = False
        self._end()
        return SUCCESS

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Forget everything but the parameters."""
        self._starting = False
        self._tear_down()
        return SUCCESS

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop work and leave all topics; the process is ended by a signal."""
        self.active = self._starting = False
        self._end()
        self._tear_down()
        return SUCCESS

    def _on_change_state(
        self, request: ChangeState.Request, response: ChangeState.Response
    ) -> ChangeState.Response:
        misfit = self._misfit(request.transition)
        if misfit:
            self.get_logger().warning(misfit)
            response.success = False
            return response
        return self._change_state(request, response)

    def _misfit(self, asked: Transition) -> str:
        """Return why a transition cannot be made now; empty if it can."""
        there = {label: n for n, label, *_ in self._state_machine.available_transitions}
        if asked.label in there or (not asked.label and asked.id in there.values()):
            return ''
        expected = ', '.join(f'{label} ({n})' for label, n in there.items()) or 'none'
        return (
            f'~/change_state: no transition {asked.label or asked.id} from '
            f'{self._state_machine.current_state[1]}: expected {expected}'
        )

    def _begin_if_ready(self) -> None:
        if self.active and not self.working and self._warming is None:
            self._idle = self._entities()
            self.working = True
            self.begin()
            self._starting = False

    def _end(self) -> None:
        self._bond.end()
        if self.working:
            self.working = False
            self.end()
            self._destroy_since(self._idle)

    def _tear_down(self) -> None:
        if self.configured:
            self.configured = False
            self._warming, self.compiling = None, ''
            self.tear_down()
            self._destroy_since(self._lasting)

    def _look_for_namesakes(self) -> None:
        """Warn when another node of this name comes: services of either answer for both."""
        own = (self.get_name(), self.get_namespace())
        others = self.get_node_names_and_namespaces().count(own) - 1
        if others > self._namesakes:
            self.get_logger().warning(
                f'{others} more node{"s"[: others > 1]} named {self.get_fully_qualified_name()}: '
                'their services and parameters cannot be told apart; expected another name '
                '(-r __node:=NAME) or namespace (-r __ns:=/NAME)'
            )
        self._namesakes = others

    # -- kernels ----------------------------------------------------------------------------

    def _look_after_kernels(self) -> None:
        if self._warming is None:
            return
        seconds, failure = self._warming.seconds, self._warming.failure
        if failure is not None:
            raise failure
        if not self._warming.done:
            self.compiling = f'loading or compiling kernels, {seconds:.0f} s'
            if self._warming.time_to_say():
                self.get_logger().info(f'{self.compiling} (kept for the next start)')
            return
        self._warming, self.compiling = None, ''
        self.get_logger().info(f'kernels ready after {seconds:.2f} s')
        try:
            self._begin_if_ready()
        except OgmError as error:
            if self._starting:
                raise  # as where the kernels were ready at once: the process ends with one line
            # Activation was answered long ago: the state says that it failed after all.
            self._not_activated(error)
            self.trigger_deactivate()

    # -- parameters -------------------------------------------------------------------------

    def set_parameters_atomically(self, parameter_list: list[Parameter]) -> SetParametersResult:
        """As for any node, but an equal value is no change, even of a fixed parameter."""
        changes = [one for one in parameter_list if not self._is_value_of(one)]
        if not changes:
            return SetParametersResult(successful=True)
        refused = self.parameters.refused(changes)
        return refused or super().set_parameters_atomically(changes)

    def _is_value_of(self, parameter: Parameter) -> bool:
        if not self.has_parameter(parameter.name):
            return False
        held = self.get_parameter(parameter.name)
        return bool(held.type_ == parameter.type_ and held.value == parameter.value)

    def check_parameters(self, changes: list[Parameter]) -> SetParametersResult:
        """Judge a change at run time."""
        return self.parameters.check(changes)

    def _on_parameters_set(self, _: list[Parameter]) -> None:
        if self.configured:  # otherwise they are read when it is
            self.parameters_changed()

    # -- topics, services, timers -----------------------------------------------------------

    def every(self, seconds: float, callback: Callable[[], None]) -> Timer:
        """Make a timer of real time: it goes on while a simulated clock stands still."""

        def due() -> None:
            if self.configured:  # one that is due may be called although it was destroyed
                callback()

        return self.create_timer(seconds, due, clock=self.steady)

    def without_latched(self, publisher: Publisher) -> Publisher:
        """Return a publisher like this one, which goes with the message it has latched.

        For kinds of messages that have no way to say "nothing".
        """
        new = self.create_publisher(publisher.msg_type, publisher.topic, publisher.qos_profile)
        for held in (self._lasting, self._idle):
            if publisher in held:
                held.remove(publisher)
                held.add(new)
        self.destroy_publisher(publisher)
        return new

    def _entities(self) -> set[Any]:
        return {
            *self.publishers,
            *self.subscriptions,
            *self.services,
            *self.clients,
            *self.timers,
        }

    def _destroy_since(self, before: set[Any]) -> None:
        """Destroy all that was made since."""
        for entities, destroy in (
            (self.subscriptions, self.destroy_subscription),
            (self.timers, self.destroy_timer),
            (self.services, self.destroy_service),
            (self.clients, self.destroy_client),
            (self.publishers, self.destroy_publisher),
        ):
            for entity in set(entities) - before:
                destroy(entity)


class _Warming:
    """A thread that compiles."""

    def __init__(self, work: Callable[[], None]) -> None:
        self._work = work
        self._began = time.monotonic()
        self._said_at = self._began
        self._took: float | None = None
        self.failure: BaseException | None = None
        threading.Thread(target=self._run, name='kernels', daemon=True).start()

    def _run(self) -> None:
        try:
            with uncollected():
                self._work()
        except BaseException as error:  # the node raises it where it is seen
            self.failure = error
        self._took = time.monotonic() - self._began

    @property
    def done(self) -> bool:
        return self._took is not None

    @property
    def seconds(self) -> float:
        """How long it took, or takes by now."""
        return time.monotonic() - self._began if self._took is None else self._took

    def time_to_say(self) -> bool:
        """Whether it is time for another line."""
        now = time.monotonic()
        if now - self._said_at < SAY_EVERY_S:
            return False
        self._said_at = now
        return True

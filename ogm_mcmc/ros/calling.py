"""Services without arguments, called from the command line: `ros2 service call` is not on PyPI."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import rclpy
from rclpy._rclpy_pybind11 import RCLError
from rclpy.context import Context
from rclpy.exceptions import InvalidServiceNameException
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.validate_full_topic_name import validate_full_topic_name
from std_srvs.srv import SetBool, Trigger

from ogm_mcmc.errors import ConfigError, OgmError, listed
from ogm_mcmc.ros.asking import ask

__all__ = ['callable_services', 'call_service']

TYPES = {'std_srvs/srv/Trigger': Trigger, 'std_srvs/srv/SetBool': SetBool}

# Discovery goes on for so long after the first service was seen: others come later.
SETTLED_S = 1.0


class _Caller:
    """A node of its own context that sees services and calls them."""

    def __init__(self, node: Node, executor: SingleThreadedExecutor) -> None:
        self.node = node
        self._executor = executor

    def seen(self) -> dict[str, str]:
        """Return the services there are, with the name of their type: one of `TYPES`, if any."""
        return {
            name: next((kind for kind in kinds if kind in TYPES), kinds[0])
            for name, kinds in self.node.get_service_names_and_types()
        }

    def offered(self) -> dict[str, str]:
        """Return the services that can be called, in order, with the name of their type."""
        return {name: kind for name, kind in sorted(self.seen().items()) if kind in TYPES}

    def spin_while(self, condition: Callable[[], bool], timeout_s: float) -> bool:
        """Handle messages while a condition holds; return False when the time ran out first."""
        deadline = time.monotonic() + timeout_s
        while condition():
            if time.monotonic() > deadline:
                return False
            self._executor.spin_once(timeout_sec=0.05)
        return True


@contextmanager
def _caller() -> Iterator[_Caller]:
    context = Context()
    rclpy.init(context=context, args=[], signal_handler_options=SignalHandlerOptions.NO)
    executor = SingleThreadedExecutor(context=context)
    node = Node('ogm_mcmc_call', context=context, start_parameter_services=False)
    executor.add_node(node)
    try:
        yield _Caller(node, executor)
    finally:
        executor.shutdown()
        node.destroy_node()
        rclpy.try_shutdown(context=context)


def callable_services(timeout_s: float) -> dict[str, str]:
    """Return the services that `call_service` can call, with their types.

    Waits until there is one, up to `timeout_s`, and `SETTLED_S` more for others.
    """
    with _caller() as caller:
        if caller.spin_while(lambda: not caller.offered(), timeout_s):
            caller.spin_while(lambda: True, min(SETTLED_S, timeout_s))
        return caller.offered()


def call_service(name: str, data: bool | None, timeout_s: float) -> str:
    """Call a Trigger, or with `data` a SetBool service, once; return what it answers.

    `name` is that of the service with its node's, such as refine_server/refine. Raises ConfigError
    for a name that none can have and a service of another type, and OgmError when there is no such
    service within `timeout_s` or no answer within as much again, and for one without success.
    """
    full = '/' + name.lstrip('/')
    try:
        validate_full_topic_name(full, is_service=True)
    except (InvalidServiceNameException, RCLError) as error:
        raise ConfigError(
            f'{name!r} is no name of a service: {" ".join(str(error).split())}'
        ) from error
    kind = 'std_srvs/srv/Trigger' if data is None else 'std_srvs/srv/SetBool'
    with _caller() as caller:
        if not caller.spin_while(lambda: full not in caller.seen(), timeout_s):
            there = listed(list(caller.offered())) or 'none at all'
            raise OgmError(
                f'no service {full} within {timeout_s:g} s; that can be called: {there}'
            )
        found = caller.seen().get(full, kind)  # it may be gone by now: then nobody answers
        if found not in TYPES:
            raise ConfigError(f'{full} is a {found}: expected {" or ".join(TYPES)}')
        if found != kind:
            wanted = 'no value' if data is not None else 'a value, true or false'
            raise ConfigError(f'{full} is a {found}: expected {wanted}')
        client = caller.node.create_client(TYPES[kind], full)
        request = TYPES[kind].Request()
        if data is not None:
            request.data = data
        # Whoever owns the service may not mean to do it twice.
        response: Any = ask(client, request, caller.spin_while, timeout_s, once=True)
    if response is None:
        raise OgmError(
            f'{full}: expected an answer within {timeout_s:g} s; it may be at work all the same'
        )
    if not response.success:
        raise OgmError(f'{full}: {response.message}')
    return str(response.message)

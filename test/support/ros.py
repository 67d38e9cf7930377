"""Help for tests with real nodes: processes that are always ended, waiting that never hangs."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Self

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from ogm_mcmc.ros.asking import ask

__all__ = ['NodeProcess', 'Observer', 'spin_until', 'takes_scans']


class NodeProcess:
    """A node of this package in a process of its own; a context manager."""

    def __init__(
        self,
        module: str,
        arguments: Sequence[str] = (),
        parameters: dict[str, Any] | None = None,
        command: Sequence[str] = (),
    ) -> None:
        ros_args = []
        for name, value in (parameters or {}).items():
            text = str(value).lower() if isinstance(value, bool) else str(value)
            ros_args += ['-p', f'{name}:={text}']
        self.command = [
            *(command or (sys.executable, '-m', 'ogm_mcmc.ros', module)),
            *arguments,
            *(['--ros-args', *ros_args] if ros_args else []),
        ]
        self.output = ''

    def __enter__(self) -> Self:
        """Start the process."""
        self.process = subprocess.Popen(
            self.command,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env=dict(os.environ),
        )
        return self

    def __exit__(self, *_: object) -> None:
        """End the process, whatever happened."""
        if self.process.poll() is None:
            self.stop()
        elif self.process.stdout is not None and not self.process.stdout.closed:
            self.wait()

    def running(self) -> bool:
        """Whether the process is still there."""
        return self.process.poll() is None

    def until_it_handles(self, how: int, timeout_s: float = 60.0) -> None:
        """Wait until the process handles a signal; before, the interpreter is not even there."""
        deadline = time.monotonic() + timeout_s
        while not handled(self.process.pid) >> (how - 1) & 1:
            if time.monotonic() > deadline or not self.running():
                raise TimeoutError(f'signal {how} is not handled')
            time.sleep(0.005)

    def wait(self, timeout_s: float = 60.0) -> int:
        """Wait for the process to end by itself; return its exit code."""
        self.output += self.process.communicate(timeout=timeout_s)[0] or ''
        return int(self.process.returncode)

    def stop(self, how: int = signal.SIGINT, timeout_s: float = 60.0) -> int:
        """Send a signal and wait; return the exit code. Kills what does not stop."""
        self.process.send_signal(how)
        try:
            return self.wait(timeout_s)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.wait()
            raise


def handled(pid: int) -> int:
    """Return the signals that a process handles, signal 1 in the lowest bit."""
    lines = Path(f'/proc/{pid}/status').read_text().splitlines()
    return next((int(line.split()[1], 16) for line in lines if line.startswith('SigCgt')), 0)


class Observer:
    """A node of the test's own that collects messages and calls services."""

    def __init__(self, name: str = 'observer') -> None:
        self.context = rclpy.context.Context()
        rclpy.init(context=self.context, args=[])
        self.node = Node(name, context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)

    def __enter__(self) -> Self:
        """Return itself; the node is already there."""
        return self

    def __exit__(self, *_: object) -> None:
        """Remove the node."""
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.try_shutdown(context=self.context)

    def collect(self, msg_type: Any, topic: str, qos: Any, *, raw: bool = False) -> list[Any]:
        """Return a list that fills with the messages of a topic (or their bytes)."""
        received: list[Any] = []
        self.node.create_subscription(msg_type, topic, received.append, qos, raw=raw)
        return received

    def until(self, condition: Callable[[], bool], timeout_s: float = 120.0) -> None:
        """Handle messages until a condition holds; raises TimeoutError."""
        spin_until(self.executor, condition, timeout_s)

    def lets_go_of(self, name: str, timeout_s: float = 5.0) -> None:
        """Wait until no node of a name is seen; raises TimeoutError.

        One whose process ends without leaving the graph is seen for 20 s.
        """
        self.until(lambda: name not in self.node.get_node_names(), timeout_s)

    def call(self, srv_type: Any, name: str, request: Any, timeout_s: float = 120.0) -> Any:
        """Call a service and return its response."""
        client = self.node.create_client(srv_type, name)
        response = ask(client, request, self.spin_while, timeout_s)
        self.node.destroy_client(client)
        if response is None:
            raise TimeoutError(f'{name} did not answer within {timeout_s} s')
        return response

    def spin_while(self, condition: Callable[[], bool], timeout_s: float) -> bool:
        """Handle messages while a condition holds; return False when the time ran out first."""
        try:
            spin_until(self.executor, lambda: not condition(), timeout_s)
        except TimeoutError:
            return False
        return True


def takes_scans(reports: Sequence[Any]) -> bool:
    """Whether the diagnostics of a node say that it has compiled its kernels and subscribed."""
    values = reports[-1].status[0].values if reports else ()
    return any((item.key, item.value) == ('working', 'True') for item in values)


def spin_until(
    executor: SingleThreadedExecutor, condition: Callable[[], bool], timeout_s: float
) -> None:
    """Spin until a condition holds; raises TimeoutError."""
    deadline = time.monotonic() + timeout_s
    while not condition():
        if time.monotonic() > deadline:
            raise TimeoutError(f'not within {timeout_s} s')
        executor.spin_once(timeout_sec=0.05)

"""The user's side of the demo: waits for the mapper, watches its map, asks it to save."""

from __future__ import annotations

import time
from collections.abc import Callable
from types import TracebackType
from typing import Any, Self

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import OccupancyGrid
from rclpy.executors import ExternalShutdownException
from std_srvs.srv import Trigger

from ogm_mcmc.errors import OgmError, OutputError
from ogm_mcmc.ros.asking import ask
from ogm_mcmc.ros.qos import LATCHED

__all__ = ['DemoClient']

# The mapper publishes what changed once a second: no map for longer means that it was the last.
SETTLED_S = 1.5


class DemoClient:
    """A node that listens to one mapper; a context manager around rclpy's life."""

    def __init__(self, namespace: str) -> None:
        self.namespace = namespace
        self.maps = 0
        self.started = time.monotonic()
        self.first_map_s: float | None = None
        self.last_map: OccupancyGrid | None = None
        self.last_map_at = 0.0
        self.diagnostics: dict[str, str] = {}

    def __enter__(self) -> Self:
        """Start the node."""
        rclpy.init(args=[])
        self.node = rclpy.create_node('demo', namespace=self.namespace)
        self.node.create_subscription(OccupancyGrid, 'map', self._on_map, LATCHED)
        self.node.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics, 10)
        self.saver = self.node.create_client(Trigger, 'online_mapper/save_map')
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Stop the node."""
        self.node.destroy_node()
        rclpy.try_shutdown()

    def _on_map(self, msg: OccupancyGrid) -> None:
        self.maps += 1
        self.last_map = msg
        self.last_map_at = time.monotonic()
        if self.first_map_s is None:
            self.first_map_s = time.monotonic() - self.started

    def _on_diagnostics(self, msg: DiagnosticArray) -> None:
        for status in msg.status:
            if status.name == f'{self.namespace}/online_mapper: mapping':
                self.diagnostics = {item.key: item.value for item in status.values}

    def spin_while(self, condition: Callable[[], bool], timeout_s: float = float('inf')) -> bool:
        """Handle messages while a condition holds; return False when the time ran out first."""
        deadline = time.monotonic() + timeout_s
        while condition():
            if time.monotonic() > deadline:
                return False
            try:
                rclpy.spin_once(self.node, timeout_sec=0.05)
            except ExternalShutdownException:
                raise KeyboardInterrupt from None  # SIGTERM: leave as on Ctrl-C
        return True

    def wait_for_mapper(self, timeout_s: float, alive: Callable[[], bool]) -> None:
        """Wait until the mapper offers its services; the clock of "first map" starts then."""
        ready = self.spin_while(lambda: alive() and not self.saver.service_is_ready(), timeout_s)
        if not ready or not alive():
            raise OgmError('online_mapper did not start: expected its services to appear')
        self.started = time.monotonic()

    def save_map(self, timeout_s: float) -> str:
        """Ask the mapper to save; return the path of the YAML file."""
        response = ask(self.saver, Trigger.Request(), self.spin_while, timeout_s)
        if response is None:
            raise OgmError('online_mapper did not answer ~/save_map')
        if not response.success:
            raise OutputError(f'online_mapper: {response.message}')
        return str(response.message)

    def wait_for_map(self, timeout_s: float) -> None:
        """Wait for the final map and for diagnostics that were sent after the last scan."""
        seen = self.diagnostics
        called = time.monotonic()

        def unsettled() -> bool:
            quiet = time.monotonic() - max(called, self.last_map_at)
            return self.maps == 0 or self.diagnostics is seen or quiet < SETTLED_S

        if not self.spin_while(unsettled, timeout_s):
            raise OgmError('no map arrived on `map`: expected one from online_mapper')

    def report(self) -> dict[str, Any]:
        """Return what was seen of the mapper."""
        assert self.last_map is not None
        dropped = sum(
            int(value) for key, value in self.diagnostics.items() if key.startswith('dropped')
        )
        return {
            'maps_received': self.maps,
            'first_map_s': self.first_map_s,
            'width': self.last_map.info.width,
            'height': self.last_map.info.height,
            'scans_received': int(self.diagnostics['scans received']),
            'scans_used': int(self.diagnostics['scans used']),
            'dropped': dropped,
            'mapping_ms_per_scan': float(self.diagnostics['mapping time per scan (ms)']),
        }

"""The user's side of the demo: waits for the nodes, watches them, has maps refined and saved."""

from __future__ import annotations

import time
from collections.abc import Callable
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

MAPPER, REFINER = 'online_mapper: mapping', 'refine_server: refining'

# The mapper publishes what changed once a second: no map for longer means that it was the last.
SETTLED_S = 1.5


class DemoClient:
    """A node that listens to a mapper and a refiner; a context manager around rclpy's life."""

    def __init__(self, namespace: str) -> None:
        self.namespace = namespace
        self.maps = 0
        self.started = time.monotonic()
        self.first_map_s: float | None = None
        self.last_map: OccupancyGrid | None = None
        self.last_map_at = 0.0
        self.reports: dict[str, dict[str, str]] = {MAPPER: {}, REFINER: {}}

    def __enter__(self) -> Self:
        """Start the node."""
        rclpy.init(args=[])
        self.node = rclpy.create_node('demo', namespace=self.namespace)
        self.node.create_subscription(OccupancyGrid, 'map', self._on_map, LATCHED)
        self.node.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics, 10)
        self.services = {
            name: self.node.create_client(Trigger, name)
            for name in (
                'online_mapper/save_map',
                'refine_server/refine',
                'refine_server/save_map',
            )
        }
        return self

    def __exit__(self, *_: object) -> None:
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
            name = status.name.lstrip('/').removeprefix(f'{self.namespace.lstrip("/")}/')
            if name in self.reports:
                self.reports[name] = {item.key: item.value for item in status.values}

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

    def wait_for_nodes(self, timeout_s: float, alive: Callable[[], bool]) -> None:
        """Wait until both nodes take scans; the clock of "first map" starts then."""

        def missing() -> list[str]:
            return [name for name, c in self.services.items() if not c.service_is_ready()]

        self.spin_while(lambda: alive() and bool(missing()), timeout_s)
        if not alive():
            raise OgmError('a node ended while starting: expected it to wait for scans')
        if missing():
            nodes = sorted({name.partition('/')[0] for name in missing()})
            raise OgmError(f'{" and ".join(nodes)}: expected the services to appear')

        def compiling() -> bool:
            return any(report.get('working') != 'True' for report in self.reports.values())

        if not self.spin_while(lambda: alive() and compiling(), timeout_s):
            raise OgmError(f'expected the nodes to have compiled their kernels in {timeout_s:g} s')
        self.started = time.monotonic()

    def call(self, name: str, timeout_s: float) -> str:
        """Call a Trigger service and return its message; raises OutputError if it refuses."""
        response = ask(self.services[name], Trigger.Request(), self.spin_while, timeout_s)
        if response is None:
            raise OgmError(f'{name}: expected an answer within {timeout_s:g} s')
        if not response.success:
            raise OutputError(f'{name}: {response.message}')
        return str(response.message)

    def refine(
        self, timeout_s: float, alive: Callable[[], bool], seen: Callable[[dict[str, str]], None]
    ) -> dict[str, str]:
        """Have the recorded scans sampled and wait for the end; return the last diagnostics.

        `seen` is given the diagnostics as they come.
        """
        self._wait_for_report(REFINER, timeout_s)
        before = self.reports[REFINER].get('sweeps')
        self.call('refine_server/refine', timeout_s)
        last: list[dict[str, str]] = [{}]

        def running() -> bool:
            report = self.reports[REFINER]
            if report is not last[0]:
                last[0] = report
                seen(report)
            ended = report['stopped because'] if report['state'] == 'idle' else ''
            # The report of an earlier call has the sweeps of then.
            return alive() and not (ended == 'error' or (ended and report['sweeps'] != before))

        if not self.spin_while(running, timeout_s):
            raise OgmError(f'refine_server: expected it to be done within {timeout_s:g} s')
        report = self.reports[REFINER]
        if report['stopped because'] == 'error':
            raise OgmError(f'refine_server: {report["last error"]}')
        return report

    def _wait_for_report(self, name: str, timeout_s: float) -> None:
        """Wait for diagnostics that were sent after now and know of no scan that waits."""
        seen = self.reports[name]

        def old() -> bool:
            report = self.reports[name]
            return report is seen or report['scans waiting'] != '0'

        if not self.spin_while(old, timeout_s):
            raise OgmError(f'{name}: expected diagnostics, and no scan that waits for a pose')

    def settled(self) -> Callable[[], bool]:
        """Return what tells whether the mapper's last map, and diagnostics sent after now, came.

        Called when the last scan is mapped: refining need not wait for it.
        """
        seen = self.reports[MAPPER]
        called = time.monotonic()

        def settled() -> bool:
            quiet = time.monotonic() - max(called, self.last_map_at)
            return self.maps > 0 and self.reports[MAPPER] is not seen and quiet >= SETTLED_S

        return settled

    def wait_for_map(self, settled: Callable[[], bool], timeout_s: float) -> None:
        """Wait until the mapper's last map is there, see `settled`."""
        if not self.spin_while(lambda: not settled(), timeout_s):
            raise OgmError('no map arrived on `map`: expected one from online_mapper')

    def report(self) -> dict[str, Any]:
        """Return what was seen of the mapper."""
        assert self.last_map is not None
        mapper = self.reports[MAPPER]
        dropped = sum(int(value) for key, value in mapper.items() if key.startswith('dropped'))
        return {
            'maps_received': self.maps,
            'first_map_s': self.first_map_s,
            'width': self.last_map.info.width,
            'height': self.last_map.info.height,
            'scans_received': int(mapper['scans received']),
            'scans_used': int(mapper['scans used']),
            'dropped': dropped,
            'mapping_ms_per_scan': float(mapper['mapping time per scan (ms)']),
        }

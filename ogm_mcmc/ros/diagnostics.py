"""What a node says about itself on /diagnostics."""

from __future__ import annotations

from collections.abc import Mapping

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

__all__ = ['DIAGNOSTICS_S', 'Diagnostics']

DIAGNOSTICS_S = 1.0


class Diagnostics:
    """Publishes one status of a node: `<node>: <task>`."""

    def __init__(self, node: Node, task: str) -> None:
        self.node = node
        self.task = task
        self.publisher = node.create_publisher(DiagnosticArray, '/diagnostics', 10)

    def publish(self, message: str, values: Mapping[str, object], *, warn: bool) -> None:
        """Send a line for people and the values behind it; `warn` when something is new."""
        status = DiagnosticStatus(
            level=DiagnosticStatus.WARN if warn else DiagnosticStatus.OK,
            name=f'{self.node.get_fully_qualified_name()}: {self.task}',
            message=message,
            hardware_id='none',
            values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
        )
        report = DiagnosticArray(status=[status])
        report.header.stamp = self.node.get_clock().now().to_msg()
        self.publisher.publish(report)

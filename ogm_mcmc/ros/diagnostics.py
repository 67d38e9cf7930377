"""What a node says about itself on /diagnostics."""

from __future__ import annotations

from collections.abc import Mapping

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

from ogm_mcmc.ros.intake_health import WELL, Health

__all__ = ['DIAGNOSTICS_S', 'Diagnostics']

DIAGNOSTICS_S = 1.0


class Diagnostics:
    """Publishes one status of a node: `<node>: <task>`, like `ns/online_mapper: mapping`."""

    def __init__(self, node: Node, task: str) -> None:
        self.node = node
        self.task = task
        self.publisher = node.create_publisher(DiagnosticArray, '/diagnostics', 10)

    def publish(
        self, message: str, values: Mapping[str, object], *, warn: bool, health: Health = WELL
    ) -> None:
        """Send a line for people and the values behind it.

        `warn` when something is new; `health` says whether what is needed comes in.
        """
        level = max(health.level, DiagnosticStatus.WARN if warn else DiagnosticStatus.OK)
        status = DiagnosticStatus(
            level=level,
            # As diagnostic_updater has it: no slash in front.
            name=f'{self.node.get_fully_qualified_name().lstrip("/")}: {self.task}',
            message='; '.join(filter(None, (health.message, message))),
            hardware_id='none',
            values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
        )
        report = DiagnosticArray(status=[status])
        report.header.stamp = self.node.get_clock().now().to_msg()
        self.publisher.publish(report)

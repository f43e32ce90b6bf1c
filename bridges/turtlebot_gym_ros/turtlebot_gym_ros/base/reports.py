"""Reports of nodes, in ``/diagnostics`` and in the log."""

from __future__ import annotations

from collections.abc import Mapping

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR


def report(node: Node, level: bytes, text: str, *, hardware: str, values: Mapping[str, object]) -> DiagnosticArray:
    """Return a node's diagnostics of this moment.

    Args:
        node: The node.
        level: `OK`, `WARN` or `ERROR`.
        text: One line.
        hardware: Name of the robot.
        values: Figures by name.
    """
    pairs = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
    name = node.get_fully_qualified_name()
    message = DiagnosticArray(
        status=[DiagnosticStatus(level=level, name=name, message=text, hardware_id=hardware, values=pairs)]
    )
    message.header.stamp = node.get_clock().now().to_msg()
    return message


def log(node: Node, level: bytes, text: str) -> None:
    """Log a report by its level."""
    # On separate lines: rclpy's logger raises if the severity of a line changes.
    if level == OK:
        node.get_logger().info(text)
    elif level == WARN:
        node.get_logger().warning(text)
    else:
        node.get_logger().error(text)

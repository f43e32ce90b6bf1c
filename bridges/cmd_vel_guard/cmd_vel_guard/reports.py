"""Reports of a node, in ``/diagnostics`` and in the log; errors that messages cause are counted and end nothing."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any
from weakref import WeakKeyDictionary

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR
_NUMBER, _LAST = "callbacks that failed", "last one"
_FAILED: WeakKeyDictionary[Node, dict[str, Any]] = WeakKeyDictionary()


def note(node: Node, name: str, error: BaseException) -> None:
    """Count what the callback of a topic or service raised: it ends no node, and the node's next report names it."""
    failed = _FAILED.setdefault(node, {})
    failed[_NUMBER] = failed.get(_NUMBER, 0) + 1
    if _LAST not in failed:
        failed[_LAST] = f"{name}: refused: {type(error).__name__}: {' '.join(str(error).split())[:200]}"
        node.get_logger().error(failed[_LAST])


def sturdy(node: Node, name: str, serve: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
    """Return a service's callback that gives an empty answer if it fails."""

    def served(request: Any, response: Any) -> Any:
        try:
            return serve(request, response)
        except Exception as error:
            note(node, name, error)
            return type(response)()

    return served


def report(node: Node, level: bytes, text: str, *, hardware: str, values: Mapping[str, object]) -> DiagnosticArray:
    """Return a node's diagnostics of this moment: its level, one line, and figures by name; ``hardware`` names the robot."""
    failed = _FAILED.get(node, {})
    values = {**values, **failed}
    if last := failed.pop(_LAST, None):
        level, text = max(level, WARN), f"{text} {last}"
    pairs = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
    status = DiagnosticStatus(
        level=level, name=node.get_fully_qualified_name(), message=text, hardware_id=hardware, values=pairs
    )
    message = DiagnosticArray(status=[status])
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

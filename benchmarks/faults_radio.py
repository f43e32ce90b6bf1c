"""A ROS node whose radio can be cut: what it sends meanwhile is lost, as on a bad link."""

from __future__ import annotations

import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any


class Radio:
    """A node in a DDS participant of its own, so that the rest of its process is heard while it is cut.

    Fast DDS sends from sockets of their own. While it is cut they are replaced by one that leads nowhere.

    Args:
        domain: Its ROS domain.
    """

    def __init__(self, domain: int) -> None:
        import rclpy.node
        from rclpy.context import Context

        self.context, before = Context(), _sockets()
        self.context.init([], domain_id=domain)
        self.node: Any = rclpy.node.Node("radio", context=self.context)
        hears = range(7400 + 250 * domain, 7650 + 250 * domain)  # the ports of a domain
        self._senders = [at for at, port in _sockets().items() if at not in before and port not in hears]

    @contextmanager
    def cut(self) -> Iterator[None]:
        """Lose what it sends."""
        kept = {at: os.dup(at) for at in self._senders}
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as nowhere:
            for at in kept:
                os.dup2(nowhere.fileno(), at)
        try:
            yield
        finally:
            for at, sender in kept.items():
                os.dup2(sender, at)
                os.close(sender)

    def close(self) -> None:
        """End the node."""
        self.node.destroy_node()
        self.context.shutdown()


def _sockets() -> dict[int, int]:
    """Return the ports of this process's UDP sockets by their file descriptors."""
    sockets = {}
    for path in Path("/proc/self/fd").iterdir():
        try:
            with socket.socket(fileno=os.dup(int(path.name))) as connection:
                if (connection.family, connection.type) == (socket.AF_INET, socket.SOCK_DGRAM):
                    sockets[int(path.name)] = connection.getsockname()[1]
        except OSError:  # not a socket, or closed meanwhile
            continue
    return sockets

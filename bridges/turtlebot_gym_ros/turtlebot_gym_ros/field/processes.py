"""Nodes of this package in processes of their own, for as long as a field test needs them."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

LAST_WORD = 10.0
"""Time in which a process must end, s."""


COMMAND = (sys.executable, "-m", "turtlebot_gym_ros")


@contextmanager
def processes(nodes: Sequence[tuple[str, dict[str, Any]]]) -> Iterator[None]:
    """Run nodes of this package in processes of their own, with parameters."""
    started: list[subprocess.Popen[bytes]] = []
    try:
        for name, parameters in nodes:
            given = [word for key, value in parameters.items() for word in ("-p", f"{key}:={_ros(value)}")]
            started.append(subprocess.Popen([*COMMAND, name, "--ros-args", "--log-level", "error", *given]))
        yield
    finally:
        for process in started:
            process.terminate()
        for process in started:
            try:
                process.wait(LAST_WORD)
            except subprocess.TimeoutExpired:
                process.kill()


def _ros(value: Any) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)

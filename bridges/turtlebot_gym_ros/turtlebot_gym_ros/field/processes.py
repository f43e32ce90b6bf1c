"""Nodes of this package in processes of their own, for as long as a field test needs them."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from turtlebot_gym_ros.base.parameters import words_of

LAST_WORD = 10.0
"""Time in which a process must end, s."""


COMMAND = (sys.executable, "-m", "turtlebot_gym_ros")


@contextmanager
def processes(nodes: Sequence[tuple[str, dict[str, Any]]]) -> Iterator[None]:
    """Run nodes of this package in processes of their own, with parameters."""
    started: list[subprocess.Popen[bytes]] = []
    try:
        for name, parameters in nodes:
            arguments = ["--ros-args", "--log-level", "error", *words_of(parameters)]
            started.append(subprocess.Popen([*COMMAND, name, *arguments]))
        yield
    finally:
        for process in started:
            process.terminate()
        for process in started:
            try:
                process.wait(LAST_WORD)
            except subprocess.TimeoutExpired:
                process.kill()

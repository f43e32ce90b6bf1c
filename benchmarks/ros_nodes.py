"""Nodes of the live graph as processes."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any


class Nodes:
    """Processes by the names of their nodes; none outlives this one.

    Args:
        folder: Where they run and write NAME.log.
        remappings: Remappings by node.
        words: Further arguments of every node.
        environment: Variables that differ.
    """

    def __init__(self, folder: Path, remappings: dict[str, list[str]], *words: str, **environment: str) -> None:
        self._folder, self._remappings, self._words = folder, remappings, words
        self._environment = {**os.environ, **environment}
        self._processes: dict[str, subprocess.Popen[bytes]] = {}
        self._parameters: dict[str, dict[str, Any]] = {}

    def start(self, name: str, **parameters: Any) -> None:
        """Start a node; a killed one is restarted with its previous parameters."""
        if name in self._processes:
            self._processes[name].wait()
        given = self._parameters.setdefault(name, parameters)
        words = [*self._words, *(word for key, value in given.items() for word in ("-p", f"{key}:={value}"))]
        program = ["setpriv", "--pdeathsig", "KILL", sys.executable, "-m", "turtlebot_gym_ros", name, "--ros-args"]
        with (self._folder / f"{name}.log").open("ab") as log:
            self._processes[name] = subprocess.Popen(
                [*program, *words, *self._remappings.get(name, [])],
                cwd=self._folder, env=self._environment, stdout=log, stderr=log,
            )  # fmt: skip

    def __iter__(self) -> Iterator[str]:
        return iter(self._processes)

    def signal(self, name: str, number: int) -> None:
        """Send a signal to a node."""
        self._processes[name].send_signal(number)

    def kill(self, name: str) -> None:
        """Kill a node, and wait for its end."""
        self._processes[name].kill()
        self._processes[name].wait()

    def has_ended(self, name: str) -> bool:
        """Return whether a node's process has ended."""
        return self._processes[name].poll() is not None

    @contextmanager
    def suspended(self, name: str) -> Iterator[None]:
        """Suspend a node."""
        self.signal(name, signal.SIGSTOP)
        try:
            yield
        finally:
            self.signal(name, signal.SIGCONT)

    def cpu(self, name: str) -> float:
        """Return the processor time that a node has used, s."""
        stat = Path(f"/proc/{self._processes[name].pid}/stat").read_text().rpartition(")")[2].split()
        return (int(stat[11]) + int(stat[12])) / os.sysconf("SC_CLK_TCK")  # utime and stime, proc(5)

    def memory(self, name: str) -> int:
        """Return the resident memory of a node, kB."""
        status = Path(f"/proc/{self._processes[name].pid}/status").read_text()
        return next(int(line.split()[1]) for line in status.splitlines() if line.startswith("VmRSS:"))

    def close(self) -> None:
        """End all processes."""
        for process in self._processes.values():
            if process.poll() is None:
                process.send_signal(signal.SIGCONT)
                process.terminate()
        for process in self._processes.values():
            try:
                process.wait(10)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()

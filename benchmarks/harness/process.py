"""Processes of the benchmarks: their environment variables, and those that take turns."""

from __future__ import annotations

import json
import os
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from harness.turns import Turn

HERE = Path(__file__).parents[2]
PACKAGES = (".", "agents", "bridges/turtlebot_gym_ros")
"""Folders of the repository from which its packages are imported."""


class Process:
    """Process of a peer, which waits for its turns.

    Args:
        command: Command that starts the process.
        log: File for its standard error.
        options: Passed on to `subprocess.Popen`.

    Raises:
        ChildProcessError: If the process ends before it is ready.
    """

    def __init__(self, command: Sequence[str], log: Path, **options: Any) -> None:
        self._log = log
        with log.open("w", encoding="utf-8") as errors:
            self._process = subprocess.Popen(
                command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=errors, text=True, **options
            )
        try:
            self.ready: dict[str, Any] = self._read("ready")
        except BaseException:
            self.stop()
            raise

    def turn(self, calls: int) -> Turn:
        """Make a number of calls."""
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(f"{calls}\n")
            self._process.stdin.flush()
        except BrokenPipeError:
            pass  # the process has ended, which reading detects
        return Turn(*self._read("turn"))

    def stop(self) -> None:
        """End the process."""
        self._process.kill()
        self._process.communicate()

    def _read(self, word: str) -> Any:
        """Return the rest of the line that starts with a word; libraries may print other lines."""
        assert self._process.stdout is not None
        for line in self._process.stdout:
            if line.startswith(f"{word} "):
                return json.loads(line.removeprefix(word))
        last = self._log.read_text(encoding="utf-8", errors="replace").strip().rpartition("\n")[2] or "there was no output."
        raise ChildProcessError(f"The process has ended with status {self._process.wait()}: {last}")


def environment_of(folder: Path) -> dict[str, str]:
    """Return the environment variables with which Python imports the packages in a folder, on one thread."""
    paths = os.pathsep.join(str(folder / package) for package in PACKAGES)
    one = dict.fromkeys(("TURTLEBOT_GYM_THREADS", "OMP_NUM_THREADS"), "1")
    return {**os.environ, "PYTHONPATH": paths, **one}

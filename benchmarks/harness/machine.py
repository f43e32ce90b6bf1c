"""The machine on which speed is measured, its load, and processes that a benchmark starts."""

from __future__ import annotations

import os
import platform
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path
from typing import Any

_BUSY = "import os, sys\nwhile os.getppid() == int(sys.argv[1]):\n    for _ in range(10**6): pass"
"""Program that ends by itself when the process that started it is gone."""


def machine() -> dict[str, Any]:
    """Return the description of this machine, with None for values that the system does not report."""
    from llvmlite import binding

    from turtlebot_gym.compiled.threads import Threads

    return {
        "cpu": _cpu(),
        "llvm_cpu": binding.get_host_cpu_name(),
        "cores": cores(),
        "threads": Threads.count(),
        "system": f"{platform.system()} {platform.release()}",
        "python": f"{platform.python_implementation()} {platform.python_version()}",
        **{name: version(name) for name in ("llvmlite", "numpy", "gymnasium")},
        "load_before": os.getloadavg()[0],
    }


def cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _cpu() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


class Watch:
    """Watches how much of the machine's cores is free from now on, on Linux."""

    def __init__(self) -> None:
        self._start = time.perf_counter(), _idle_seconds()

    def used_by_others(self, own: float) -> float | None:
        """Return the mean number of this process's cores that other programs kept busy; None if unknown.

        Args:
            own: CPU seconds used by this process.
        """
        wall, before, after = time.perf_counter() - self._start[0], self._start[1], _idle_seconds()
        if before is None or after is None:
            return None
        return max(0.0, cores() - (after - before + own) / wall)


def _idle_seconds() -> float | None:
    """Return the total idle time of all cores since the machine started."""
    try:
        first = Path("/proc/stat").read_text(encoding="utf-8").splitlines()[0].split()
        return (int(first[4]) + int(first[5])) / os.sysconf("SC_CLK_TCK")
    except (OSError, IndexError, ValueError):
        return None


@contextmanager
def busy(processes: int) -> Iterator[None]:
    """Keep the machine busy with a number of processes that only count."""
    started = [subprocess.Popen([sys.executable, "-I", "-c", _BUSY, str(os.getpid())]) for _ in range(processes)]
    try:
        yield
    finally:
        for process in started:
            process.kill()
        for process in started:
            process.wait()

"""The machine on which a benchmark runs, its processes, and its ROS domains."""

from __future__ import annotations

import os
import platform
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path
from typing import Any

DOMAINS, PORT = range(120, 180), 27000
"""ROS domains, above those of users and of the tests; port by which one is claimed, less its number, as in the tests."""
_BUSY = "import os, sys\nwhile os.getppid() == int(sys.argv[1]):\n    for _ in range(10**6): pass"  # ends with its parent


def machine() -> dict[str, Any]:
    """Return the description of this machine, and its load."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text(encoding="utf-8").splitlines() if info.exists() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return {
        "cpu": names[0] if names else platform.processor(),
        "cores": len(os.sched_getaffinity(0)),
        "system": f"{platform.system()} {platform.release()}",
        **{name: version(name) for name in ("llvmlite", "numpy", "gymnasium")},
        "load_before": os.getloadavg()[0],
    }


@contextmanager
def busy(processes: int) -> Iterator[None]:
    """Keep the machine busy with a number of processes that only count."""
    started = [subprocess.Popen([sys.executable, "-I", "-c", _BUSY, str(os.getpid())]) for _ in range(processes)]
    try:
        yield
    finally:
        for process in started:
            process.kill()
            process.wait()


def claimed_domain() -> tuple[int, socket.socket]:
    """Return a ROS domain that no other benchmark or test on this machine uses, until its socket is closed."""
    for domain in DOMAINS:
        claim = socket.socket()
        try:
            claim.bind(("127.0.0.1", PORT + domain))
            return domain, claim
        except OSError:
            claim.close()
    raise RuntimeError(f"All ROS domains from {DOMAINS.start} to {DOMAINS.stop - 1} are claimed on this machine.")

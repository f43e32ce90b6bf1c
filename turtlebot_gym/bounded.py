"""Calls with bounds on time and memory, each in a copy of this process: a small file may ask for any amount of either."""

from __future__ import annotations

import os
import pickle
import resource
import signal
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

SECONDS = 8
"""Most CPU time that reading a file may take, s; a file of more megabytes has a second for each."""
MEMORY = 640 * 2**20
"""Most memory by which reading a file may let a process grow, bytes."""
UNPACKED = 30
"""Size to which a file may be unpacked on the disk, as a multiple of its own, if that is more than `MEMORY`."""
WAIT = 10
"""Longest time that reading may take, as a multiple of its CPU time: a busy machine is no fault of the file."""

T = TypeVar("T")


def bounded(call: Callable[[], T], path: str | Path, *, size: int = 0) -> T:
    """Return what a call returns.

    Args:
        call: Reads a file; what it returns must be picklable.
        path: The file, for the message.
        size: Its size, bytes: a large file may take longer.

    Raises:
        ValueError: If the call takes more than `SECONDS` or `MEMORY`.
    """
    seconds = max(SECONDS, size // 10**6)
    limits = {
        resource.RLIMIT_CPU: seconds,
        resource.RLIMIT_DATA: MEMORY,
        resource.RLIMIT_FSIZE: max(MEMORY, UNPACKED * size),
        resource.RLIMIT_CORE: 0,
    }
    receiver, sender = os.pipe()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of other threads, whose locks the copy does not take
        pid = os.fork()
    if not pid:
        _answer(call, sender, limits)
    os.close(sender)
    result: Any
    try:
        with open(receiver, "rb") as pipe:
            result, error = pickle.load(pipe)
    except (EOFError, pickle.UnpicklingError):  # it was ended
        result, error = None, MemoryError()
    finally:
        os.kill(pid, signal.SIGKILL)  # where this process is interrupted
        os.waitpid(pid, 0)
    if isinstance(error, MemoryError):
        most = f"{seconds} s of computing or {MEMORY // 2**20} MB of memory"
        raise ValueError(f"{path}: reading it takes more than {most}: it is too large, or damaged; give a part of it.")
    if error:
        raise error
    return result


def _answer(call: Callable[[], object], sender: int, limits: dict[int, int]) -> None:
    """Write what a call returns, and the error that it raises, and end this process."""
    try:
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT, signal.SIGALRM, signal.SIGXCPU):
            signal.signal(number, signal.SIG_DFL)
        signal.alarm(WAIT * limits[resource.RLIMIT_CPU])
        limits[resource.RLIMIT_DATA] += int(Path("/proc/self/statm").read_text().split()[5]) * resource.getpagesize()
        for kind, limit in limits.items():
            hard = resource.getrlimit(kind)[1]
            resource.setrlimit(kind, (limit if hard == resource.RLIM_INFINITY else min(limit, hard), hard))
        os.dup2(os.open(os.devnull, os.O_WRONLY), 2)  # libraries that abort
        result, error = None, None
        try:
            result = call()
        except Exception as raised:
            error = raised if type(raised).__module__ == "builtins" else RuntimeError(f"{type(raised).__name__}: {raised}")
        with open(sender, "wb") as pipe:
            pickle.dump((result, error), pipe, protocol=5)
    finally:
        os._exit(0)

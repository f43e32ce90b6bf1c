"""Calls with bounds on time and memory, each in a copy of this process: a small file may ask for any amount of either."""

from __future__ import annotations

import os
import pickle
import re
import resource
import signal
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

SECONDS, RATE = 6, 2 * 10**6
"""CPU time that reading any file may take, s; and bytes for which a larger one has a second."""
MEMORY, UNPACKED = 400 * 2**20, 30
"""Memory by which reading may let a process grow, bytes; files that it unpacks may be so much larger than the file."""
WAIT = 10
"""Longest time that reading may take, as a multiple of its CPU time: a busy machine is no fault of the file."""
_EXHAUSTED = re.compile("bad_alloc|(unable|failed) to allocate|out of memory|MemoryError|File too large", re.IGNORECASE)

T = TypeVar("T")


def bounded(call: Callable[[], T], path: str | Path, *, size: int = 0) -> T:
    """Return what a call returns, which must be picklable.

    Args:
        call: Reads a file.
        path: The file, for the message.
        size: Its size, bytes.

    Raises:
        ValueError: If the call takes more time or memory than a file may.
    """
    seconds = max(SECONDS, size // RATE)
    receiver, sender = os.pipe()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of other threads, whose locks the copy does not take
        pid = os.fork()
    if not pid:
        _answer(call, sender, seconds, max(MEMORY, UNPACKED * size))
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
    if isinstance(error, MemoryError) or (error and _EXHAUSTED.search(str(error))):
        most = f"{seconds} s of computing or {MEMORY // 2**20} MB of memory"
        raise ValueError(f"{path}: reading it takes more than {most}: it is too large, or damaged; use a smaller one.")
    if error:
        raise error
    return result


def _answer(call: Callable[[], object], sender: int, seconds: int, disk: int) -> None:
    """Write what a call returns and the error that it raises, and end this process."""
    try:
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT, signal.SIGALRM, signal.SIGXCPU):
            signal.signal(number, signal.SIG_DFL)
        signal.alarm(WAIT * seconds)
        memory = MEMORY + int(Path("/proc/self/statm").read_text().split()[5]) * resource.getpagesize()
        for kind, limit in (("CPU", seconds), ("DATA", memory), ("FSIZE", disk), ("CORE", 0)):
            hard = resource.getrlimit(number := getattr(resource, f"RLIMIT_{kind}"))[1]
            limit = limit if hard == resource.RLIM_INFINITY else min(limit, hard)
            resource.setrlimit(number, (limit, limit))
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

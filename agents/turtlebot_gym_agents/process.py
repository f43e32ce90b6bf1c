"""Settings of a process that runs a command or a node; importing the packages changes no process."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable
from functools import wraps
from typing import ParamSpec

P = ParamSpec("P")


def let_threads_sleep() -> None:
    """Let idle threads of OpenMP and OpenBLAS sleep instead of spin, unless the environment says otherwise.

    Call it before numpy or torch is imported: the libraries read these variables when they are loaded. A thread that
    spins takes a core from other programs: on a busy machine a step of 512 environments took 5 ms of CPU instead of 0.06.
    Threads that sleep lengthen a parallel loop by at most 5 microseconds.
    """
    os.environ.setdefault("GOMP_SPINCOUNT", "0")
    os.environ.setdefault("OPENBLAS_THREAD_TIMEOUT", "4")


def ending_quietly(main: Callable[P, int]) -> Callable[P, int]:
    """Let a program end silently, with a shell's status for SIGPIPE, if its output is closed early, as by ``| head``."""

    @wraps(main)
    def run(*args: P.args, **kwargs: P.kwargs) -> int:
        try:
            try:
                return main(*args, **kwargs)
            finally:
                sys.stdout.flush()
        except BrokenPipeError:
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # where Python flushes what is left at exit
            return 128 + signal.SIGPIPE

    return run

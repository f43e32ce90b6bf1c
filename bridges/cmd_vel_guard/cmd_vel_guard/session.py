"""Signals, and processes that end with others: with the one that started them or, a moment later, with their terminal.

A lifeline is a file that ends when the processes at its other end have ended, however they ended.
"""

from __future__ import annotations

import os
import select
import signal
import socket
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

LIFELINE = "NODE_LIFELINE"
"""Environment variable with the number of the file that ends with the process that started this one."""
ENDINGS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)
"""Signals that end a process: Ctrl-C, ``kill``, a closed terminal, and Ctrl with a backslash."""
OTHERS = tuple(getattr(signal, f"SIG{name}") for name in ("USR1", "USR2", "ALRM", "VTALRM", "PROF", "IO", "PWR", "XCPU"))
"""All others that end a process by default, but for crashes."""
SUSPENSIONS = (signal.SIGTSTP, signal.SIGTTIN, signal.SIGTTOU)
"""Signals that suspend a process: Ctrl-Z, and using the terminal from its background."""
INTERRUPTED = 128 + signal.SIGINT
"""Exit code of a program that Ctrl-C ended, as in a shell."""


def counts(number: int) -> bool:
    """Return whether a signal counts; a hang-up and a suspension do not where they are ignored, as under ``nohup``."""
    return number in (signal.SIGINT, signal.SIGTERM, signal.SIGQUIT) or signal.getsignal(number) is not signal.SIG_IGN


def lifeline() -> list[int]:
    """Return the file that ends with the process that started this one, if that passed it a file and its number."""
    number = os.environ.pop(LIFELINE, "")
    return [int(number)] if number else []


@contextmanager
def listening(lifelines: Sequence[int] = ()) -> Iterator[Callable[..., int | None]]:
    """Catch signals, and yield a function that waits for one, at most a time in s, and returns the number of one that came.

    So no signal is lost while a node starts, and none acts by itself. Blocking signals is not enough: existing threads of a
    library do not block them, and a signal taken by such a thread ends the process. The handler writes to a pipe, whichever
    thread it runs in. The end of a lifeline counts as a hang-up.
    """
    noted, note = os.pipe()
    os.set_blocking(note, False)
    caught, watched = list(filter(counts, (*ENDINGS, *OTHERS, *SUSPENSIONS))), [noted, *lifelines]
    before = signal.set_wakeup_fd(note, warn_on_full_buffer=False)  # first: else a signal that comes in between is lost
    handlers = {number: signal.signal(number, lambda *_: None) for number in caught}

    def wait(timeout: float | None = None) -> int | None:
        while ready := select.select(watched, [], [], timeout)[0]:
            if ready[0] != noted:
                watched.remove(ready[0])
                return signal.SIGHUP
            if (number := os.read(noted, 1)[0]) in caught:
                return number
        return None

    try:
        yield wait
    finally:
        signal.set_wakeup_fd(before)
        for number, handler in handlers.items():
            signal.signal(number, handler)
        os.close(noted)
        os.close(note)


def leave() -> list[int]:
    """Move this process to a session of its own, and return files that end when its old process group is ended.

    The signals of a terminal, and those to a group, then reach only a child process that stays in the group and ends at the
    first one. The leader of a group cannot move, and need not: a signal to its group is meant for it.
    """
    if os.getpgrp() == os.getpid():
        return []
    here, there = socket.socketpair()
    if os.fork() == 0:
        here.close()
        _end_at_a_signal(there)
    there.close()
    os.setsid()
    return [here.detach()]


def _end_at_a_signal(other: socket.socket) -> None:
    """End at the first signal, or with the process at the other end."""
    try:
        for number in filter(counts, ENDINGS):
            signal.signal(number, lambda *_: os._exit(0))
        other.recv(1)
    finally:
        os._exit(0)

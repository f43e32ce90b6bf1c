"""Nodes in processes of their own, and Ctrl-C where a program waits for them."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from threading import Event
from typing import Any

from cmd_vel_guard.session import ENDINGS, LIFELINE, counts

KILL = 10.0
"""Time after which a node's process that was asked to end is killed, s."""
_interrupted = Event()


def be_interruptible() -> None:
    """Only note signals that end a process: a KeyboardInterrupt is lost in a destructor, and confuses an import."""
    _interrupted.clear()
    for ending in filter(counts, ENDINGS):
        signal.signal(ending, lambda *_: _interrupted.set())


def go_on() -> None:
    """Raise KeyboardInterrupt if a signal was noted: call it before motions, and again and again in a wait."""
    if _interrupted.is_set():
        raise KeyboardInterrupt


@contextmanager
def processes(nodes: Sequence[tuple[str, Mapping[str, Any]]], words: Sequence[str]) -> Iterator[list[subprocess.Popen[bytes]]]:
    """Run nodes, by name and parameters, in processes of their own with ROS arguments; they end also if this one is killed."""
    running: list[subprocess.Popen[bytes]] = []
    # A signal at the parent's death, as Linux knows it, would also come when the thread ends that started them.
    theirs, ours = os.pipe()
    try:
        for name, parameters in nodes:
            texts = {key: str(value).lower() if isinstance(value, bool) else value for key, value in parameters.items()}
            given = [word for key, text in texts.items() for word in ("-p", f"{key}:={text}")]
            command = [sys.executable, "-m", "turtlebot_gym_ros", name, "--ros-args", *given, *words]
            variables = {**os.environ, LIFELINE: str(theirs)}
            before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # until it is ready to end quietly
            running.append(subprocess.Popen(command, env=variables, pass_fds=[theirs]))
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
        yield running
    finally:
        for process in running:
            process.terminate()
        for process in running:
            try:
                process.wait(KILL)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
        os.close(theirs)
        os.close(ours)

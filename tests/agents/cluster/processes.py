"""Which processes run, and where they listen."""

import contextlib
import os
import signal
import time

import psutil


def marked(mark):
    """Return the processes that have a text in the environment that they were started with."""
    marked = []
    for process in psutil.process_iter():
        with contextlib.suppress(psutil.Error):  # it has ended, or is somebody else's
            if mark in process.environ().values() and process.status() != psutil.STATUS_ZOMBIE:
                marked.append(process.pid)
    return [process for process in marked if process != os.getpid()]


def wait_until(condition, seconds=60.0):
    """Return whether a condition becomes true in time."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if condition():
            return True
        time.sleep(0.05)
    return bool(condition())


def addresses(processes):
    """Return the addresses at which processes listen."""
    listening = []
    for process in processes:
        with contextlib.suppress(psutil.Error):
            connections = psutil.Process(process).net_connections()
            listening += [socket.laddr.ip for socket in connections if socket.status == psutil.CONN_LISTEN]
    return sorted(listening)


def end(process, seconds=20.0):
    """End a process that was started here, with its children."""
    process.send_signal(signal.SIGTERM)
    try:
        process.wait(seconds)
    except Exception:
        process.kill()
        process.wait()

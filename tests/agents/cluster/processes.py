"""What processes there are, and where they listen, from /proc."""

import os
import signal
import time
from pathlib import Path

LISTENS = "0A"


def marked(mark):
    """Return the processes that have a text in the environment that they were started with."""
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            alive = (folder / "stat").read_text().rpartition(")")[2].split()[0] != "Z"
            if alive and mark.encode() in (folder / "environ").read_bytes():
                found.append(int(folder.name))
        except OSError:  # it has ended, or is somebody else's
            continue
    return [process for process in found if process != os.getpid()]


def wait_until(true, seconds=60.0):
    """Return whether something becomes true in time."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if true():
            return True
        time.sleep(0.05)
    return bool(true())


def addresses(processes):
    """Return the addresses at which processes listen, as hexadecimal digits of /proc/net."""
    sockets = set()
    for process in processes:
        for link in Path(f"/proc/{process}/fd").glob("*"):
            try:
                sockets.add(os.readlink(link))
            except OSError:
                continue
    found = {}
    for name in ("tcp", "tcp6"):
        for line in Path(f"/proc/net/{name}").read_text().splitlines()[1:]:
            words = line.split()
            if words[3] == LISTENS and f"socket:[{words[9]}]" in sockets:
                found[words[9]] = words[1].partition(":")[0]
    return sorted(found.values())


def end(process, seconds=20.0):
    """End a process that was started here, and what it has started."""
    process.send_signal(signal.SIGTERM)
    try:
        process.wait(seconds)
    except Exception:
        process.kill()
        process.wait()

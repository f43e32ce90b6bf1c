"""The bounds of time and memory within which a hostile file is read or refused."""

import os
import pickle
import resource
import shutil
import signal
import time
import traceback
from collections import Counter

import numpy as np

SECONDS, MEMORY, OWN = 10.0, 1e9, 3e8
"""CPU seconds and bytes that a reader may take, and bytes of them that a fresh process with the package takes by itself."""
PATIENCE = 120
"""Wall time after which a reader hangs, s; a busy machine needs more than `SECONDS`."""
MANY = 1000
"""Number of files of the long tests."""


def tried(kinds, name, number, folder):
    """Read a hostile file in a process of its own; return how that ended, its CPU time, s, and its most memory, bytes."""
    rng = np.random.default_rng([number, *name.encode()])
    reader = kinds[name](folder, rng)
    receiver, sender = os.pipe()
    pid = os.fork()
    if not pid:
        signal.signal(signal.SIGALRM, signal.SIG_DFL)
        signal.alarm(PATIENCE)
        began = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024  # what the tests of this process hold
        started = sum(resource.getrusage(resource.RUSAGE_SELF)[:2])
        try:
            reader()
            said = "read"
        except (ValueError, OSError, ImportError) as error:
            said = str(error)
            if not said.strip() or "\n" in said or len(said) > 2000:
                said = f"FAILED: {said!r}"
        except BaseException:
            said = f"FAILED: {traceback.format_exc()}"
        spent = [sum(resource.getrusage(who)[:2]) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
        most = max(resource.getrusage(who).ru_maxrss for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)) * 1024
        with open(sender, "wb") as pipe:
            pickle.dump((said, sum(spent) - started, max(most - max(began - OWN, 0.0), 0.0)), pipe)
        os._exit(0)
    os.close(sender)
    with open(receiver, "rb") as pipe:
        content = pipe.read()
    os.waitpid(pid, 0)
    return pickle.loads(content) if content else (f"FAILED: it was killed, or took more than {PATIENCE} s", 0.0, 0.0)


def require_bounded(kinds, name, number, folder):
    """Check that a hostile file of a kind is read or refused within the bounds."""
    said, seconds, most = tried(kinds, name, number, folder)
    where = f"{name} {number}: {seconds:.1f} CPU s, {most / 1e6:.0f} MB: {said}"
    assert not said.startswith("FAILED"), where
    assert seconds < SECONDS, where
    assert most < MEMORY, where
    return said, seconds, most, where


def require_many_bounded(kinds, name, parent):
    """Check as many files of a kind as make `MANY` with those of the other kinds."""
    count = -(-MANY // len(kinds))
    faults, ends, worst = [], Counter(), (0.0, 0.0)
    for number in range(count):
        folder = parent / str(number)
        folder.mkdir()
        started = time.monotonic()
        try:
            said, seconds, most, _ = require_bounded(kinds, name, number, folder)
        except AssertionError as error:
            faults.append(str(error).partition("\nassert")[0])
            continue
        finally:
            shutil.rmtree(folder)
        ends["read" if said == "read" else "refused"] += 1
        worst = max(worst[0], seconds), max(worst[1], most)
        assert time.monotonic() - started < PATIENCE
    print(f"{name}: {dict(ends)}, at most {worst[0]:.1f} CPU s and {worst[1] / 1e6:.0f} MB")
    assert not faults, "\n".join(faults)

"""Who may run a parallel loop, and how its threads wait."""

from __future__ import annotations

import os
import threading

# Threads that spin at the end of each step keep a busy machine from running the very thread that they wait for: with a second
# program on the cores, the default spin made a step 20 times slower. This one costs an idle machine nothing that was measured.
os.environ.setdefault("GOMP_SPINCOUNT", "1000")


class Threads:
    """Lets one Python thread at a time run a parallel loop, and no child that was forked after its parent ran one.

    numba's work queue aborts under two Python threads, and OpenMP would kill such a child. All others run the serial loop,
    which gives the same bits.
    """

    lock = threading.Lock()
    used = False
    lost = False

    @classmethod
    def acquire(cls) -> bool:
        """Return whether the caller may run a parallel loop; it then has to release the lock."""
        allowed = not cls.lost and cls.lock.acquire(blocking=False)
        cls.used |= allowed
        return allowed

    @classmethod
    def after_fork(cls) -> None:
        """Forget the parent's lock, in a child."""
        cls.lock = threading.Lock()
        cls.lost = cls.used


os.register_at_fork(after_in_child=Threads.after_fork)

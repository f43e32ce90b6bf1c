"""How many threads a parallel loop uses: a limit that changes no bit."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np
import pytest

from turtlebot_gym.compiled import batch as module
from turtlebot_gym.compiled.batch import Batch
from turtlebot_gym.compiled.packing import TILE
from turtlebot_gym.compiled.threads import VARIABLE, Threads, limited
from turtlebot_gym.systems import make_parameters
from turtlebot_gym.tasks import SQUARE, SQUARE_WAYPOINTS


def driven(steps=20):
    """Return the bytes of a batch's results."""
    batch = Batch(9 * TILE, make_parameters(SQUARE), SQUARE_WAYPOINTS)
    batch.seeds[:] = np.arange(batch.num_envs)
    batch.reset(np.ones(batch.num_envs, np.bool_), *batch.empty())
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (steps, batch.num_envs, 2)).astype(np.float32)
    return [[array.tobytes() for array in batch.step(action)] for action in actions]


@pytest.mark.parametrize("threads", [1, 2, 1000, None])
def test_the_limit_changes_no_bit(monkeypatch, threads):
    serial = driven()
    monkeypatch.setattr(module, "PARALLEL_FROM", TILE)
    with limited(threads):
        assert driven() == serial


def test_one_thread_never_runs_in_parallel():
    with limited(1):
        assert not Threads.acquire()
    assert not Threads.lock.locked()


def test_more_threads_are_numbas_for_as_long_as_they_run():
    numba = pytest.importorskip("numba")
    before, most = numba.get_num_threads(), numba.config.NUMBA_NUM_THREADS
    with limited(2):
        assert Threads.acquire()
        assert numba.get_num_threads() == min(2, most)
        assert not Threads.acquire()
        Threads.release()
    assert numba.get_num_threads() == before
    assert Threads.acquire()
    Threads.release()


def test_the_limit_ends_with_its_block():
    before = Threads.limit
    with limited(3):
        with limited(1):
            assert Threads.limit == 1
        assert Threads.limit == 3
        with pytest.raises(KeyError), limited(2):
            raise KeyError
        assert Threads.limit == 3
    assert Threads.limit == before
    for wrong in (0, -1):
        with pytest.raises(ValueError, match=f"threads must be at least 1, got {wrong}"), limited(wrong):
            pass
    assert Threads.limit == before


def told(value):
    script = "from turtlebot_gym.compiled.threads import Threads; print(Threads.limit)"
    return subprocess.run(
        [sys.executable, "-c", script], env={**os.environ, VARIABLE: value}, capture_output=True, text=True, timeout=100
    )


@pytest.mark.parametrize(("value", "limit"), [("", "None"), ("1", "1"), ("16", "16")])
def test_the_environment_variable_sets_the_limit(value, limit):
    assert told(value).stdout.strip() == limit


@pytest.mark.parametrize("value", ["0", "two", "-1", "1.5"])
def test_the_environment_variable_is_checked(value):
    done = told(value)
    assert done.returncode != 0
    assert f"ValueError: {VARIABLE} must be" in done.stderr

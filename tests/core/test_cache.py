"""What keys numba's cache: all that a loop is made of, and nothing else."""

from __future__ import annotations

import os
import pty
import subprocess
import sys
from types import FunctionType

import pytest

from turtlebot_gym.compiled import loop
from turtlebot_gym.compiled.cache import bind, fingerprint
from turtlebot_gym.estimation.interface import DEAD_RECKONING, EXTENDED_KALMAN
from turtlebot_gym.systems import open_ground, step_of


def with_source(source, **names):
    """Return the function ``f`` of a source text."""
    scope = dict(names)
    exec(source, scope)
    return scope["f"]


HELPER = "def helper(x):\n    return x + 1.0\n"
SOURCE = "def f(x):\n    return helper(x) * FACTOR\n"


@pytest.mark.parametrize(
    "changed",
    [
        with_source(HELPER + SOURCE.replace("*", "/"), FACTOR=2.0),
        with_source(HELPER + SOURCE, FACTOR=3.0),
        with_source(HELPER.replace("1.0", "1.5") + SOURCE, FACTOR=2.0),
        with_source(HELPER.replace("+", "-") + SOURCE, FACTOR=2.0),
        with_source(HELPER + SOURCE, FACTOR=(2.0,)),
    ],
    ids=["operator", "constant", "constant of a helper", "operator of a helper", "type"],
)
def test_a_change_of_anything_that_a_function_reaches_changes_its_fingerprint(changed):
    assert fingerprint(changed) != fingerprint(with_source(HELPER + SOURCE, FACTOR=2.0))


@pytest.mark.parametrize(
    "same",
    [
        with_source("# a comment\n\n" + HELPER + "\n\n\n" + SOURCE, FACTOR=2.0),
        with_source(HELPER + SOURCE, FACTOR=2.0, UNUSED=5.0, unused=lambda: 7.0),
    ],
    ids=["comments and lines", "names that it does not use"],
)
def test_nothing_else_does(same):
    assert fingerprint(same) == fingerprint(with_source(HELPER + SOURCE, FACTOR=2.0))


def test_it_reaches_through_closures_and_modules():
    import turtlebot_gym.models.angles as module

    def outer(inner):
        return lambda x: inner(x)

    one, other = outer(with_source("def f(x):\n    return x\n")), outer(with_source("def f(x):\n    return -x\n"))
    assert fingerprint(one) != fingerprint(other)
    through = with_source("def f(x):\n    return module.wrap(x)\n", module=module)
    before = fingerprint(through)
    wrap = module.wrap
    try:
        module.wrap = lambda angle: angle
        assert fingerprint(through) != before
    finally:
        module.wrap = wrap


def test_every_kernel_of_a_step_is_part_of_its_fingerprint():
    """Each kernel of a system is replaced in turn: all loops that run it must then be compiled anew."""
    system = open_ground(EXTENDED_KALMAN)
    tile, lane = fingerprint(loop._step_tile_of(system)), fingerprint(loop._reset_lane_of(system))
    for name in ("move", "sense", "estimate", "judge", "observe"):
        kernel = getattr(system, name)
        renamed = FunctionType(kernel.__code__.replace(co_consts=(*kernel.__code__.co_consts, 0.125)), kernel.__globals__,
                               name, None, kernel.__closure__)  # fmt: skip
        assert fingerprint(step_of(system._replace(**{name: renamed})).advance, renamed) != tile
        changed = fingerprint(step_of(system._replace(**{name: renamed})).advance)
        assert (changed != fingerprint(step_of(system).advance)) == (name != "observe")
    assert tile != lane


def test_systems_have_fingerprints_of_their_own_and_the_same_in_every_process():
    program = (
        "from turtlebot_gym.compiled import loop\n"
        "from turtlebot_gym.compiled.cache import fingerprint\n"
        "from turtlebot_gym.estimation.interface import DEAD_RECKONING, EXTENDED_KALMAN\n"
        "from turtlebot_gym.systems import open_ground\n"
        "for it in (EXTENDED_KALMAN, DEAD_RECKONING): print(fingerprint(loop._step_tile_of(open_ground(it))))\n"
    )
    here = [fingerprint(loop._step_tile_of(open_ground(it))) for it in (EXTENDED_KALMAN, DEAD_RECKONING)]
    assert here[0] != here[1]
    for seed in ("1", "2"):
        there = subprocess.run(
            [sys.executable, "-c", program],
            capture_output=True,
            text=True,
            check=True,
            env=os.environ | {"PYTHONHASHSEED": seed},
        )
        assert there.stdout.split() == here


def test_a_bound_function_finds_other_values_and_leaves_the_first_one_alone():
    f = with_source("def f(x):\n    return FACTOR * x\n", FACTOR=2.0)
    assert (bind(f, FACTOR=5.0)(1.0), f(1.0)) == (5.0, 2.0)


COMPILE = """
import numpy as np
from turtlebot_gym.compiled.batch import Batch
from turtlebot_gym.systems import make_parameters
from turtlebot_gym.values import Pose
batch = Batch(1, make_parameters(), [Pose(0.0, 0.0, 0.0)])
batch.reset(np.ones(1, np.bool_), *batch.empty())
"""


def test_the_first_compilation_says_so_on_a_terminal_and_the_second_run_is_silent(tmp_path):
    def said():
        ours, theirs = pty.openpty()
        environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
        process = subprocess.Popen([sys.executable, "-c", COMPILE], stderr=theirs, env=environment)
        os.close(theirs)
        text = b""
        try:
            while chunk := os.read(ours, 4096):
                text += chunk
        except OSError:  # the other end is closed
            pass
        os.close(ours)
        assert process.wait() == 0
        return text.decode()

    first = said()
    assert first.count("\n") == 1
    assert first.startswith("turtlebot_gym: compiling for this machine, once")
    assert said() == ""


def test_it_is_silent_where_stderr_is_no_terminal(tmp_path):
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
    done = subprocess.run([sys.executable, "-c", COMPILE], env=environment, capture_output=True, text=True, check=True)
    assert done.stderr == ""

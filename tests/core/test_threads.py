"""How many threads a parallel loop uses: a limit that changes no bit."""

import numpy as np
import pytest

from turtlebot_gym.compiled import batch as batches
from turtlebot_gym.compiled import threads as module
from turtlebot_gym.compiled.batch import Batch
from turtlebot_gym.compiled.packing import TILE
from turtlebot_gym.compiled.threads import VARIABLE, limited
from turtlebot_gym.systems import Options


def driven(number=20, task="square"):
    """Return the bytes of a batch's results, of its first observations first."""
    parameters, waypoints, plan, _ = Options(task=task).setup()
    batch = Batch(9 * TILE, parameters, waypoints, plan=plan)
    batch.seeds[:] = np.arange(batch.num_envs)
    first = batch.empty()
    batch.reset(np.ones(batch.num_envs, np.bool_), *first)
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (number, batch.num_envs, 2)).astype(np.float32)
    steps = [(*batch.step(action), np.array(batch.flagged)) for action in actions]
    return [[array.tobytes() for array in arrays] for arrays in (first, *steps)]


@pytest.mark.parametrize("task", ["square", "room"])  # in rooms a reset has work for all threads, too
@pytest.mark.parametrize("threads", [1, 2, 1000, None])
def test_the_limit_changes_no_bit(monkeypatch, threads, task):
    with limited(1):
        serial = driven(task=task)
    monkeypatch.setattr(batches, "PARALLEL_FROM", TILE)
    monkeypatch.setattr(batches, "ROOMS_PARALLEL_FROM", TILE)
    with limited(threads):
        assert driven(task=task) == serial


def test_the_limit_ends_with_its_block():
    before = module.limit
    with limited(3):
        with pytest.raises(KeyError), limited(2):
            raise KeyError
        assert module.limit == 3
    assert module.limit == before
    with pytest.raises(ValueError, match="threads must be at least 1, got 0"), limited(0):
        pass
    assert module.limit == before


@pytest.mark.parametrize("value", ["", "1", "16", "0", "two", "-1", "1.5"])
def test_the_environment_variable_sets_the_limit_and_is_checked(value, run):
    def limit():
        return run("from turtlebot_gym.compiled import threads; print(threads.limit or 0)", **{VARIABLE: value})

    if value in ("", "1", "16"):
        assert limit() == int(value or 0)
    else:
        with pytest.raises(AssertionError, match=f"ValueError: {VARIABLE} must be"):
            limit()


@pytest.mark.parametrize("given", [{}, {"OPENBLAS_THREAD_TIMEOUT": "20"}], ids=["default", "the user's"])
@pytest.mark.parametrize("entry", ["turtlebot_gym_agents.__main__", "turtlebot_gym_ros.__main__"])
def test_commands_and_nodes_let_threads_sleep_before_numpy_is_loaded_unless_the_user_says_otherwise(entry, given, run):
    look = "def find_spec(name, *_): name == 'numpy' and seen.append(os.environ['OPENBLAS_THREAD_TIMEOUT'])"
    program = f"import os, sys; seen = []\n{look}\nsys.meta_path.insert(0, sys.modules[__name__])\n"
    program += f"from {entry} import main\nmain(['--version'])\nprint(seen[0])"
    assert run(program, **given) == int(given.get("OPENBLAS_THREAD_TIMEOUT", 4))


@pytest.mark.parametrize("package", ["turtlebot_gym", "turtlebot_gym_agents", "turtlebot_gym_ros"])
def test_importing_a_package_leaves_the_environment_of_the_process_as_it_was(package, run):
    program = f"import json, os; before = dict(os.environ); import {package}; print(json.dumps(os.environ == before))"
    assert run(program) is True

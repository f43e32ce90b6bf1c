"""The compiled loop: its rows, threads, forks, and life without llvmlite or Gymnasium."""

import os

import numpy as np
import pytest

import turtlebot_gym
from turtlebot_gym.compiled.batch import PARALLEL_FROM, Batch
from turtlebot_gym.compiled.packing import TILE
from turtlebot_gym.heart import Episode
from turtlebot_gym.presets import NOISES
from turtlebot_gym.robots import ROBOTS
from turtlebot_gym.systems import make_parameters
from turtlebot_gym.values import Pose

WAYPOINTS, SQUARE = turtlebot_gym.SQUARE_WAYPOINTS, turtlebot_gym.SQUARE
MANY = 2 * PARALLEL_FROM


def started(num_envs, parameters):
    batch = Batch(num_envs, parameters, WAYPOINTS)
    batch.seeds[:] = np.arange(num_envs)
    batch.reset(np.ones(num_envs, np.bool_), *batch.empty())
    return batch


def worlds(batch):
    return [batch.world(i) for i in range(batch.num_envs)]


def acting(number):
    return np.full((number, 2), 0.5, np.float32)


def test_each_environment_may_have_parameters_of_its_own(in_step):
    n = TILE + 5
    noises = [noise for name, noise in NOISES.items() if name != "wheel"]  # which has a filter of its own
    robots, rules = list(ROBOTS.values()), ("euler", "midpoint")
    rows = [
        make_parameters(SQUARE, robot=robots[i % 4], noise=noises[i % 4], dt=0.05 * (1 + i % 3), integrator=rules[i % 2])
        for i in range(n)
    ]
    plain = {i: Episode(rows[i], WAYPOINTS, seed=i) for i in (0, 1, TILE - 1, TILE, n - 1)}
    assert len(list(in_step(Batch(n, rows, WAYPOINTS), plain, steps=50))) == 50


def test_parameters_may_be_changed_on_the_way():
    calm, shaky = make_parameters(SQUARE, noise="clean"), make_parameters(SQUARE, noise="tutorial")
    batch = started(3, calm)
    for parameters, is_shaky in ((calm, [False] * 3), (shaky, [True] * 3), ([calm, calm, shaky], [False, False, True])):
        batch.set_parameters(parameters)
        batch.step(np.zeros((3, 2), np.float32))
        assert batch.numbers("senses.odometry.pose").any(axis=1).tolist() == is_shaky
    with pytest.raises(ValueError, match="parameters must be one or 3, got 2"):
        batch.set_parameters([calm, calm])
    with pytest.raises(ValueError, match="the kind of filter must be the same in all"):
        batch.set_parameters([calm, calm, make_parameters(SQUARE, noise="wheel")])
    assert batch.parameters == [calm, calm, shaky]


@pytest.mark.parametrize("num_envs", [1, 7, TILE, TILE + 1, 3 * TILE])
def test_what_is_read_is_a_copy(num_envs):
    batch = started(num_envs, make_parameters(SQUARE))
    before = worlds(batch)
    batch.select(range(batch.layout.world.size), [[0, 1], [2, 3]])
    assert batch.selected()[:-4].T.tolist() == batch.numbers("").tolist()
    numbers, parts = batch.first
    whole, square = (numbers[part] for part in parts)
    assert [*whole.tolist(), *square.ravel().tolist()] == batch.selected()[:, 0].tolist()
    assert square.shape == (2, 2)
    for path in ("body.true_state", "senses.odometry.pose", "estimate.belief.covariance", "course.reference", "body.command"):
        batch.numbers(path)[...] = 7.0
    for array in (*batch.last(), batch.selected(), whole, square):
        array[...] = 7.0
    assert worlds(batch) == before


@pytest.mark.parametrize("task", [SQUARE, turtlebot_gym.NAV])
def test_what_the_last_step_returned_can_be_had_again(task):
    batch = started(TILE + 3, make_parameters(task))
    observations, outcomes = batch.step(acting(TILE + 3))
    before = worlds(batch)
    again, outcomes_again = batch.last()
    assert again.tobytes() == observations.tobytes()
    np.testing.assert_array_equal(outcomes_again[1], outcomes[1])  # the distance; reward and end were the step's
    assert not outcomes_again[[0, 2, 3, 4, 5]].any()
    assert worlds(batch) == before
    batch.step(acting(TILE + 3))  # writes to no array that somebody holds
    assert again.tobytes() == observations.tobytes()
    assert (again != batch.last()[0]).any()


def test_a_reset_leaves_the_rows_outside_its_mask():
    batch = started(5, make_parameters(SQUARE))
    observations, outcomes = batch.step(acting(5))
    before, kept = worlds(batch), observations.copy()
    mask = np.array([False, True, False, False, True])
    batch.episodes[mask] += 1
    batch.reset(mask, observations, outcomes)
    assert [world == other for world, other in zip(worlds(batch), before, strict=True)] == (~mask).tolist()
    assert ((observations == kept).all(axis=1) == ~mask).all()


def test_huge_seeds_and_episodes_are_fine():
    batch = Batch(2, make_parameters(SQUARE), [Pose(1.0, 0.0, 0.0)])
    batch.seeds[:] = [turtlebot_gym.models.random.MAX_SEED, 0]
    batch.episodes[:] = 10**12
    batch.reset(np.ones(2, np.bool_), *batch.empty())
    for i in range(2):
        plain = Episode(batch.parameters, [Pose(1.0, 0.0, 0.0)], seed=int(batch.seeds[i]))
        plain.number = 10**12 - 1
        assert batch.world(i) == plain.reset()


BATCHES = f"""
import json, os, threading, warnings
import numpy as np
import turtlebot_gym.compiled.batch as module
from turtlebot_gym.systems import make_parameters
from turtlebot_gym.tasks import SQUARE, SQUARE_WAYPOINTS

p = make_parameters(SQUARE, noise="clean")

def stepped(steps=3, number={MANY}):
    batch = module.Batch(number, p, SQUARE_WAYPOINTS)
    batch.reset(np.ones(number, np.bool_), *batch.empty())
    for _ in range(steps):
        observations, _ = batch.step(np.full((number, 2), 0.5, np.float32))
    return batch.world(0).body.true_state.x, observations.tobytes().hex()

sums, expected = [], stepped()
threads = [threading.Thread(target=lambda: sums.append(stepped(200))) for _ in range(3)]
for thread in threads:
    thread.start()
for thread in threads:
    thread.join()
warnings.simplefilter("ignore")  # Python 3.12 warns of forks beside threads, which is what this is about
child = os.fork()
if child == 0:
    os._exit(0 if stepped() == expected else 3)
status = os.waitpid(child, 0)[1]
print(json.dumps([len(sums), len(set(sums)), os.waitstatus_to_exitcode(status), stepped() == expected]))
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system does not fork")
def test_threads_of_python_step_batches_at_the_same_time_and_a_forked_child_lives_after_them(run):
    assert run(BATCHES) == [3, 1, 0, True]  # a signal's number, negative, if a thread's lock killed the child


BARE = """
import json, math, sys
for blocked in ("gymnasium", "llvmlite", "filterpy", "scipy", "matplotlib", "pygame"):
    sys.modules[blocked] = None
import turtlebot_gym as tb

episode = tb.Episode(tb.make_parameters(tb.SQUARE, noise="rough"), tb.SQUARE_WAYPOINTS, seed=3)
for _ in range(200):
    episode.step(tb.Command(0.1, 0.2))
print(json.dumps(episode.observe()))
"""


def test_the_core_works_without_gymnasium_and_llvmlite(run):
    with_them = run(BARE.replace('"gymnasium", "llvmlite", ', ""))
    assert run(BARE) == with_them
    assert len(with_them) == 13


PLAIN = """
import json, sys
BLOCK
import numpy as np
import gymnasium as gym
import turtlebot_gym
from turtlebot_gym.kernel import HAS_LLVM

envs = gym.make_vec("turtlebot_gym/TurtleBotNav-v0", 3, max_episode_steps=25, info="full", noise="rough")
sums = [envs.reset(seed=5)[0].tobytes().hex()]
for actions in np.random.default_rng(0).uniform(-1.2, 1.2, (60, 3, 2)).astype(np.float32):
    observation, reward, *_, info = envs.step(actions)
    sums += [value.tobytes().hex() for value in (observation, reward, info["covariance"])]
print(json.dumps([HAS_LLVM, sums]))
"""


def test_without_llvmlite_the_environments_run_in_plain_python_and_give_the_same_bits(run):
    blocks = "", 'sys.modules["llvmlite"] = None', 'import os; os.environ["TURTLEBOT_GYM_PLAIN"] = "1"'
    (compiled, sums), *others = (run(PLAIN.replace("BLOCK", block)) for block in blocks)
    assert (compiled, others) == (True, [[False, sums]] * 2)

"""Whatever an environment is given, it works with finite numbers or answers with one line that names what is wrong."""

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import MISSING, fields
from typing import get_type_hints

import gymnasium as gym
import numpy as np
import pytest
from fuzzing import answered, fuzzed
from hypothesis import strategies as st

import turtlebot_gym
from turtlebot_gym import FixNoise, OdometryNoise, ProcessNoise, Robot, Task
from turtlebot_gym.parameters import FilterTuning
from turtlebot_gym.rooms.lidar import Lidar

SQUARE, ROOMS = (f"turtlebot_gym/TurtleBot{name}-v0" for name in ("Square", "Rooms"))
# Each kind of filter, with fixes and without, on open ground and in rooms, is compiled as a loop of its own: here are few.
FILTERS = ["matched", "tutorial", "gated"]
EXTREME = st.one_of(
    st.sampled_from([0.0, 1e-100, 1e-15, 1e-12, 1e-6, 1e-3, 0.1, 0.5, 1.0, 2.0, 1e3, 1e6, 1e9]),
    st.floats(1e-15, 1e9),
    st.floats(0.0, 1.0),
)
WRONG = st.one_of(
    st.sampled_from([math.nan, math.inf, -1.0, 1e300, 5e-324, True, None, "1", "", 1j, b"1", 2**80, np.ones((9, 99))]),
    st.lists(EXTREME, max_size=4),
    st.text(),
)


def some_fields_of(value):
    """Return some fields of a parameter class, the needed ones among them, each with what it may be or almost may be."""
    kinds = get_type_hints(type(value))
    number = {float: EXTREME, bool: st.booleans(), int: st.integers(0, 400)}

    def for_field(item):
        kind = kinds[item.name]
        if kind in number:
            return number[kind]
        return st.lists(EXTREME, min_size=(size := len(getattr(value, item.name))), max_size=size)

    needed = {item.name for item in fields(value) if item.default is MISSING and item.default_factory is MISSING}
    given_ = {item.name: for_field(item) for item in fields(value) if item.name not in ("process", "kind", "dead", "lidar")}
    return st.fixed_dictionaries(
        {name: strategy for name, strategy in given_.items() if name in needed},
        optional={name: strategy for name, strategy in given_.items() if name not in needed},
    )


robot, process, odometry, fix, tuning, task, lidar = map(
    some_fields_of,
    (
        Robot(max_linear=0.2, max_angular=2.0),
        ProcessNoise(),
        OdometryNoise(),
        FixNoise(R=(0.1, 0.1, 0.1)),
        FilterTuning(Q=(0.1,) * 5, R=(0.1,) * 3),
        Task(),
        Lidar(),
    ),
)
fix = fix.map(lambda given_: given_ | ({"delay": 0.3} if "delay" in given_ else {}))  # each other one is another loop
COMMON = {
    "robot": st.one_of(st.sampled_from(["burger", "waffle"]), robot),
    "noise": st.fixed_dictionaries({}, optional={"process": process, "odometry": odometry}),
    "filter": st.one_of(st.sampled_from(FILTERS), tuning),
    "reward": st.dictionaries(st.sampled_from(["progress", "time", "effort", "success", "collision"]), EXTREME),
    "fix": st.one_of(st.none(), fix),
    "dt": st.sampled_from([1e-4, 0.1, 10.0]),
    "delay": st.integers(0, 3),
    "observation": st.sampled_from(["ekf", "odometry", "truth"]),
}
GROUND = st.fixed_dictionaries(
    {},
    optional=COMMON
    | {
        "waypoints": st.lists(st.tuples(EXTREME, EXTREME, EXTREME), min_size=1, max_size=3),
        "laps": st.integers(1, 3),
        "task": task.map(lambda given_: {**given_, "random": False}),
    },
)
SMALL = st.one_of(st.sampled_from([0.0, 1e-6, 0.05, 0.1, 0.3, 0.5, 1.0, 2.0, 3.0, 20.0, 1e3]), st.floats(0.0, 4.0))
PAIR = st.lists(SMALL, min_size=2, max_size=2).map(sorted)
COUNTS = st.lists(st.integers(0, 30).map(float), min_size=2, max_size=2).map(sorted)
RULES = st.fixed_dictionaries(
    {},
    optional=dict.fromkeys(("radius", "speed"), PAIR)
    | dict.fromkeys(("circles", "boxes"), st.one_of(COUNTS, COUNTS, PAIR))
    | dict.fromkeys(("half_length", "half_width", "total", "courtesy", "min_distance", "max_distance"), SMALL)
    | {"kind": st.sampled_from([0.0, 1.0, 2.0, 3.0]), "fill": st.floats(0.0, 1.0), "through": st.booleans()},
)
GROUND = GROUND.map(lambda given_: given_ if given_.get("filter") not in FILTERS[2:] else {**given_, "fix": None})
IN_ROOMS = st.fixed_dictionaries(
    {"world": st.one_of(st.sampled_from(["dense", "office", "cellular", "crowd"]), RULES)},
    optional={name: COMMON[name] for name in ("robot", "noise", "reward", "observation")} | {"filter": tuning, "lidar": lidar},
)

ASIDE = ThreadPoolExecutor(1)
"""A thread whose stack is empty: the compiler goes deep into the stack, and hypothesis allows little of it."""


def driven(kind, id, arguments):
    """Drive what an environment's arguments make, and find finite numbers alone; or have them refused."""

    def make():
        given_ = dict(arguments)
        if "task" in given_ and isinstance(given_["task"], dict):
            given_["task"] = Task(**given_["task"])
        return gym.make(id, disable_env_checker=True, **given_)

    def drive():
        env = make()
        observation, info = env.reset(seed=1)
        for k in range(20):
            assert env.observation_space.contains(observation), (arguments, observation)
            assert math.isfinite(info["distance"]), arguments
            assert np.isfinite(info["covariance"]).all(), arguments
            action = np.array([math.cos(k), math.sin(3.0 * k)], np.float32)
            observation, one, terminated, truncated, info = env.step(action)
            assert math.isfinite(one), (arguments, one)
            if terminated or truncated:
                observation, info = env.reset()
        return True

    return answered(kind, lambda: ASIDE.submit(drive).result())


def with_one_wrong(draw, arguments):
    """Return arguments with one invalid value, anywhere in them."""
    if not arguments:
        return arguments
    name = draw(st.sampled_from(sorted(arguments)))
    inside = arguments[name]
    if isinstance(inside, dict) and inside and draw(st.booleans()):
        return {**arguments, name: {**inside, draw(st.sampled_from(sorted(inside))): draw(WRONG)}}
    return {**arguments, name: draw(WRONG)}


@pytest.mark.nightly
@fuzzed(80, 3000, arguments=GROUND)
def test_accepted_arguments_on_open_ground_give_finite_numbers(arguments):
    driven("arguments", SQUARE, arguments)


@fuzzed(250, 3600, arguments=GROUND, data=st.data())
def test_one_wrong_value_on_open_ground_is_one_line(arguments, data):
    driven("wrong arguments", SQUARE, with_one_wrong(data.draw, arguments))


@fuzzed(20, 400, arguments=IN_ROOMS)
def test_accepted_arguments_in_rooms_give_finite_numbers(arguments):
    driven("arguments of rooms", ROOMS, arguments)


@fuzzed(60, 600, arguments=IN_ROOMS, data=st.data())
def test_one_wrong_value_in_rooms_is_one_line(arguments, data):
    driven("wrong arguments of rooms", ROOMS, with_one_wrong(data.draw, arguments))


VECTOR = {
    "num_envs": st.one_of(st.integers(1, 5), st.integers(-1, 5), WRONG),
    "max_episode_steps": st.one_of(st.integers(-1, 1000), WRONG),
    "autoreset_mode": st.one_of(st.sampled_from(["NextStep", "SAME_STEP", "Disabled"]), WRONG),
    "info": st.one_of(st.sampled_from(["default", "full"]), WRONG),
    "render_rows": WRONG,
    "noise": st.sampled_from([*turtlebot_gym.NOISES]),
    "task": st.sampled_from([turtlebot_gym.NAV, turtlebot_gym.SQUARE]),
}
SEED = st.one_of(st.none(), st.integers(0, 9))
SEEDS = st.one_of(SEED, st.integers(-5, 2**65), st.lists(st.one_of(st.none(), st.integers(-1, 9)), max_size=4), WRONG)
MASKS = st.dictionaries(st.sampled_from(["reset_mask", "start", ""]), WRONG, max_size=2)
OPTIONS = st.one_of(st.none(), st.just({}), MASKS, WRONG)


@fuzzed(150, 1300, arguments=st.fixed_dictionaries({}, optional=VECTOR), seed=SEEDS, options=OPTIONS)
def test_vector_environments_their_seeds_and_options(arguments, seed, options):
    def drive():
        envs = gym.make_vec(SQUARE, vectorization_mode="vector_entry_point", **arguments)
        observations, _ = envs.reset(seed=seed, options=options)
        envs.action_space.seed(0)
        for _ in range(5):
            assert np.isfinite(observations).all()
            observations, rewards, *_ = envs.step(envs.action_space.sample())
            assert np.isfinite(rewards).all()

    answered("vector arguments", lambda: ASIDE.submit(drive).result())

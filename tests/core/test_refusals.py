"""Whatever environments, resets and steps are given, they accept it or answer with one line that names what is wrong."""

import math

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.error import Error, InvalidAction, ResetNeeded

from turtlebot_gym.envs.navigation import NavigationEnv
from turtlebot_gym.estimation.gyro import Gyro
from turtlebot_gym.models.unicycle import INTEGRATORS

NAV, SQUARE, ROOMS = (f"turtlebot_gym/TurtleBot{name}-v0" for name in ("Nav", "Square", "Rooms"))
STRAIGHT = np.array([1.0, 0.0], np.float32)
NAN, INF = math.nan, math.inf


def refused(call, rule, error=ValueError):
    """Require an error of one line that begins with a rule, a regular expression."""
    with pytest.raises(error, match=f"^{rule}") as caught:
        call()
    assert "\n" not in str(caught.value)


def vector(id=NAV, **options):
    return gym.make_vec(id, **{"num_envs": 3} | options)


@pytest.fixture(params=[gym.make, vector], ids=["scalar", "vector"])
def maker(request):
    """Make an environment of one or of three."""
    return request.param


NAMES = {
    "integrator": INTEGRATORS,
    "arrival": ("truth", "belief"),
    "switch": ("arrival", "time"),
}


@pytest.mark.parametrize("name", [*NAMES, "observation", "reward"])
def test_an_option_of_another_name_or_type_is_refused_by_its_name(maker, name):
    if name in NAMES:
        known = ", ".join(map(repr, NAMES[name]))
        refused(lambda: maker(SQUARE, **{name: "nonsense"}), f"{name} must be one of {known}, got 'nonsense'")
    for bad in ("", [], 0, 0.5, True, ["x"], {"nonsense": 1.0}, Ellipsis):
        refused(lambda bad=bad: maker(NAV, **{name: bad}), rf"{name}\b")


GYRO = {"Q": (0.0,) * 5, "R": (1.0,) * 3, "kind": Gyro(variance=1e-4, bias_deviation=0.05)}
POSES = r"waypoints must be one or more finite poses \(x, y, theta\), at most 1e\+09 m away, got "


@pytest.mark.parametrize(
    ("options", "rule"),
    [
        *(({"dt": dt}, "dt must be a number from 0.0001 to 10 s, got ") for dt in ("0.1", True, 10.1, 0.9e-4, NAN)),
        *(({"delay": delay}, "delay must be a whole number from 0 to 3, got ") for delay in (1.0, 4, True)),
        *(({"laps": laps}, "laps must be a whole number of at least 1, got ") for laps in (0, True)),
        *(({"waypoints": given}, POSES) for given in ([], 3, "abc", [(1e300, 0.0, 0.0)], [(0.0, NAN, 0.0)])),
        ({"dt": 1e-4, "fix": "late"}, "fix must come at most 25 steps late, got 0.3 s with dt 0.0001 s"),
        ({"reward": {"time": "much"}}, r"reward\['time'\] must be a number from .*, got 'much'"),
        ({"reward": {"speed": 1.0}}, "reward has no term 'speed': its terms on open ground are progress, time, effort, succ"),
        ({"reward": {"tim": 1.0}}, ".* Did you mean 'time'"),
        ({"reward": {"math:pi": 1.0}}, r"reward\['math:pi'\] must be a RewardTerm, got 3.14"),
        ({"reward": {"nosuch:SPIN": 1.0}}, "'nosuch:SPIN' cannot be loaded from .*: No module named 'nosuch'"),
        ({"reward": 3.0}, "reward must be weights by name, such as {'effort': 0.2}, got 3.0"),
        ({"task": "nav", "waypoints": [(1.0, 0.0, 0.0)]}, "waypoints, .* are for tasks with given waypoints: this one draws"),
        ({"world": "dense"}, "world and lidar are for turtlebot_gym/TurtleBotRooms-v0 and its task 'room', got the task"),
        ({"filter": "gyro"}, "filter 'gyro' reads the sensor 'imu': choose one with imu="),
        ({"filter": GYRO}, "The filter reads the sensor 'imu': choose one with imu="),
    ],
    ids=str,
)
def test_invalid_options_are_refused_by_name(maker, options, rule):
    refused(lambda: maker(SQUARE, **options), rule)


@pytest.mark.parametrize(
    ("options", "rule"),
    [
        ({"num_envs": 0}, "num_envs must be a whole number from 1 to 16777216, got 0"),
        ({"info": "some"}, "info must be one of 'default', 'rewards', 'full', got 'some'"),
        ({"autoreset_mode": "later"}, "autoreset_mode must be one of"),
        ({"render_mode": "human"}, "render_mode must be one of"),
        *(({"max_episode_steps": steps}, "Task.max_steps must be a positive number") for steps in (0, -5)),
        *(({"render_rows": rows}, f"render_rows must be a whole number from 1 to 16777216, got {rows}") for rows in (0, 2.5)),
    ],
    ids=str,
)
def test_arguments_of_a_vector_environment_are_refused_by_name(options, rule):
    refused(lambda: vector(**options), rule)


@pytest.mark.parametrize("seed", [1.5, True, "1", -1, NAN, np.float32(1.0), b"1", {}], ids=str)
def test_a_seed_is_a_whole_number(maker, seed):
    refused(lambda: maker(NAV).reset(seed=seed), "seed must be a whole number of at least 0, got ")


@pytest.mark.parametrize(
    ("seed", "rule"),
    [
        *((seed, f"seed must hold 3 seeds, got {len(seed)}") for seed in ((), [1, 2], [1, 2, 3, 4])),
        ([1, 2.5, 3], r"seed\[1\] must be a whole number of at least 0, got 2.5"),
        *(([1, 2, seed], r"seed\[2\] must be a whole number") for seed in (True, -3)),
        (np.array([0.5, 1.0, 2.0]), r"seed\[0\] must be a whole number"),
    ],
    ids=str,
)
def test_a_list_of_seeds_has_one_for_each_environment(seed, rule):
    refused(lambda: vector().reset(seed=seed), rule)


@pytest.mark.parametrize("id", [NAV, ROOMS])
@pytest.mark.parametrize("options", [{"begin": 1}, {3: 4}, {1: 2, "b": 3}, "world", 3, ["reset_mask"]], ids=str)
def test_unknown_options_of_a_reset_are_refused(maker, id, options):
    env = maker(id)
    refused(lambda: env.reset(seed=0, options=options), r"options must be \w")
    refused(lambda: env.unwrapped.step(np.zeros(env.action_space.shape)), r"Call reset\(\) before step", ResetNeeded)


OTHER_MASKS = [[True, False, True], np.ones(2, np.bool_), np.ones((3, 1), np.bool_), np.array([1, 0, 1]), np.zeros(3, np.bool_)]


@pytest.mark.parametrize("mask", OTHER_MASKS, ids=["list", "short", "deep", "numbers", "empty"])
def test_a_mask_of_another_form_is_refused(mask):
    envs = vector()
    envs.reset(seed=0)
    refused(lambda: envs.reset(options={"reset_mask": mask}), "reset_mask must be")


def test_a_mask_cannot_leave_out_what_was_never_reset():
    envs, options = vector(), {"reset_mask": np.array([True, False, True])}
    rule = r"Environment 1: call reset\(\) for all before a reset_mask leaves it out.$"
    for _ in range(2):  # a refused reset begins nothing
        refused(lambda: envs.reset(seed=0, options=options), rule, ResetNeeded)
        refused(lambda: envs.step(np.zeros((3, 2))), "Call reset", ResetNeeded)


@pytest.mark.parametrize("bad", [(NAN, 0.0), (0.0, NAN), (INF, 0.0), (0.0, -INF), (INF, -INF)], ids=str)
def test_an_action_that_is_not_finite_is_refused_with_the_environments_index_and_changes_nothing(maker, bad):
    env, other, row = maker(NAV), maker(NAV), 0 if maker is gym.make else 2
    actions = np.full(env.action_space.shape, 0.5, np.float32)
    for environment in (env, other):
        environment.reset(seed=0)
        environment.step(actions)
    wrong = actions.copy()
    np.atleast_2d(wrong)[row] = bad
    refused(lambda: env.step(wrong), f"Environment {row}: .*finite", InvalidAction)
    np.testing.assert_array_equal(env.step(actions)[0], other.step(actions)[0])


REAL = "An action must hold real numbers, got "
NO_ACTIONS = ({"v": 1.0}, {0.1, 0.2}, None, "ab", [0.1, None], [[0.1], [0.1, 0.2]], 1j * STRAIGHT, STRAIGHT.astype("M8[s]"))
OTHER_SHAPES = [np.zeros(shape, np.float32) for shape in ((), (1,), (3,), (2, 1), (1, 2), (0,))]


@pytest.mark.parametrize(("bad", "rule"), [*((bad, REAL) for bad in NO_ACTIONS), *((bad, ".*shape") for bad in OTHER_SHAPES)])
def test_actions_of_another_kind_or_shape_are_refused(maker, bad, rule):
    env = maker(NAV)
    env.reset(seed=0)
    refused(lambda: env.step(bad), rule, InvalidAction)


def test_stepping_an_ended_environment_is_an_error_where_autoreset_is_disabled():
    env = vector(autoreset_mode="DISABLED", max_episode_steps=3)
    env.reset(seed=0)
    env.step(np.zeros((3, 2), np.float32))
    env.reset(options={"reset_mask": np.array([True, False, False])})
    for _ in range(2):
        _, _, _, truncated, _ = env.step(np.zeros((3, 2), np.float32))
    assert truncated.tolist() == [False, True, True]
    refused(lambda: env.step(np.zeros((3, 2), np.float32)), "Environment 1", Error)


def test_what_cannot_be_drawn_is_refused(maker):
    refused(lambda: NavigationEnv(render_mode="ansi"), "render_mode must be one of")
    refused(lambda: maker(NAV, render_mode="rgb_array").unwrapped.render(), ".*before render", ResetNeeded)
    with pytest.warns(UserWarning, match="needs a render_mode"):
        assert maker(NAV).unwrapped.render() is None


def test_there_is_no_truth_of_rooms_on_open_ground():
    refused(vector().unwrapped.truth, "truth is of rooms")

"""Policies: the tutorial's law to the letter, and a geometric one that reaches its goals; on any batch, with numpy alone."""

import subprocess
import sys

import numpy as np
import pytest
from sights import seen

from turtlebot_gym import ROBOTS, Robot
from turtlebot_gym.observations import Observation
from turtlebot_gym.values import Pose, State
from turtlebot_gym_agents import BearingPolicy, ProportionalPolicy
from turtlebot_gym_agents.evaluation.evaluate import evaluate
from turtlebot_gym_agents.policies import CornerPolicy


def random_sights(count: int, robot: Robot) -> list[tuple[State, Pose, np.ndarray]]:
    random = np.random.default_rng(1)
    sights = []
    for _ in range(count):
        x, y, gx, gy = random.uniform(-2.0, 2.0, 4).tolist()
        theta, g_theta = random.uniform(-np.pi, np.pi, 2).tolist()
        v, omega = (random.uniform(-1.0, 1.0, 2) * (robot.max_linear, robot.max_angular)).tolist()
        state, goal = State(x, y, theta, v, omega), Pose(gx, gy, g_theta)
        sights.append((state, goal, seen(state, goal, robot)))
    return sights


@pytest.mark.parametrize("name", ["tutorial", "burger"])
def test_proportional_policy_is_the_tutorials_law(name):
    robot = ROBOTS[name]
    policy = ProportionalPolicy(robot)
    for state, goal, observation in random_sights(200, robot):
        distance = np.hypot(goal.x - state.x, goal.y - state.y)
        error = np.arctan2(np.sin(goal.theta - state.theta), np.cos(goal.theta - state.theta))
        v = np.clip(0.5 * distance, -robot.max_linear, robot.max_linear)
        omega = np.clip(1.5 * error, -robot.max_angular, robot.max_angular)
        np.testing.assert_allclose(policy(observation) * (robot.max_linear, robot.max_angular), [v, omega], rtol=0, atol=2e-6)


@pytest.mark.parametrize(
    "policy", [ProportionalPolicy(), BearingPolicy(), BearingPolicy("waffle", tolerance=0.0), CornerPolicy()]
)
def test_a_batch_equals_its_rows(policy):
    rows = np.array([observation for *_, observation in random_sights(24, ROBOTS["burger"])])
    actions = policy(rows)
    assert actions.shape == (24, 2)
    assert actions.dtype == np.float32
    assert np.abs(actions).max() <= 1.0
    np.testing.assert_allclose([policy(row) for row in rows], actions, rtol=0, atol=1e-6)
    np.testing.assert_array_equal(policy(rows.reshape(2, 3, 4, 13)), actions.reshape(2, 3, 4, 2))


@pytest.mark.parametrize(("law", "name", "near"), [(BearingPolicy, "tutorial", 1e-6), (CornerPolicy, "burger", 1e-5)])
def test_a_law_is_symmetric_left_to_right_and_front_to_back(law, name, near):
    random, robot, policy = np.random.default_rng(2), ROBOTS[name], law(name)
    for state, goal, _ in random_sights(200, robot):
        o = Observation(*seen(state, goal, robot, Pose(*random.uniform(-2.0, 2.0, 2).tolist(), 0.0)))
        forward, turn = policy(np.array(o))
        mirrored = o._replace(sin_bearing=-o.sin_bearing, sin_next=-o.sin_next, omega=-o.omega)
        np.testing.assert_allclose(policy(np.array(mirrored)), [forward, -turn], rtol=0, atol=near)
        behind = o._replace(
            cos_bearing=-o.cos_bearing, sin_bearing=-o.sin_bearing, cos_next=-o.cos_next, sin_next=-o.sin_next, v=-o.v
        )
        np.testing.assert_allclose(policy(np.array(behind)), [-forward, turn], rtol=0, atol=near)


def test_bearing_policy_decides_on_the_bearing_after_the_commanded_turn():
    robot = ROBOTS["tutorial"]
    goal = Pose(0.0, 1.0, 0.0)
    ahead_by_then = seen(State(0.0, 0.0, -0.1, 0.0, 2.0), goal, robot)  # now at 95.7 degrees, after 0.1 s at 84.3
    behind_by_then = seen(State(0.0, 0.0, 0.1, 0.0, -2.0), goal, robot)
    assert BearingPolicy(robot, dt=0.1)(ahead_by_then)[0] > 0.0
    assert BearingPolicy(robot, dt=0.1)(behind_by_then)[0] < 0.0
    assert BearingPolicy(robot, dt=0.01)(ahead_by_then)[0] < 0.0  # that soon it is still behind


def test_bearing_policy_stops_at_the_goal_and_does_not_reverse_a_robot_that_must_not():
    stopped = BearingPolicy("burger")(seen(State(1.0, 1.0, 0.3, 0.0, 0.0), Pose(1.0, 1.0, 0.0), ROBOTS["burger"]))
    np.testing.assert_array_equal(stopped, 0.0)
    robot = Robot(max_linear=0.2, max_angular=2.0, reverse=False)
    policy = BearingPolicy(robot)
    actions = np.array([policy(observation) for *_, observation in random_sights(200, robot)])
    assert actions[:, 0].min() == 0.0
    right_behind = policy(seen(State(0.0, 0.0, 0.01, 0.0, 0.0), Pose(-1.0, 0.0, 0.0), robot))
    assert right_behind[0] == 0.0
    assert abs(right_behind[1]) == 1.0  # turns on the spot


def seen_at_rest(waypoint: tuple[float, float], following: tuple[float, float]) -> np.ndarray:
    """Return the observation of a robot that stands at the origin and looks along x."""
    return seen(State(0.0, 0.0, 0.0, 0.0, 0.0), Pose(*waypoint, 0.0), ROBOTS["burger"], Pose(*following, 0.0))


@pytest.mark.parametrize(
    ("waypoint", "following", "aim"),
    [
        # A right angle: the bisector runs at 135 degrees; 0.2 m along it.
        ((1.0, 0.0), (1.0, 1.0), (0.858579, 0.141421)),
        # The robot is near: it lies 0.2 cos 45 = 0.141421 m along the bisector, of which 0.75 are taken.
        ((0.2, 0.0), (0.2, 2.0), (0.125, 0.075)),
        # The following waypoint is near: 0.75 of 0.1 cos 45 m.
        ((1.0, 0.0), (1.0, 0.1), (0.9625, 0.0375)),
        # Straight on nothing can be cut; on the way back the edge is enough.
        ((1.0, 0.0), (2.0, 0.0), (1.0, 0.0)),
        ((1.0, 0.0), (0.0, 0.0), (0.8, 0.0)),
        # No waypoint follows.
        ((1.0, 0.5), (1.0, 0.5), (1.0, 0.5)),
    ],
)
def test_corner_policy_steers_to_the_point_inside_the_bend(waypoint, following, aim):
    action = CornerPolicy(cut=0.2, depth=0.75, gain=3.0)(seen_at_rest(waypoint, following))
    np.testing.assert_allclose(action, BearingPolicy(gain=3.0)(seen_at_rest(aim, aim)), rtol=0, atol=1e-5)
    if aim[1] != 0.0 and aim != waypoint:
        assert np.abs(action - BearingPolicy(gain=3.0)(seen_at_rest(waypoint, following)))[1] > 0.005


@pytest.mark.parametrize(
    ("policy", "robot", "noise", "longest"),
    [
        ("bearing", "burger", "documented", 11.01),
        ("bearing", "tutorial", "tutorial", 10.18),
        ("proportional", "tutorial", "tutorial", None),  # the bound can be missed
    ],
)
def test_bearing_policy_reaches_its_goals_and_the_tutorials_law_does_not(policy, robot, noise, longest):
    # More than 5 failures in 1000 fail this: a policy that fails once in 2000 does so for one seed in 7 * 10^4 (binomial), and
    # over 3000 other episodes of each setting this one never failed. The longest mean times there were 10.45 and 9.62 s, with a
    # standard error of 0.14 s for 1000 episodes: the bounds are 4 of those away, one seed in 3 * 10^4.
    summary = evaluate(policy, episodes=1000, robot=robot, noise=noise).summary()
    if longest is None:
        assert summary["success"].high < 0.1
    else:
        assert summary["success"].value >= 0.995
        assert summary["time"].value < longest


def test_policies_need_neither_gymnasium_nor_llvmlite_nor_torch():
    heavy = ("gymnasium", "llvmlite", "torch", "scipy", "matplotlib", "stable_baselines3")
    program = (
        f"import sys\nfor name in {heavy}: sys.modules[name] = None\n"
        "import numpy, turtlebot_gym_agents as a\n"
        "print([a.make_policy(name)(numpy.ones(13, numpy.float32)).shape for name in ('proportional', 'bearing', 'corner')])"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[(2,), (2,), (2,)]"

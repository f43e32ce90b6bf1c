"""Policies by name: which there are, and what each name stands for."""

import math
import re

import numpy as np
import pytest

from turtlebot_gym import ROBOTS
from turtlebot_gym.systems import SIZES
from turtlebot_gym_agents import make_policy
from turtlebot_gym_agents.evaluation.evaluate import NAV, evaluate
from turtlebot_gym_agents.policies import BearingPolicy, PolarPolicy, ProportionalPolicy, RotateDriveRotatePolicy
from turtlebot_gym_agents.policies.bundle import BundlePolicy
from turtlebot_gym_agents.policies.named import pretrained_folder

LAWS = {
    "proportional": ProportionalPolicy,
    "bearing": BearingPolicy,
    "polar": PolarPolicy,
    "rotate-drive-rotate": RotateDriveRotatePolicy,
}
SHIPPED = {
    "ppo-nav": "turtlebot_gym/TurtleBotNav-v0",
    "ppo-pose": "turtlebot_gym/TurtleBotPose-v0",
    "ppo-square": "turtlebot_gym/TurtleBotSquare-v0",
    "ppo-rooms": "turtlebot_gym/TurtleBotRooms-v0",
}
# 2 m away, 0.3 rad to the left, 0.5 rad to turn, driving at half of each limit: every number tells in some law.
SIGHT = np.array(
    [2.0, math.cos(0.3), math.sin(0.3), math.cos(0.5), math.sin(0.5), 0.5, 0.5, 0.05, 0.1, 1.0, 2.0, 1.0, 0.0], np.float32
)


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize(("robot", "dt"), [("burger", 0.1), ("waffle", 0.25)])
def test_a_law_by_name_is_made_for_the_robot_and_the_period(name, robot, dt):
    law = LAWS[name]
    assert type(make_policy(name)) is law
    made = law(robot) if name == "proportional" else law(robot, dt)
    np.testing.assert_array_equal(make_policy(name, robot=robot, dt=dt)(SIGHT), made(SIGHT))
    np.testing.assert_array_equal(make_policy(name, robot=ROBOTS[robot], dt=dt)(SIGHT), made(SIGHT))


@pytest.mark.parametrize("name", LAWS)
def test_without_a_robot_and_a_period_it_is_a_burger_at_10_hz(name):
    np.testing.assert_array_equal(make_policy(name)(SIGHT), make_policy(name, robot="burger", dt=0.1)(SIGHT))
    other = make_policy(name, robot="waffle", dt=0.25)(SIGHT)
    assert not np.array_equal(make_policy(name)(SIGHT), other)  # else the line above said nothing


@pytest.mark.parametrize("name", SHIPPED)
def test_the_shipped_policies_have_their_names_and_tasks(name):
    policy = make_policy(name)
    assert isinstance(policy, BundlePolicy)
    assert (policy.card.env, policy.card.robot["name"], policy.card.dt) == (SHIPPED[name], "burger", 0.1)
    seen = np.resize(SIGHT, SIZES[policy.card.layout])
    assert policy(seen).shape == (2,)
    by_file = make_policy(str(pretrained_folder() / f"{name}.onnx"))
    assert isinstance(by_file, BundlePolicy)
    assert by_file.sha256 == policy.sha256


def test_every_bundle_that_comes_with_the_package_is_listed_above():
    assert {path.stem for path in pretrained_folder().glob("*.onnx")} == set(SHIPPED)


@pytest.mark.parametrize("name", ["ppo-nav", "own.onnx"])
def test_a_bundle_gets_the_robot_and_the_period_that_it_is_to_drive(name, tmp_path):
    if name == "own.onnx":
        (tmp_path / name).write_bytes((pretrained_folder() / "ppo-nav.onnx").read_bytes())
        name = str(tmp_path / name)
    with pytest.raises(ValueError, match="made for 10 Hz burger, asked for 10 Hz waffle"):
        make_policy(name, robot="waffle")
    with pytest.raises(ValueError, match="made for 10 Hz burger, asked for 4 Hz burger"):
        make_policy(name, dt=0.25)


@pytest.mark.parametrize("ending", [".zip", ".pkl", ".pt", ".pth"])
def test_pickled_files_are_refused_with_the_way_out(ending):
    with pytest.raises(ValueError, match=re.escape(f"turtlebot-gym export model{ending} --allow-pickle")):
        make_policy(f"model{ending}")


@pytest.mark.parametrize("name", ["../pretrained/ppo-nav", "ppo-nav\n", "ppo-nav\0", "ppo-", "ppo-nav.onnx.onnx"])
def test_names_are_no_paths(name):
    with pytest.raises((ValueError, OSError)):
        make_policy(name)


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("numpy:pi", "it cannot be called"),
        ("numpy:no_such_name", "module 'numpy' has no attribute 'no_such_name'"),
        ("no_such_module:f", "No module named 'no_such_module'"),
        ("numpy:", ""),
        (":zeros", ""),
        ("numpy", ""),
    ],
)
def test_what_cannot_be_called_is_no_policy(name, reason):
    with pytest.raises(ValueError, match=f"policy must be one of .* or 'module:callable'.*, got '{name}'.*{reason}"):
        make_policy(name)


@pytest.mark.parametrize(
    ("policy", "options", "told"),
    [
        ("ppo-square", {"env": NAV}, "ppo-square: made for turtlebot_gym/TurtleBotSquare-v0 and observation 'ekf'"),
        ("ppo-nav", {"env": NAV, "observation": "odometry"}, f"asked for {NAV} and 'odometry'; --allow-mismatch"),
    ],
)
def test_a_bundle_for_another_task_or_observation_drives_only_if_it_may(policy, options, told):
    with pytest.raises(ValueError, match=told):
        evaluate(policy, episodes=4, **options)
    assert len(evaluate(policy, episodes=4, allow_mismatch=True, **options).episodes.seed) == 4

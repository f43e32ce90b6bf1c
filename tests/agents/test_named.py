"""Policies by name: which there are, and what each name stands for."""

import math
import re

import numpy as np
import pytest

from turtlebot_gym.observations import ROOM
from turtlebot_gym.observations.columns import size_of
from turtlebot_gym_agents import make_policy
from turtlebot_gym_agents.evaluation.evaluate import evaluate
from turtlebot_gym_agents.policies.bundle import BundlePolicy
from turtlebot_gym_agents.policies.fit import ROOMS
from turtlebot_gym_agents.policies.named import shipped_folder

SHIPPED = {
    "ppo-nav": "turtlebot_gym/TurtleBotNav-v0",
    "ppo-pose": "turtlebot_gym/TurtleBotPose-v0",
    "ppo-square": "turtlebot_gym/TurtleBotSquare-v0",
    "ppo-rooms": "turtlebot_gym/TurtleBotRooms-v0",
}
# 2 m away, 0.3 rad to the left, 0.5 rad to turn, driving at half of each limit: every number matters in some law.
SIGHT = np.array(
    [2.0, math.cos(0.3), math.sin(0.3), math.cos(0.5), math.sin(0.5), 0.5, 0.5, 0.05, 0.1, 1.0, 2.0, 1.0, 0.0], np.float32
)


LOCATED = {"env": ROOMS, "world": "office", "noise": "wheel", "localizer": "match", "observation": "located"}


def test_a_policy_is_shown_the_terms_that_it_reads_and_a_bundle_only_those_of_its_training():
    assert evaluate(f"{__name__}:seeing", episodes=1, **LOCATED).summary()["success"].value == 0.0
    with pytest.raises(ValueError, match=r"observation 'ekf', asked for .* 'located'"):
        evaluate("ppo-rooms", episodes=1, **LOCATED)


def seeing(observations):
    """Stand, by 50 numbers."""
    assert observations.shape[-1] == 50
    return np.zeros((*observations.shape[:-1], 2), np.float32)


seeing.terms = ROOM


@pytest.mark.parametrize("name", sorted(path.stem for path in shipped_folder("pretrained").glob("*.onnx")))
def test_the_shipped_policies_have_their_names_and_tasks_and_are_made_for_their_robot_and_period(name):
    policy = make_policy(name)
    assert isinstance(policy, BundlePolicy)
    assert (policy.card.env, policy.card.robot["name"], policy.card.dt) == (SHIPPED[name], "burger", 0.1)
    assert policy(np.resize(SIGHT, size_of(policy.terms))).shape == (2,)
    for reference in (name, str(shipped_folder("pretrained") / f"{name}.onnx")):
        assert make_policy(reference).sha256 == policy.sha256
        for options, wanted in (({"robot": "waffle"}, "10 Hz waffle"), ({"dt": 0.25}, "4 Hz burger")):
            with pytest.raises(ValueError, match=f"made for 10 Hz burger, asked for {wanted}"):
                make_policy(reference, **options)


@pytest.mark.parametrize(
    ("policy", "options", "message"),
    [
        ("ppo-square", {"env": "nav"}, "ppo-square: made for turtlebot_gym/TurtleBotSquare-v0 and observation 'ekf'"),
        ("ppo-nav", {"env": "nav", "observation": "odometry"}, "asked for turtlebot_gym/TurtleBotNav-v0 and 'odometry'"),
        ("ppo-nav", {"env": "nav", "dt": 0.05}, "made for 10 Hz burger, asked for 20 Hz burger"),
    ],
)
def test_a_bundle_for_another_setting_drives_only_if_it_may(policy, options, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        evaluate(policy, episodes=4, **options)
    assert len(evaluate(policy, episodes=4, allow_mismatch=True, **options).episodes.seed) == 4

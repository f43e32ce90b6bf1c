"""Policies in rooms: trained, evaluated, and refused where they do not fit."""

import math

import pytest

from turtlebot_gym.observations import ROOM
from turtlebot_gym.rooms.plan import FloorPlan
from turtlebot_gym.values import Pose
from turtlebot_gym_agents.evaluation.evaluate import evaluate
from turtlebot_gym_agents.policies.bundle import BundlePolicy
from turtlebot_gym_agents.training.config import TrainingConfig
from turtlebot_gym_agents.training.train import train

NAV, ROOMS = (f"turtlebot_gym/TurtleBot{task}-v0" for task in ("Nav", "Rooms"))


def test_metrics_of_one_drive_follow_from_its_geometry():
    """2 m straight on, 0.6 m from a wall: the least clearance is 0.6 - 0.105 m, and the way is as short as it can be."""
    plan = FloorPlan(walls=(0.0, 0.0, 3.0, 3.0), start=Pose(-1.0, 2.4, 0.0), goal=Pose(1.0, 2.4, 0.0))
    evaluation = evaluate("bearing", env=ROOMS, world=plan, lidar="ideal", noise="clean", episodes=1)
    assert evaluation.episodes.clearance == pytest.approx([0.495], abs=0.005)
    assert evaluation.episodes.path == pytest.approx([1.8], abs=0.03)
    assert evaluation.episodes.shortest == pytest.approx([1.8], abs=0.08)
    assert evaluation.summary()["spl"].value == pytest.approx(1.0, abs=0.05)


@pytest.fixture(scope="module")
def bundle(tmp_path_factory):
    folder = tmp_path_factory.mktemp("rooms")
    (folder / "small.yaml").write_text(
        "default: {n_envs: 16, n_timesteps: 1024, policy: MlpPolicy, n_steps: 32, batch_size: 256, n_epochs: 1}"
    )
    config = TrainingConfig(
        env=ROOMS,
        world="clutter",
        lidar="ideal",
        config=folder / "small.yaml",
        evaluations=1,
        episodes=8,
    )
    train(config, folder / "run", progress=False)
    return folder / "run" / "policy.onnx"


def test_a_policy_that_was_trained_in_rooms_drives_in_rooms_and_nowhere_else(bundle):
    policy = BundlePolicy(bundle)
    assert policy.terms == ROOM
    assert policy.card.training["config"]["world"] == "clutter"
    assert math.isfinite(evaluate(policy, env=ROOMS, world="clutter", lidar="ideal", episodes=4).summary()["success"].value)
    with pytest.raises(ValueError, match=f"which {NAV} does not have: choose --env {ROOMS}"):
        evaluate(str(bundle), episodes=4, allow_mismatch=True)


def test_a_policy_of_open_ground_is_refused_in_a_room():
    with pytest.raises(ValueError, match=f"which {ROOMS} shows: choose --env {NAV}"):
        evaluate("ppo-nav", env=ROOMS, episodes=4, allow_mismatch=True)

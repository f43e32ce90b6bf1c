"""Policies in rooms: trained, evaluated, and refused where they do not fit."""

import pytest

from turtlebot_gym.rooms.plan import FloorPlan
from turtlebot_gym.values import Pose
from turtlebot_gym_agents.evaluation.evaluate import evaluate

NAV, ROOMS = (f"turtlebot_gym/TurtleBot{task}-v0" for task in ("Nav", "Rooms"))


def test_metrics_of_one_drive_follow_from_its_geometry():
    """2 m straight on, 0.6 m from a wall: the least clearance is 0.6 - 0.105 m, and the way is as short as it can be."""
    plan = FloorPlan(walls=(0.0, 0.0, 3.0, 3.0), start=Pose(-1.0, 2.4, 0.0), goal=Pose(1.0, 2.4, 0.0))
    evaluation = evaluate("bearing", env=ROOMS, world=plan, lidar="ideal", noise="clean", episodes=1)
    assert evaluation.episodes.clearance == pytest.approx([0.495], abs=0.005)
    assert evaluation.episodes.path == pytest.approx([1.8], abs=0.03)
    assert evaluation.episodes.shortest == pytest.approx([1.8], abs=0.08)
    assert evaluation.summary()["spl"].value == pytest.approx(1.0, abs=0.05)


def test_a_policy_of_open_ground_is_refused_in_a_room():
    with pytest.raises(ValueError, match=f"which {ROOMS} shows: choose --env {NAV}"):
        evaluate("ppo-nav", env=ROOMS, episodes=4, allow_mismatch=True)

"""A policy that stops for people: what it sees of them, and how much that helps."""

import gymnasium as gym
import numpy as np
import pytest

from turtlebot_gym.rooms.lidar import SECTORS
from turtlebot_gym.rooms.plan import FloorPlan
from turtlebot_gym.values import Pose
from turtlebot_gym_agents.evaluation.evaluate import evaluate
from turtlebot_gym_agents.policies import make_policy
from turtlebot_gym_agents.policies.fit import ROOMS
from turtlebot_gym_agents.policies.yielding import BEFORE, FEATURES, Yielding


class Judge:
    """Returns the same probability for all, and keeps the features that it has seen."""

    def __init__(self, probability):
        self.probability, self.seen = probability, []

    def __call__(self, features):
        self.seen.append(features)
        return np.full(len(features), self.probability, np.float32)


def straight(observations):
    return np.full((*np.shape(observations)[:-1], 2), [0.6, 0.2], np.float32)


def farther(judge, world, steps=30):
    """Return by how much the surroundings were farther in the scans before the newest, shape (steps, BEFORE, SECTORS)."""
    env, policy = gym.make(ROOMS, world=world, lidar="ideal", noise="clean"), Yielding(straight, judge)
    observation, _ = env.reset(seed=0)
    policy.reset(np.array([True]))
    for _ in range(steps):
        observation, *_ = env.step(policy(observation[None])[0])
    return np.array([x[0, -BEFORE * SECTORS :].reshape(BEFORE, SECTORS) for x in judge.seen])


@pytest.mark.parametrize("stands", [True, False])
def test_only_walking_people_were_farther_away_before(stands):
    """Also for a robot that drives on an arc, since scans are seen from the place of the newest; edges may jump once."""
    hall = {"walls": (0.0, 0.0, 3.0, 3.0), "start": Pose(0.0, 0.0, 0.0), "goal": Pose(2.5, 2.0, 0.0)}
    shares = []
    for speed in (0.0, -0.8):
        plan = FloorPlan(**hall, circles=((1.3, 0.0, 0.3, 0.0, speed),))
        came = farther(Judge(1.0 if stands else 0.0), plan)
        shares.append((came.max(axis=(1, 2)) > 0.45).mean())
    assert shares[0] <= (0.0 if stands else 0.05)
    assert shares[1] >= 0.25


def test_it_stands_where_the_network_says_so_and_drives_elsewhere():
    rows = np.tile(np.linspace(0.1, 0.9, 50, dtype=np.float32), (4, 1))
    assert (Yielding(straight, Judge(0.6))(rows) == 0.0).all()
    assert (Yielding(straight, Judge(0.6), threshold=0.7)(rows) == straight(rows)).all()


def test_a_robot_sees_the_same_alone_and_in_a_batch_and_forgets_at_a_reset():
    envs = gym.make_vec(ROOMS, num_envs=6, world="people")
    judges = Judge(0.0), Judge(0.0)
    together, alone = (Yielding(straight, judge) for judge in judges)
    observations, _ = envs.reset(seed=3)
    for step in range(40):
        together(observations)
        alone(observations[4])
        if step == 20:
            together.reset(np.arange(6) == 4)
            alone.reset(np.array(True))
        np.testing.assert_array_equal(judges[0].seen[-1][4], judges[1].seen[-1][0])
        observations, *_ = envs.step(straight(observations))
    assert judges[0].seen[-1].shape == (6, FEATURES)
    together.reset(np.ones(6, np.bool_))
    together(observations)
    assert np.abs(judges[0].seen[-1][:, -BEFORE * SECTORS :]).max() < 0.5


@pytest.mark.nightly
def test_the_shipped_network_lets_more_robots_reach_their_goals_among_people():
    """The difference of the shares is over six standard errors here; without a network it is 0."""
    shares = [evaluate(name, env=ROOMS, world="people", episodes=120).summary()["success"] for name in ("vfh", "vfh+yield")]
    assert shares[0].high < shares[1].low


def test_a_policy_that_stops_for_people_needs_the_lidars_observation():
    with pytest.raises(ValueError, match=r"with .*scan"):
        make_policy("vfh+yield")(np.zeros((2, 13), np.float32))

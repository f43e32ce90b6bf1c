"""Observations for tests of policies."""

import numpy as np

from turtlebot_gym import ROBOTS
from turtlebot_gym.observations import goal_from, next_goal_from, twist_of
from turtlebot_gym.rooms.lidar import SECTORS, SIGHT
from turtlebot_gym.values import Pose, State

BURGER = ROBOTS["burger"]
ANGLES = 2.0 * np.pi * np.arange(SECTORS) / SECTORS


def seen(state, goal, robot, following=None):
    """Return an observation on open ground."""
    past = next_goal_from(state, following or goal)
    return np.array([*goal_from(state, goal), *twist_of(state, robot), 0.05, 0.1, 1.0, *past], np.float32)


def sight(goal=(2.0, 0.0, 0.0), *, at=(0.0, 0.0, 0.0), shares=None, age=0.0, v=0.0, omega=0.0):
    """Return an observation in a room."""
    belief = seen(State(*at, v, omega), Pose(*goal), BURGER)
    sectors = np.ones(SECTORS) if shares is None else np.asarray(shares)
    return np.concatenate([belief, sectors, [age]]).astype(np.float32)


def wall_ahead(distance):
    """Return the ranges to a wall at a distance straight ahead, as shares of `SIGHT`."""
    with np.errstate(divide="ignore"):
        lengths = np.where(np.cos(ANGLES) > 0.05, distance / np.cos(ANGLES), np.inf)
    return np.minimum(lengths / SIGHT, 1.0)


def random_sights(count, seed=5):
    random = np.random.default_rng(seed)
    rows = []
    for _ in range(count):
        dense = random.random() < 0.5
        far = random.uniform(0.04, 1.0 if dense else 0.3, SECTORS)
        shares = np.where(random.random(SECTORS) < (0.3 if dense else 0.05), far, 1.0)
        goal = random.uniform(-2.0, 2.0, 2)
        v, omega = random.uniform(-1.0, 1.0, 2) * (BURGER.max_linear, BURGER.max_angular)
        rows.append(sight((*goal.tolist(), 0.0), shares=shares, age=random.uniform(0.0, 0.3), v=v, omega=omega))
    return np.array(rows)

"""Exercise 3: beat VFH+ in the office.

In the world "office" VFH+ reaches four goals of five, and rarely touches anything; in the others it drives up and down until
time runs out. Reach more. Your policy is a class; it may use or change the ones of the package, remember what it did, or
load what you have trained. An observation has 50 numbers, see the page "Environments"; an action has two in [-1, 1].

Look at where it fails: turtlebot-gym watch --env turtlebot_gym/TurtleBotRooms-v0 --world office --policy exercise3:Mine
Then: turtlebot-gym check exercise3.py
"""

import numpy as np

from turtlebot_gym import Robot
from turtlebot_gym_agents.policies.reactive import VectorFieldHistogramPolicy

EXERCISE = 3


class Mine:
    """A policy of your own; this one is VFH+ as it is."""

    terms = ("goal", "twist", "uncertainty", "next_goal", "scan", "scan_age")

    def __init__(self, robot: Robot, dt: float) -> None:
        self.policy = VectorFieldHistogramPolicy(robot, dt)

    def reset(self, mask: np.ndarray) -> None:
        """Forget what is remembered of the episodes where the mask (n,) is true: new ones begin."""
        self.policy.reset(mask)

    def __call__(self, observations: np.ndarray) -> np.ndarray:
        """Return actions (n, 2) for observations (n, 50)."""
        return self.policy(observations)

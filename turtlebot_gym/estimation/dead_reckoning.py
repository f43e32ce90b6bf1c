"""Dead reckoning: odometry moves the belief and corrects nothing, the best that a robot with wheel odometry alone can do."""

from __future__ import annotations

from turtlebot_gym.estimation.ekf import Estimate, predict
from turtlebot_gym.kernel import kernel
from turtlebot_gym.models.angles import sincos
from turtlebot_gym.models.odometry import increment
from turtlebot_gym.parameters import FilterTuning
from turtlebot_gym.values import Belief, Pose, Senses, State


@kernel
def step(estimate: Estimate, before: Senses, senses: Senses, tuning: FilterTuning, dt: float, middle: float) -> Estimate:
    """Move the belief as the odometry moved; its covariance grows with the distance. See `interface.Filter`."""
    x, y, theta, _, _ = estimate.belief.mean
    twist, z = senses.odometry.twist, senses.odometry.pose
    prior = predict(estimate.belief, twist, tuning, dt, middle)
    pose = increment(Pose(x, y, theta), before.odometry.pose, z, sincos(theta - before.odometry.pose.theta))
    return Estimate(Belief(State(pose.x, pose.y, pose.theta, twist.v, twist.omega), prior.covariance), 0.0, 0.0)

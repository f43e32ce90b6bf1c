"""The extended Kalman filter with a gate on the heading alone: an implausible heading does not cost the position."""

from __future__ import annotations

from turtlebot_gym.estimation.ekf import Estimate, correct_position, innovation, predict, settle, wrapped
from turtlebot_gym.estimation.update import of_heading, update
from turtlebot_gym.kernel import kernel
from turtlebot_gym.parameters import FilterTuning
from turtlebot_gym.values import Senses


@kernel
def step(estimate: Estimate, before: Senses, senses: Senses, tuning: FilterTuning, dt: float, middle: float) -> Estimate:
    """Predict, and correct by the position, and by the heading if it is plausible; see `interface.Filter`."""
    odometry = senses.odometry
    prior = predict(estimate.belief, odometry.twist, tuning, dt, middle)
    turn = innovation(prior.mean, odometry.pose).theta
    placed, nis, _, turn = correct_position(prior, odometry.pose, tuning.R, turn)
    turned, nis_theta = update(placed, of_heading(placed.covariance), turn, tuning.R[2])
    is_outlier = nis_theta > tuning.kind.heading_gate
    return settle(estimate, prior, wrapped(turned), wrapped(placed), nis + nis_theta, is_outlier, odometry, tuning)

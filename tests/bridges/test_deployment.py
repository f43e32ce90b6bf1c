"""Train what you deploy: one log through the compiled environment and the blocks without ROS."""

from dataclasses import replace

import numpy as np
import pytest

from turtlebot_gym.compiled.batch import Batch
from turtlebot_gym.systems import Options, make_parameters
from turtlebot_gym.tasks import SQUARE
from turtlebot_gym.values import Pose
from turtlebot_gym_ros.blocks import KalmanFilter, TurtlebotSimulator, VelocityController

STEPS = 150
SEED = 11
GOAL = Pose(1.5, -1.0, 2.0)
ENVIRONMENTS = [("tutorial", "burger", "matched"), ("rough", "burger", "matched"), ("documented", "waffle", "tutorial")]


def blocks(noise, robot, filter):
    """Return the three blocks of the loop; the robot is never done, since the environment goes on as well."""
    return (
        TurtlebotSimulator(TurtlebotSimulator.Params(noise=noise, robot=robot, seed=SEED)),
        KalmanFilter(KalmanFilter.Params(noise=noise, robot=robot, filter=filter)),
        VelocityController(VelocityController.Params(robot=robot, goal_tolerance=0.0)),
    )


def drive(noise, robot, filter):
    """Close the loop without ROS; return odometry, estimates, observations and actions."""
    plant, estimator, controller = blocks(noise, robot, filter)
    rows, command = [], None
    for k in range(STEPS):
        dt = 0.1 if k else 0.0
        odometry = plant.step(0.1, command)["odometry"]
        said = estimator.step(dt, odometry)
        estimate, nis = said["estimate"], said["nis"]
        command = controller.step(dt, estimate, GOAL, None, nis=nis)["command"]
        rows.append((odometry, estimate, controller.deployment.observation, controller.deployment.action))
    return rows


@pytest.mark.parametrize("environment", ENVIRONMENTS)
def test_the_blocks_are_the_compiled_environment(environment):
    """Estimates to 1e-9, and observations to the last bit of float32, over the environment's own steps and drop-outs."""
    noise, robot, filter = environment
    task, waypoints = Options(task=replace(SQUARE, max_steps=1e6), waypoints=[GOAL]).course()
    batch = Batch(1, make_parameters(task, noise=noise, robot=robot, filter=filter), waypoints)
    batch.seeds[0] = SEED
    observation, outcome = batch.empty()
    batch.reset(np.ones(1, np.bool_), observation, outcome)
    measured = 0
    for odometry, estimate, seen, action in drive(noise, robot, filter):
        measured += odometry.measured
        np.testing.assert_allclose(batch.numbers("estimate.belief.mean")[0], estimate.belief.mean, rtol=0.0, atol=1e-9)
        np.testing.assert_allclose(batch.numbers("estimate.belief.covariance")[0], estimate.belief.covariance, atol=1e-9)
        np.testing.assert_allclose(observation[0], seen, rtol=2e-7, atol=1e-9)
        observation, outcome = batch.step(action[None])
    assert measured == STEPS if noise != "rough" else 0.8 * STEPS < measured < STEPS

"""Train what you deploy: one log through the compiled environment, the blocks without ROS, and the live nodes."""

import itertools
import subprocess
import sys
import time
from dataclasses import replace

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped, TwistStamped
from nav_msgs.msg import Odometry
from rclpy.time import Time
from std_msgs.msg import Header

from turtlebot_gym import values
from turtlebot_gym.compiled.batch import Batch
from turtlebot_gym.systems import Options, make_parameters
from turtlebot_gym.tasks import SQUARE, Observation
from turtlebot_gym.values import STOP, Command, Pose
from turtlebot_gym_ros import Shell
from turtlebot_gym_ros.blocks import KalmanFilter, TurtlebotSimulator, VelocityController
from turtlebot_gym_ros.node.convert import conversion

STEPS = 150
SEED = 11
GOAL = Pose(1.5, -1.0, 2.0)
NIS = Observation._fields.index("nis")
ENVIRONMENTS = [("tutorial", "burger", "matched"), ("rough", "burger", "matched"), ("documented", "waffle", "tutorial")]


def blocks(noise, robot, filter):
    """Return the three blocks of the loop; the robot is never done, since the environment goes on as well."""
    return (
        TurtlebotSimulator(TurtlebotSimulator.Params(noise=noise, robot=robot, seed=SEED)),
        KalmanFilter(KalmanFilter.Params(noise=noise, robot=robot, filter=filter)),
        VelocityController(VelocityController.Params(robot=robot, goal_tolerance=0.0)),
    )


def travel(value):
    """Return a value as it arrives at the other end of a topic."""
    way = conversion(type(value))
    return way.read(way.write(value, Header()))


def drive(noise, robot, filter, carry=lambda value: value):
    """Close the loop without ROS; return odometry, commands, estimates, observations and actions.

    Args:
        carry: What happens to a value between two blocks.
    """
    plant, estimator, controller = blocks(noise, robot, filter)
    rows, command = [], None
    for k in range(STEPS):
        dt = 0.1 if k else 0.0
        odometry = plant.step(0.1, command)["odometry"]
        said = estimator.step(dt, carry(odometry))
        estimate, nis = said["estimate"], carry(said["nis"])
        command = controller.step(dt, carry(estimate), carry(GOAL), None, nis=nis)["command"]
        rows.append((odometry, command, estimate, controller.observation, controller.action))
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
    for odometry, _, estimate, seen, action in drive(noise, robot, filter):
        measured += odometry.measured
        np.testing.assert_allclose(batch.numbers("estimate.belief.mean")[0], estimate.belief.mean, rtol=0.0, atol=1e-9)
        np.testing.assert_allclose(batch.numbers("estimate.belief.covariance")[0], estimate.belief.covariance, atol=1e-9)
        np.testing.assert_allclose(observation[0], seen, rtol=2e-7, atol=1e-9)
        observation, outcome = batch.step(action[None])
    assert measured == STEPS if noise != "rough" else 0.8 * STEPS < measured < STEPS


def test_the_way_over_a_topic_costs_nothing():
    plain, carried = drive(*ENVIRONMENTS[1]), drive(*ENVIRONMENTS[1], carry=travel)
    for (_, u, estimate, seen, _), (_, u_carried, estimate_carried, seen_carried, _) in zip(plain, carried, strict=True):
        assert estimate.belief.mean == estimate_carried.belief.mean
        assert u == u_carried
        np.testing.assert_array_equal(seen, seen_carried)
    assert len({float(seen[NIS]) for *_, seen, _ in carried}) > 0.8 * STEPS  # it arrives, and is not one number


class Loop:
    """The live filter and the live controller; the test is the plant, and hands on a message when all have had the last one."""

    def __init__(self, runner, peer, wait_for, environment, **controller):
        noise, robot, filter = environment
        self.wait_for = wait_for
        self.odometry, self.reference = peer.speak("odom", Odometry), peer.speak("reference", PoseStamped)
        self.estimates, self.commands = peer.hear("estimate", Odometry), peer.hear("cmd_vel", TwistStamped)
        overrides = {"noise": noise, "robot": robot, "filter": filter}
        self.filter = Shell(KalmanFilter, KalmanFilter.Params, context=runner.context, overrides=overrides)
        overrides = {"robot": robot, "goal_tolerance": 0.0, "start_enabled": True, **controller}
        self.controller = Shell(VelocityController, VelocityController.Params, context=runner.context, overrides=overrides)
        runner.add(self.filter)
        runner.add(self.controller)
        self.stamp = 0

    def tick(self, odometry, periods=1):
        """Publish odometry as many periods after the last one."""
        self.stamp += periods * 100_000_000
        header = Header(stamp=Time(nanoseconds=self.stamp).to_msg(), frame_id="odom")
        self.reference.publish(conversion(Pose).write(GOAL, header))
        if odometry is not None:
            self.odometry.publish(conversion(values.Odometry).write(odometry, header))

    def match(self):
        """Wait until messages go all the way round and the last one has arrived everywhere, then begin anew."""

        marks = itertools.count(1)

        def has_arrived():
            mark = 0.001 * next(marks)
            self.tick(values.Odometry(Pose(mark, 0.0, 0.0), STOP, True))
            time.sleep(0.1)
            given, estimate = self.controller._feeds["estimate"]._latest, self.filter.block._estimate
            goes_round = self.estimates and self.commands and given and estimate
            filtered = self.filter.block._senses.odometry.pose.x == mark
            return goes_round and filtered and given[0].belief.mean.x == estimate.belief.mean.x

        self.wait_for(has_arrived)
        for shell in (self.filter, self.controller):
            shell.reset("start of the test")
        self.tick(None, periods=100)
        self.wait_for(lambda: self.controller._feeds["reference"]._latest)
        self.estimates.clear()
        self.commands.clear()

    @property
    def last_command(self):
        """The last command that was not a stop."""
        speeds = [conversion(Command).read(message) for message in self.commands]
        return next((speed for speed in reversed(speeds) if speed != STOP), None)


@pytest.mark.parametrize("environment", ENVIRONMENTS[:2])
def test_the_live_nodes_are_the_blocks_to_the_bit(runner, peer, wait_for, environment):
    loop = Loop(runner, peer, wait_for, environment)
    loop.match()
    before = loop.controller._steps
    for k, (odometry, command, estimate, observation, action) in enumerate(drive(*environment, carry=travel)):
        loop.tick(odometry)
        wait_for(lambda n=k + 1: len(loop.estimates) == n)
        wait_for(lambda n=before + k + 1: loop.controller._steps == n)
        wait_for(lambda command=command: loop.last_command == command)  # zeros of the reset may come before the first
        assert conversion(KalmanFilter.outputs["estimate"].type).read(loop.estimates[-1]) == travel(estimate)
        np.testing.assert_array_equal(loop.controller.block.observation, observation)
        np.testing.assert_array_equal(loop.controller.block.action, action)


def test_estimates_that_come_more_slowly_than_the_policy_are_an_error_in_words(runner, peer, wait_for):
    loop = Loop(runner, peer, wait_for, ENVIRONMENTS[0], period=0.05)
    for _ in range(30):
        loop.tick(values.Odometry(Pose(0.0, 0.0, 0.0), STOP, True))
        time.sleep(0.02)
    wait_for(
        lambda: loop.controller.switch.safety.state.endswith("estimate comes every 0.100 s, but a step is due every 0.05 s")
    )


WITHOUT = """
import sys
for name in "rclpy geometry_msgs nav_msgs gymnasium numba torch stable_baselines3 filterpy scipy matplotlib".split():
    sys.modules[name] = None  # its import fails
from turtlebot_gym_ros.blocks import *
from turtlebot_gym.values import Pose
plant = TurtlebotSimulator(TurtlebotSimulator.Params(seed=11))
estimator = KalmanFilter(KalmanFilter.Params())
controller = VelocityController(VelocityController.Params(goal_tolerance=0.0))
generator = WaypointGenerator(WaypointGenerator.Params())
command = None
for k in range(20):
    odometry = plant.step(0.1, command)["odometry"]
    estimate = estimator.step(0.1 * (k > 0), odometry)["estimate"]
    out = generator.step(0.1, estimate, None)
    command = controller.step(0.1, estimate, Pose(1.5, -1.0, 2.0), None)["command"]
    print(*(number.hex() for number in (*estimate.belief.mean, *command)))
"""


def test_the_blocks_run_to_the_bit_where_a_robot_has_nothing_but_numpy():
    done = subprocess.run([sys.executable, "-c", WITHOUT], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    here = [(*estimate.belief.mean, *command) for _, command, estimate, _, _ in drive(*ENVIRONMENTS[0])[:20]]
    there = [tuple(map(float.fromhex, line.split())) for line in done.stdout.splitlines()]
    assert there == here

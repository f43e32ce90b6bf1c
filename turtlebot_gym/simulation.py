"""The one transition where it all meets: robot, odometry, filter and task, for a single environment, as pure functions."""

from __future__ import annotations

import math
from typing import NamedTuple

from turtlebot_gym.estimation.ekf import Estimate, initialize, step
from turtlebot_gym.kernel import kernel, sqrt
from turtlebot_gym.models.odometry import measure
from turtlebot_gym.models.random import EVENTS, HEADING, POSITION, PROCESS, SLIP, normals, uniforms
from turtlebot_gym.models.unicycle import INTEGRATORS, accelerate, advance, execute, limit, slips
from turtlebot_gym.parameters import REFERENCE_PERIOD, FilterTuning, Noise, OdometryNoise, Reward
from turtlebot_gym.presets import make_filter, make_noise, make_robot
from turtlebot_gym.robots import Robot
from turtlebot_gym.tasks import (
    NAV,
    Observation,
    Task,
    arrived,
    distance_to,
    draw_start,
    observe,
    reward_of,
    stated_deviations,
)
from turtlebot_gym.validation import choose
from turtlebot_gym.values import Command, Pose, State

OBSERVED = {"ekf": 0.0, "odometry": 1.0, "truth": 2.0}
"""What the policy is shown as the robot's pose."""


MAX_DELAY = 3
"""Longest delay of a command, steps."""


class Parameters(NamedTuple):
    """All that an environment's transition depends on, besides its state and its key."""

    robot: Robot
    noise: Noise
    tuning: FilterTuning
    task: Task
    reward: Reward
    dt: float
    """Control interval, s."""
    middle: float
    """The integrator, a value of `models.unicycle.INTEGRATORS`."""
    observed: float
    """A value of `OBSERVED`."""
    delay: float
    """Steps by which a command comes late, 0 to `MAX_DELAY`."""


def make_parameters(
    task: Task = NAV,
    *,
    robot: str | Robot = "burger",
    noise: str | Noise = "tutorial",
    filter: str | FilterTuning = "matched",
    integrator: str = "euler",
    observation: str = "ekf",
    reward: Reward | None = None,
    dt: float = REFERENCE_PERIOD,
    delay: int = 0,
) -> Parameters:
    """Return the parameters of an environment, checked, from presets' names or values.

    Args:
        task: When waypoints count as reached, and when an episode ends.
        robot: A name in `robots.ROBOTS`, or a robot.
        noise: A name in `presets.NOISES`, or a noise model.
        filter: "matched", "tutorial" or a tuning.
        integrator: "euler" or "midpoint".
        observation: What the policy is shown as the robot's pose: "ekf", "odometry" or "truth".
        reward: Weights; None for the default ones.
        dt: Control interval, s.
        delay: Steps by which a command comes late, 0 to 3.

    Raises:
        ValueError: If a name is unknown, dt is not positive, or the delay is out of its range.
    """
    if delay not in range(MAX_DELAY + 1):
        raise ValueError(f"delay must be a whole number from 0 to {MAX_DELAY}, got {delay!r}.")
    if not 0.0 < dt < math.inf:
        raise ValueError(f"dt must be positive and finite, got {dt!r}.")
    model = make_noise(noise)
    return Parameters(
        make_robot(robot),
        model,
        make_filter(filter, model),
        task,
        reward or Reward(),
        float(dt),
        choose("integrator", integrator, INTEGRATORS),
        choose("observation", observation, OBSERVED),
        float(delay),
    )


class World(NamedTuple):
    """All that an environment remembers from step to step."""

    true_state: State
    odometry: Pose
    """The last measurement that arrived."""
    estimate: Estimate
    command: Command
    """The command in force, within the robot's limits."""
    asked: tuple[Command, Command, Command]
    """The last `MAX_DELAY` commands that the policy asked for, the newest first."""
    reference: Pose
    """The waypoint to reach."""
    following: Pose
    """The one after it; itself where there is none."""
    wheels: Pose
    """The pose that the wheels have integrated."""
    slipping: bool
    visited: float
    """Waypoints done with."""
    steps: float


class Outcome(NamedTuple):
    """What a step has come to."""

    reward: float
    distance: float
    """True distance to the waypoint to reach, m."""
    is_success: bool
    terminated: bool
    truncated: bool
    reached: bool
    """Whether a waypoint was done with: the next one is then to be set by `retarget`."""


@kernel
def _believed(world: World, observed: float) -> State:
    """Return the state that the policy is shown."""
    mean, z, truth, u = world.estimate.belief.mean, world.odometry, world.true_state, world.command
    ekf, odometry = observed == 0.0, observed == 1.0
    return State(
        mean.x if ekf else (z.x if odometry else truth.x),
        mean.y if ekf else (z.y if odometry else truth.y),
        mean.theta if ekf else (z.theta if odometry else truth.theta),
        mean.v if ekf else (u.v if odometry else truth.v),
        mean.omega if ekf else (u.omega if odometry else truth.omega),
    )


@kernel
def look(world: World, p: Parameters) -> Observation:
    """Return what the policy observes of a world."""
    position, heading = stated_deviations(world.estimate.belief.covariance)
    ekf, odometry = p.observed == 0.0, p.observed == 1.0
    R = p.tuning.R
    std = (
        position if ekf else (sqrt(R[0] + R[1]) if odometry else 0.0),
        heading if ekf else (sqrt(R[2]) if odometry else 0.0),
    )
    nis = world.estimate.nis if ekf else 0.0
    return observe(_believed(world, p.observed), std, nis, world.reference, world.following, p.robot)


@kernel
def measurement(key: int, at: int, pose: Pose, wheels: Pose, noise: OdometryNoise) -> tuple[Pose, bool]:
    """Return the odometry of a step, and whether it arrives.

    Args:
        key: The episode's key.
        at: The step's number.
        pose: The true pose.
        wheels: The pose that the wheels have integrated.
        noise: What is measured, and how well.
    """
    heading, _ = normals(key, at, HEADING)
    event, dropout = uniforms(key, at, EVENTS)
    z = measure(pose, wheels, noise, normals(key, at, POSITION), heading, event)
    return z, dropout >= noise.dropout_probability


@kernel
def start_pose(key: int, p: Parameters) -> Pose:
    """Return the pose in which an episode starts."""
    return draw_start(key, p.task) if p.task.random else Pose(0.0, 0.0, 0.0)


@kernel
def begin(key: int, p: Parameters) -> World:
    """Return the world in which an episode starts: at rest, with a first measurement, which always arrives.

    Its waypoints are still to be set, by `retarget`.

    Args:
        key: The episode's key, from `models.noise.episode_key`.
        p: Parameters.
    """
    pose = start_pose(key, p)
    z, _ = measurement(key, 0, pose, pose, p.noise.odometry)
    truth = State(pose.x, pose.y, pose.theta, 0.0, 0.0)
    rest = Command(0.0, 0.0)
    return World(truth, z, initialize(z, p.tuning), rest, (rest, rest, rest), pose, pose, pose, False, 0.0, 0.0)


@kernel
def _remaining(truth: State, reference: Pose, following: Pose, done_with: bool) -> float:
    """Return the way that is left, counted as far as the reference, m; below zero beyond it.

    Where the reference is done with, the robot is on its way to the one that follows. So what a corner's cut saves counts as
    progress, and the progress of a whole course is its length whichever way it was driven: only time and effort differ.
    """
    dx, dy = following.x - reference.x, following.y - reference.y
    leg = sqrt(dx * dx + dy * dy)
    return distance_to(truth, following) - leg if done_with else distance_to(truth, reference)


@kernel
def transition(world: World, command: Command, key: int, waypoints: int, p: Parameters) -> tuple[World, Outcome]:
    """Advance an environment by one control interval.

    Args:
        world: Its state.
        command: The twist that the policy asks for; m/s, rad/s.
        key: The episode's key.
        waypoints: How many waypoints the task has.
        p: Parameters.

    Returns:
        The world after it, and what the step has come to. Where that says ``reached``, `retarget` is still to be called.
    """
    dt, noise, task = p.dt, p.noise, p.task
    steps = world.steps + 1.0
    at = int(steps)
    first, second, third = world.asked
    late = third if p.delay > 2.5 else (second if p.delay > 1.5 else first)
    due_command = Command(late.v if p.delay > 0.5 else command.v, late.omega if p.delay > 0.5 else command.omega)
    asked = (command, first, second)
    command = accelerate(world.command, limit(due_command, p.robot), p.robot, dt)

    # The plant: the pose moves with the twist of the interval before, then the twist follows the command.
    before = world.true_state
    pose = advance(Pose(before.x, before.y, before.theta), before.v, before.omega, dt, p.middle)
    wheels = advance(world.wheels, world.command.v, world.command.omega, dt, p.middle)
    slip_draw, _ = uniforms(key, at, SLIP)
    slipping = slips(world.slipping, noise.process, slip_draw, dt)
    twist = execute(command, noise.process, slipping, normals(key, at, PROCESS), dt)
    truth = State(pose.x, pose.y, pose.theta, twist.v, twist.omega)

    # The odometry and the filter.
    z, measured = measurement(key, at, pose, wheels, noise.odometry)
    last = world.odometry
    z = Pose(z.x if measured else last.x, z.y if measured else last.y, z.theta if measured else last.theta)
    estimate = step(world.estimate, command, last, z, measured, p.tuning, dt, p.middle)

    # The task.
    reference = world.reference
    moved = World(truth, z, estimate, command, asked, reference, world.following, wheels, slipping, world.visited, steps)
    there = arrived(truth, reference, task)
    reached = arrived(_believed(moved, p.observed), reference, task) if task.on_belief else there
    by_time = task.switch_period < math.inf
    due = steps * dt > (world.visited + 1.0) * task.switch_period - 0.5 * dt
    done_with = due if by_time else reached
    visited = world.visited + (1.0 if done_with else 0.0)
    terminated = visited >= waypoints * task.laps and not by_time
    success = terminated and there
    distance = distance_to(truth, reference)
    ahead = _remaining(truth, reference, world.following, done_with and not by_time)
    reward = reward_of(distance_to(before, reference), ahead, command, success, p.reward, p.robot, dt)
    truncated = steps >= task.max_steps and not terminated
    outcome = Outcome(reward, distance, success, terminated, truncated, done_with)
    return World(truth, z, estimate, command, asked, reference, world.following, wheels, slipping, visited, steps), outcome


@kernel
def retarget(world: World, waypoints, p: Parameters) -> World:
    """Return the world with the waypoint that is next after those visited, and the one that follows it.

    Args:
        world: The world.
        waypoints: Shape (M, 3), or M poses, to be visited `Task.laps` times in turn; the last one stays.
        p: Parameters.
    """
    last = len(waypoints) * p.task.laps - 1.0
    now = waypoints[int(min(world.visited, last)) % len(waypoints)]
    then = waypoints[int(min(world.visited + 1.0, last)) % len(waypoints)]
    reference, following = Pose(now[0], now[1], now[2]), Pose(then[0], then[1], then[2])
    w = world
    return World(
        w.true_state,
        w.odometry,
        w.estimate,
        w.command,
        w.asked,
        reference,
        following,
        w.wheels,
        w.slipping,
        w.visited,
        w.steps,
    )

"""Open ground: a unicycle on an empty floor, with odometry, a filter of the pose, and waypoints to reach.

The kernels of a step, in the order in which they run; `systems.system` documents their arguments and results.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

from turtlebot_gym.estimation.interface import Filter
from turtlebot_gym.kernel import kernel
from turtlebot_gym.models.odometry import counted
from turtlebot_gym.models.random import PROCESS, SLIP, normals, uniforms
from turtlebot_gym.models.unicycle import INTEGRATORS, accelerate, advance, execute, limit, slips
from turtlebot_gym.observations import OPEN_GROUND, Observed, observed_state
from turtlebot_gym.presets import TUTORIAL, matched
from turtlebot_gym.rewards import ON_GROUND
from turtlebot_gym.robots import ROBOTS
from turtlebot_gym.systems.parameters import Parameters
from turtlebot_gym.systems.sensors import ODOMETRY
from turtlebot_gym.systems.system import System
from turtlebot_gym.systems.world import Body, Outcome
from turtlebot_gym.tasks import TASKS, arrived, believed_to_arrive, by_time, distance_to, draw_goal, due, start_pose
from turtlebot_gym.values import Command, Pose, State


@kernel
def _lay_out(key, p, scene):
    pose = start_pose(key, p.task)
    return pose, draw_goal(key, pose, p.task)


@kernel
def _start(pose):
    rest = Command(0.0, 0.0)
    return Body(State(pose.x, pose.y, pose.theta, 0.0, 0.0), rest, (rest, rest, rest), pose, False)


@kernel
def _move(body, command, key, at, p):
    """Move the pose with the current twist; then the twist follows the command, as far as the wheels slip and noise allows.

    The wheels turn as commanded and do not feel slip; their pose is kept for wheel odometry only, otherwise it is the true one.
    """
    dt, noise = p.dt, p.noise.process
    first, second, third = body.asked
    late = third if p.delay >= 3.0 else (second if p.delay >= 2.0 else first)
    asked = late if p.delay >= 1.0 else command
    now = accelerate(body.command, limit(asked, p.robot), p.robot, dt)
    truth = body.true_state
    pose = advance(Pose(truth.x, truth.y, truth.theta), truth.v, truth.omega, dt, p.integrator)
    # What nothing reads is not worked out: a large batch takes as long as its memory.
    rolled = advance(body.wheels, body.command.v, body.command.omega, dt, p.integrator)
    rolled = counted(body.wheels, rolled, body.command.v, p.noise.odometry, key, at, dt)
    is_rolled, is_late = p.noise.odometry.wheel, p.delay > 0.0
    wheels = rolled if is_rolled else pose
    queue = (command if is_late else first, first if is_late else second, second if is_late else third)
    slip_draw, _ = uniforms(key, at, SLIP)
    slipping = slips(body.slipping, noise, slip_draw, dt)
    twist = execute(now, noise, slipping, normals(key, at, PROCESS), dt)
    return Body(State(pose.x, pose.y, pose.theta, twist.v, twist.omega), now, queue, wheels, slipping)


@kernel
def _judge(world, after, waypoints, p):
    """Return the number of waypoints visited, and the outcome of the step but for its reward.

    It terminates at the last waypoint, unless time switches them, and is truncated at ``max_steps``.
    """
    task, reference, truth = p.task, world.course.reference, after.body.true_state
    steps, visited = after.steps, world.course.visited
    is_there = arrived(truth, reference, task)
    body, senses, estimate = after.body, after.senses, after.estimate
    reached = believed_to_arrive(observed_state(body, senses, estimate, p), reference, task) if task.on_belief else is_there
    timed, is_due = by_time(task), due(steps, visited, task, p.dt)
    done_with = is_due if timed else reached
    visited = visited + (1.0 if done_with else 0.0)
    terminated = visited >= waypoints * task.laps and not timed
    success = terminated and is_there
    truncated = steps >= task.max_steps and not terminated
    return visited, Outcome(0.0, distance_to(truth, reference), success, terminated, truncated, done_with)


_EXAMPLE = Parameters(
    ROBOTS["burger"], TUTORIAL, matched(TUTORIAL), TASKS["nav"], (), 0.1, INTEGRATORS["euler"], Observed.EKF, 0.0
)


@cache
def open_ground(filter: Filter) -> System:
    """Return the system of open ground with a filter."""
    begin, step = filter.start, filter.step

    @kernel
    def first_estimate(senses, p):
        return begin(senses, p.tuning)

    @kernel
    def estimate(estimate, before, senses, p):
        return step(estimate, before, senses, p.tuning, p.dt, p.integrator)

    return System(
        lay_out=_lay_out,
        start=_start,
        move=_move,
        sensors=(ODOMETRY,),
        first_estimate=first_estimate,
        estimate=estimate,
        judge=_judge,
        rewards=ON_GROUND,
        terms=OPEN_GROUND,
        example=_EXAMPLE._replace(tuning=replace(_EXAMPLE.tuning, kind=filter.kind)),
        compiled=filter.compiled,
    )

"""Open ground with a physics engine in the unicycle's place: what moves the robot, and what its wheels tell of it.

The engine takes the place of the noise of execution too: `Noise.process` moves nothing here, a filter that is matched to it
assumes it all the same. The pose is measured as ever, with the noise of the odometry, or it is what the wheels' angles have
integrated; the twist is what they tell.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

from turtlebot_gym.models import odometry
from turtlebot_gym.plants.burger import MujocoBurger
from turtlebot_gym.plants.engine import engine_of
from turtlebot_gym.systems.open_ground import obey
from turtlebot_gym.systems.system import System
from turtlebot_gym.values import STOP, Command, Pose, Senses, State


class PhysicalBody(NamedTuple):
    """The robot as it really is; a `systems.world.Body` with what the engine knows of it."""

    true_state: State
    command: Command
    """See `Body`, as of the next three."""
    asked: tuple[Command, Command, Command]
    wheels: Pose
    slipping: bool
    """Never: what slip there is comes from the friction, all the time."""
    twist: Command
    """What the wheels' angles tell."""
    physics: tuple[float, ...]
    """See `plants.engine.Driven`."""


def sense(body, before, key, at, p):
    """Return what the odometry says: see `open_ground.sense`; the twist is what the wheels' angles tell."""
    truth = body.true_state
    pose = Pose(truth.x, truth.y, truth.theta)
    return odometry.sense(pose, body.wheels, body.twist, before, p.noise.odometry, key, at)


def first_sense(body, key, p):
    """Return what the odometry says at the start, where a measurement always arrives."""
    return sense(body, Senses(body.wheels, body.twist, True), key, 0, p)


@cache
def physical(system: System, burger: MujocoBurger) -> System:
    """Return a system of open ground with a Burger in MuJoCo as its plant, in plain Python.

    Raises:
        ImportError: If mujoco is not installed.
    """
    engine = engine_of(burger)

    def start(pose):
        """Return the body at rest in a pose."""
        state = State(pose.x, pose.y, pose.theta, 0.0, 0.0)
        return PhysicalBody(state, STOP, (STOP, STOP, STOP), pose, False, STOP, engine.start(pose))

    def move(body, command, key, at, p):
        """Return the body after an interval: the motors follow the command in force, and at last the new one."""
        now = obey(body, command, p)
        driven = engine.drive(body.physics, body.wheels, (body.command, now), p.dt)
        asked = (command, *body.asked[:2])
        return PhysicalBody(driven.truth, now, asked, driven.wheels, False, driven.twist, driven.physics)

    return system._replace(
        start=start,
        move=move,
        sense=sense,
        first_sense=first_sense,
        example=system.example._replace(plant=burger),
        compiled=False,
    )

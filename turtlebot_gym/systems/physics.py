"""Open ground with a physics engine in place of the unicycle, which moves the robot and turns its wheels.

The engine also replaces the noise of execution: `Noise.process` has no effect on the motion, though a matched filter still
assumes it. The pose is measured with the noise of the odometry as usual, or integrated from the wheel angles, which also give
the twist.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

from turtlebot_gym.models import odometry
from turtlebot_gym.plants import MujocoBurger, engine_of
from turtlebot_gym.systems.open_ground import obey
from turtlebot_gym.systems.sensors import Sensor
from turtlebot_gym.systems.system import System
from turtlebot_gym.values import STOP, Command, Odometry, Pose, State


class _PhysicalBody(NamedTuple):
    """True state of the robot: a `systems.world.Body` with its physics state."""

    true_state: State
    command: Command
    """See `Body`, as for the next three fields."""
    asked: tuple[Command, Command, Command]
    wheels: Pose
    slipping: bool
    """Always false: slip comes from friction, without bursts."""
    twist: Command
    """Twist from the wheel angles."""
    physics: tuple[float, ...]
    """See `plants._Driven`."""


def _sense(body, before, key, at, p):
    """Sense as `sensors.ODOMETRY` does, with the wheels' own twist."""
    truth, (v, omega), noise = body.true_state, body.twist, p.noise.odometry
    pose = Pose(truth.x, truth.y, truth.theta)
    twist = Command(-v if odometry.miscounts(v, noise, key, at, p.dt) else v, omega)
    return odometry.sense(pose, body.wheels, twist, before, noise, key, at)


def _first_sense(body, key, p):
    """Return the odometry at the start, where a measurement always arrives."""
    return _sense(body, Odometry(body.wheels, body.twist, True), key, 0, p)


@cache
def physical(system: System, burger: MujocoBurger) -> System:
    """Return a system of open ground with a Burger in MuJoCo as its plant, in plain Python.

    Raises:
        ImportError: If mujoco is not installed.
    """
    engine = engine_of(burger)

    def start(pose):
        state = State(pose.x, pose.y, pose.theta, 0.0, 0.0)
        return _PhysicalBody(state, STOP, (STOP, STOP, STOP), pose, False, STOP, engine.start(pose))

    def move(body, command, key, at, p):
        """Let the motors follow the command in force, and towards the end the new one."""
        now = obey(body, command, p)
        driven = engine.drive(body.physics, body.wheels, (body.command, now), p.dt)
        asked = (command, *body.asked[:2])
        wheels = odometry.counted(body.wheels, driven.wheels, driven.twist.v, p.noise.odometry, key, at, p.dt)
        return _PhysicalBody(driven.truth, now, asked, wheels, False, driven.twist, driven.physics)

    system = system.with_sensor(Sensor("odometry", _first_sense, _sense))
    return system._replace(start=start, move=move, example=system.example._replace(plant=burger), compiled=False)

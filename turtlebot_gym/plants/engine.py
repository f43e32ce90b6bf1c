"""A TurtleBot3 Burger in MuJoCo, as a pure function from the physics state to that of one control interval later.

The whole physics state of a robot is a tuple of numbers, which an environment keeps like the rest of its state. So results
depend on the seed alone, not on earlier drives, and one engine serves any number of environments.

References:
    Todorov, Erez, Tassa, "MuJoCo: A physics engine for model-based control", *IROS* (2012).
"""

from __future__ import annotations

import math
from functools import cache
from importlib import import_module
from threading import Lock
from typing import Any, NamedTuple

import numpy as np

from turtlebot_gym.models.angles import wrap, yaw_of_quaternion
from turtlebot_gym.models.unicycle import Integrator, advance
from turtlebot_gym.plants.burger import MujocoBurger
from turtlebot_gym.values import Command, Pose, State

SETTLING = 0.5
"""Time for the robot to settle on its contacts when the engine is made, s."""
_POSE = slice(0, 7)
"""Range of the base's position and quaternion in a state."""

_MODEL = """
<mujoco model="turtlebot3_burger">
  <option timestep="{step}" integrator="implicitfast" cone="elliptic" impratio="10"/>
  <default><geom contype="0" conaffinity="0"/><pair condim="3" solref="0.005 1"/></default>
  <worldbody>
    <geom name="floor" type="plane" size="0 0 1"/>
    <body name="base" pos="0 0 0.010">
      <freejoint/>
      <inertial pos="{center}" mass="{base_mass}" diaginertia="{base_inertia}"/>
      <body pos="-0.081 0 {caster_height}">
        <geom name="caster" type="sphere" size="{caster_radius}" mass="{caster_mass}"/>
      </body>
      <body pos="-0.032 0 0.172">
        <geom type="cylinder" size="0.055 0.01575" mass="{lidar_mass}"/>
      </body>
      <body name="left" pos="0 {half} {axle}">
        <joint name="left" axis="0 1 0" armature="{armature}"/>
        <inertial pos="0 0 0" mass="{wheel_mass}" diaginertia="{wheel_inertia}"/>
        <geom name="left" type="{wheel}" size="{size}" zaxis="0 1 0"/>
      </body>
      <body name="right" pos="0 -{half} {axle}">
        <joint name="right" axis="0 1 0" armature="{armature}"/>
        <inertial pos="0 0 0" mass="{wheel_mass}" diaginertia="{wheel_inertia}"/>
        <geom name="right" type="{wheel}" size="{size}" zaxis="0 1 0"/>
      </body>
    </body>
  </worldbody>
  <contact>
    <pair geom1="floor" geom2="left" friction="{friction} {friction} 0 0 0"/>
    <pair geom1="floor" geom2="right" friction="{friction} {friction} 0 0 0"/>
    <pair geom1="floor" geom2="caster" friction="{caster_friction} {caster_friction} 0 0 0"/>
  </contact>
  <actuator>
    <velocity joint="left" kv="{motor_gain}" forcerange="-{motor_torque} {motor_torque}"/>
    <velocity joint="right" kv="{motor_gain}" forcerange="-{motor_torque} {motor_torque}"/>
  </actuator>
</mujoco>"""


class _Driven(NamedTuple):
    truth: State
    wheels: Pose
    """Pose integrated from the wheel angles."""
    twist: Command
    """Twist from the last reading of the wheel angles."""
    physics: tuple[float, ...]
    """Physics state of the robot."""


class Engine:
    """MuJoCo with the model of a Burger.

    Args:
        burger: The robot.

    Raises:
        ImportError: If mujoco is not installed.
    """

    def __init__(self, burger: MujocoBurger) -> None:
        try:
            mujoco: Any = import_module("mujoco")  # large, and rarely needed
        except ImportError as error:
            raise ImportError("The plant 'mujoco' needs MuJoCo: pip install 'turtlebot-gym[mujoco]'.") from error
        self._burger, self._mujoco = burger, mujoco
        self._model = mujoco.MjModel.from_xml_string(_model_of(burger))
        self._data = mujoco.MjData(self._model)
        self._kept = int(mujoco.mjtState.mjSTATE_PHYSICS) | int(mujoco.mjtState.mjSTATE_WARMSTART)
        self._state = np.zeros(mujoco.mj_stateSize(self._model, self._kept))
        self._lock = Lock()  # nodes in one process may each have a thread
        mujoco.mj_step(self._model, self._data, round(SETTLING / burger.step))
        self._data.qpos[:2] = 0.0
        self._data.qvel[:] = 0.0
        self._resting = self._read()

    def start(self, pose: Pose) -> tuple[float, ...]:
        """Return the physics state of a robot at rest in a pose."""
        turn, lying = _about_z(pose.theta), self._resting[3:7]
        return (pose.x, pose.y, self._resting[2], *_product(turn, lying), *self._resting[7:])

    def drive(self, physics: tuple[float, ...], wheels: Pose, commands: tuple[Command, Command], dt: float) -> _Driven:
        """Drive for a control interval.

        Args:
            physics: Physics state at the start of the interval.
            wheels: The pose that odometry has integrated.
            commands: The twist to which the motors are set at the start, and the one in force at the end.
            dt: The interval, s.

        Raises:
            ValueError: If the interval is not a multiple of the engine's step.
        """
        steps, lead = self._burger.steps(dt)
        reading = max(1, round(self._burger.reading / self._burger.step))
        twist = Command(0.0, 0.0)
        with self._lock:
            self._mujoco.mj_setState(self._model, self._data, np.array(physics), self._kept)
            for command, rest in zip(commands, (steps - lead, lead), strict=True):
                rim, radius = 0.5 * command.omega * self._burger.wheel_separation, self._burger.wheel_radius
                self._data.ctrl[:] = (command.v - rim) / radius, (command.v + rim) / radius
                while rest > 0:
                    count = min(rest, reading)
                    angles = self._angles()
                    self._mujoco.mj_step(self._model, self._data, count)
                    time = count * self._burger.step
                    twist = self._rolled(angles, time)
                    wheels = advance(wheels, twist.v, twist.omega, time, Integrator.MIDPOINT)
                    rest -= count
            return _Driven(self._truth(), wheels, twist, self._read())

    def _angles(self) -> tuple[float, float]:
        left, right = self._data.qpos[7:9].tolist()
        return left, right

    def _rolled(self, before: tuple[float, float], time: float) -> Command:
        """Return the mean twist since an earlier reading of the wheel angles."""
        left, right = (after - at for after, at in zip(self._angles(), before, strict=True))
        per_time = self._burger.wheel_radius / time
        return Command(0.5 * (right + left) * per_time, (right - left) * per_time / self._burger.wheel_separation)

    def _truth(self) -> State:
        x, y, _, w, i, j, k = self._data.qpos[_POSE].tolist()
        theta = wrap(yaw_of_quaternion(w, i, j, k))
        vx, vy, *_, omega = self._data.qvel[:6].tolist()
        return State(x, y, theta, vx * math.cos(theta) + vy * math.sin(theta), omega)

    def _read(self) -> tuple[float, ...]:
        self._mujoco.mj_getState(self._model, self._data, self._state, self._kept)
        return tuple(self._state.tolist())


@cache
def engine_of(burger: MujocoBurger) -> Engine:
    """Return the engine for a robot; each robot has one."""
    return Engine(burger)


def _model_of(burger: MujocoBurger) -> str:
    """Return MuJoCo's model of a robot, an MJCF document."""
    radius, half_width = burger.wheel_radius, 0.5 * burger.wheel_width
    size = (radius, half_width) if burger.cylinders else (radius, radius, half_width)
    return _MODEL.format(
        step=burger.step,
        center=_words(burger.base_center),
        base_mass=burger.base_mass,
        base_inertia=_words(burger.base_inertia),
        caster_radius=burger.caster_radius,
        caster_height=burger.caster_radius - 0.010,
        caster_mass=burger.caster_mass,
        lidar_mass=burger.lidar_mass,
        half=0.5 * burger.wheel_separation,
        axle=radius - 0.010,
        armature=burger.armature,
        wheel_mass=burger.wheel_mass,
        wheel_inertia=_words(burger.wheel_inertia),
        wheel="cylinder" if burger.cylinders else "ellipsoid",
        size=_words(size),
        friction=burger.friction,
        caster_friction=burger.caster_friction,
        motor_gain=burger.motor_gain,
        motor_torque=burger.motor_torque,
    )


def _words(numbers: tuple[float, ...]) -> str:
    return " ".join(map(repr, numbers))


def _about_z(angle: float) -> tuple[float, float, float, float]:
    """Return the quaternion of a turn about the vertical."""
    return math.cos(0.5 * angle), 0.0, 0.0, math.sin(0.5 * angle)


def _product(p: tuple[float, ...], q: tuple[float, ...]) -> tuple[float, ...]:
    """Return the quaternion of the turn q followed by the turn p."""
    a, b, c, d = p
    w, x, y, z = q
    return (
        a * w - b * x - c * y - d * z,
        a * x + b * w + c * z - d * y,
        a * y - b * z + c * w + d * x,
        a * z + b * y - c * x + d * w,
    )

"""Plants, models that move the robot, as alternatives to `models.unicycle`: a TurtleBot3 Burger in MuJoCo.

The whole physics state of a robot is a tuple of numbers, which an environment keeps like the rest of its state. So results
depend on the seed alone, not on earlier drives, and one engine serves any number of environments.

References:
    Todorov, Erez, Tassa, "MuJoCo: A physics engine for model-based control", *IROS* (2012).
    ROBOTIS, *turtlebot3_description*, urdf/turtlebot3_burger.urdf (github.com/ROBOTIS-GIT/turtlebot3), below "the URDF";
    *turtlebot3_gazebo*, models/turtlebot3_burger/model.sdf (github.com/ROBOTIS-GIT/turtlebot3_simulations), below "the SDF";
    *e-Manual*, XL430-W250 (emanual.robotis.com/docs/en/dxl/x/xl430-w250).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import cache
from importlib import import_module
from threading import Lock
from typing import Annotated, Any, NamedTuple

import numpy as np

from turtlebot_gym.config import FINITE, NON_NEGATIVE, POSITIVE, Numbers, check_fields, given
from turtlebot_gym.models.angles import wrap, yaw_of_quaternion
from turtlebot_gym.models.unicycle import Integrator, advance
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
      <inertial pos="{base_center}" mass="{base_mass}" diaginertia="{base_inertia}"/>
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


@dataclass(frozen=True, slots=True, kw_only=True)
class MujocoBurger:
    """A TurtleBot3 Burger for MuJoCo: two driven wheels with a motor each, and a sliding caster.

    Friction is Coulomb friction as MuJoCo approximates it: a wheel under traction also creeps, by a few per cent while it
    grips.
    """

    friction: Annotated[float, NON_NEGATIVE] = 1.0
    """Coefficient of friction between wheels and floor. Chosen: rubber on a dry floor, as the SDF calls its own value
    unreliable. 0.5 makes a slippery floor."""
    caster_friction: Annotated[float, NON_NEGATIVE] = 0.05
    """Coefficient of friction between caster and floor. Chosen: a sliding sphere that stands for a ball that rolls nearly
    freely. 0.3 stands for a clogged ball."""
    wheel_radius: Annotated[float, POSITIVE] = 0.033
    """m. The URDF's."""
    wheel_separation: Annotated[float, POSITIVE] = 0.160
    """Distance between the wheels' tracks, m. From the URDF."""
    wheel_width: Annotated[float, POSITIVE] = 0.018
    """m. The URDF's."""
    cylinders: bool = False
    """Whether the wheels are cylinders, as in the URDF, instead of ellipsoids. Chosen: a cylinder's rims scrub in every turn,
    as if the track were wider by an unknown amount; an ellipsoid touches at one point, like a rounded tyre."""
    base_mass: Annotated[float, POSITIVE] = 0.825735
    """kg. From the URDF, like all masses."""
    base_inertia: Annotated[tuple[float, ...], Numbers(POSITIVE, 3)] = (2.2124e-3, 2.1194e-3, 2.0064e-3)
    """Moments of inertia of the base about x, y and z, kg m^2. From the URDF, without the products of inertia, below 2 %."""
    base_center: Annotated[tuple[float, ...], Numbers(FINITE, 3)] = (-0.032, 0.0, 0.070)
    """Centre of mass of the base in its frame, whose origin is 1 cm above the floor, below the middle of the axle; m. From the
    SDF, the middle of the base's box; the URDF has it in the origin, outside of most of the base."""
    wheel_mass: Annotated[float, POSITIVE] = 0.028499
    """kg."""
    wheel_inertia: Annotated[tuple[float, ...], Numbers(POSITIVE, 3)] = (1.1176e-5, 2.0713e-5, 1.1192e-5)
    """Moments of inertia of a wheel about x, y (its axle) and z, kg m^2. From the URDF."""
    lidar_mass: Annotated[float, POSITIVE] = 0.114
    """kg; the inertia is that of the URDF's cylinder."""
    caster_mass: Annotated[float, POSITIVE] = 0.005
    """kg."""
    caster_radius: Annotated[float, POSITIVE] = 0.005
    """m. From the SDF; the centre is 1 mm lower than there, so that the caster touches the floor."""
    motor_gain: Annotated[float, POSITIVE] = 0.3
    """Torque per speed error of the wheel, N m s. Chosen: a wheel reaches its set speed within about 10 ms."""
    motor_torque: Annotated[float, POSITIVE] = 1.4
    """Greatest torque of a motor, N m: the stall torque in the e-Manual at 11.1 V, the battery voltage."""
    armature: Annotated[float, NON_NEGATIVE] = 0.002
    """Inertia of a rotor behind its gear, seen at the wheel, kg m^2. Chosen: the maker states none."""
    lead: Annotated[float, NON_NEGATIVE] = 0.04
    """Time before the end of a control interval at which its command reaches the motors, s. Chosen: late, as the unicycle's
    commands act at the end; early enough for the wheels to have the new speed when the odometry is read there."""
    reading: Annotated[float, POSITIVE] = 0.02
    """Time between readings of the wheel angles from which odometry is integrated, s; its twist is that of the last reading.
    Chosen: 50 Hz."""
    step: Annotated[float, POSITIVE] = 0.002
    """Time step of the engine, s. Chosen: with half of it, a straight drive differs by less than 0.1 %."""

    def __post_init__(self) -> None:
        check_fields(self)

    def steps(self, dt: float) -> tuple[int, int]:
        """Return the number of engine steps in a control interval of dt, s, and how many of them follow the new command.

        Raises:
            ValueError: If the intervals are not multiples of the step, or the lead is not shorter than dt.
        """
        steps, lead, reading = (number / self.step for number in (dt, self.lead, self.reading))
        if any(abs(count - round(count)) > 1e-6 for count in (steps, lead, reading)):
            raise ValueError(
                f"dt, MujocoBurger.lead and MujocoBurger.reading must be multiples of MujocoBurger.step, {self.step:g} s, "
                f"got {dt:g}, {self.lead:g} and {self.reading:g} s."
            )
        if not self.lead < dt:
            raise ValueError(f"MujocoBurger.lead must be shorter than dt, {dt:g} s, got {self.lead:g} s.")
        return round(steps), round(lead)


PLANTS: dict[str, MujocoBurger | tuple[()]] = {"unicycle": (), "mujoco": MujocoBurger()}
"""Plants by name. The unicycle of `models` has no parameters besides those of the robot and the noise."""


def make_plant(plant: str | Mapping[str, Any] | MujocoBurger = "unicycle") -> MujocoBurger | tuple[()]:
    """Return a plant: a name in `PLANTS`, or what else `turtlebot_gym.config.given` takes for a Burger."""
    model: Any = given(MujocoBurger, plant, PLANTS, "plant")  # pyright: ignore[reportArgumentType]
    return model


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
        turn, turned = (math.cos(0.5 * pose.theta), 0.0, 0.0, math.sin(0.5 * pose.theta)), np.empty(4)
        self._mujoco.mju_mulQuat(turned, np.array(turn), np.array(self._resting[3:7]))
        return (pose.x, pose.y, self._resting[2], *turned.tolist(), *self._resting[7:])

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
    values = asdict(burger) | {
        "caster_height": burger.caster_radius - 0.010,
        "half": 0.5 * burger.wheel_separation,
        "axle": radius - 0.010,
        "wheel": "cylinder" if burger.cylinders else "ellipsoid",
        "size": (radius, half_width) if burger.cylinders else (radius, radius, half_width),
    }
    words = {name: " ".join(map(repr, value)) if isinstance(value, tuple) else value for name, value in values.items()}
    return _MODEL.format(**words)

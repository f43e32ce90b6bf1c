"""A TurtleBot3 Burger for a physics engine: the maker's masses and dimensions, and values that had to be chosen.

References:
    ROBOTIS, *turtlebot3_description*, urdf/turtlebot3_burger.urdf (github.com/ROBOTIS-GIT/turtlebot3), below "the URDF";
    *turtlebot3_gazebo*, models/turtlebot3_burger/model.sdf (github.com/ROBOTIS-GIT/turtlebot3_simulations), below "the SDF";
    *e-Manual*, XL430-W250 (emanual.robotis.com/docs/en/dxl/x/xl430-w250).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any

from turtlebot_gym.config import FINITE, NON_NEGATIVE, POSITIVE, Numbers, check_fields, given


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
    """Whether the wheels are cylinders, as in the URDF, instead of ellipsoids of the same radius and width. Chosen: a cylinder
    touches the floor with both rims, which scrub in every turn, so that the robot turns as if its track were wider by an
    unknown amount. An ellipsoid touches at one point in the middle of the track, like a rounded tyre."""
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
    """Time before the end of a control interval at which the interval's command reaches the motors, s. Chosen: late enough to
    be close to the unicycle, whose commands act at the end; early enough for the wheels to reach the new speed when the
    odometry is read at the end, since filters take its twist for that of the next interval."""
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

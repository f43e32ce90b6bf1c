"""What a TurtleBot3 Burger is made of, for a physics engine: the maker's masses and measures, and what had to be chosen.

References:
    ROBOTIS, *turtlebot3_description*, urdf/turtlebot3_burger.urdf (github.com/ROBOTIS-GIT/turtlebot3), below "the URDF";
    *turtlebot3_gazebo*, models/turtlebot3_burger/model.sdf (github.com/ROBOTIS-GIT/turtlebot3_simulations), below "the SDF";
    *e-Manual*, XL430-W250 (emanual.robotis.com/docs/en/dxl/x/xl430-w250).
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

from turtlebot_gym.validation import choose, require, typed


@dataclass(frozen=True, slots=True, kw_only=True)
class MujocoBurger:
    """A TurtleBot3 Burger for MuJoCo: two driven wheels, a caster that slides, and a motor at each wheel.

    Friction is Coulomb's as MuJoCo approximates it: a wheel that pulls also creeps, by a few per cent where it grips.
    """

    friction: float = 1.0
    """Coefficient of friction between wheels and floor. Chosen: rubber on a dry floor; the SDF says that its own value is not
    reliable. 0.5 makes a slippery floor."""
    caster_friction: float = 0.05
    """Coefficient of friction between caster and floor. Chosen: a ball that rolls nearly freely, for which a sphere that slides
    stands here. 0.3 is one that is clogged."""
    wheel_radius: float = 0.033
    """m. The URDF's."""
    wheel_separation: float = 0.160
    """Distance between the wheels' tracks, m. The URDF's."""
    wheel_width: float = 0.018
    """m. The URDF's."""
    cylinders: bool = False
    """Whether the wheels are cylinders, as in the URDF, instead of ellipsoids of the same radius and width. Chosen: a cylinder
    touches the floor with both its rims, which scrub in every turn, so that it turns as if the track were wider by an unknown
    amount; an ellipsoid touches at one point, in the middle of the track, as a rounded tyre does."""
    base_mass: float = 0.825735
    """kg. The URDF's, as all masses."""
    base_inertia: tuple[float, ...] = (2.2124e-3, 2.1194e-3, 2.0064e-3)
    """Moments of inertia of the base about x, y and z, kg m^2. The URDF's, without its products, which are below 2 %."""
    base_center: tuple[float, ...] = (-0.032, 0.0, 0.070)
    """Centre of the base's mass in its frame, whose origin is 1 cm above the floor, below the middle of the axle; m. The SDF's,
    which is the middle of the base's box; the URDF has it in the origin, outside of most of the base."""
    wheel_mass: float = 0.028499
    """kg."""
    wheel_inertia: tuple[float, ...] = (1.1176e-5, 2.0713e-5, 1.1192e-5)
    """Moments of inertia of a wheel about x, y (its axle) and z, kg m^2. The URDF's."""
    lidar_mass: float = 0.114
    """kg; its inertia is that of the URDF's cylinder."""
    caster_mass: float = 0.005
    """kg."""
    caster_radius: float = 0.005
    """m. The SDF's; its centre is 1 mm lower than there, so that the caster touches the floor."""
    motor_gain: float = 0.3
    """Torque per error of the wheel's speed, N m s. Chosen: a wheel follows its set speed within about 10 ms."""
    motor_torque: float = 1.4
    """Greatest torque of a motor, N m. The e-Manual's stall torque at 11.1 V, the battery's voltage."""
    armature: float = 0.002
    """Inertia of a rotor behind its gear, at the wheel, kg m^2. Chosen: the maker does not say."""
    lead: float = 0.04
    """Time before the end of a control interval at which the command that was asked for in it reaches the motors, s. Chosen:
    late enough to be near the unicycle, whose commands act at the end; early enough for the wheels to have the new speed when
    the odometry is read there, since filters take the twist that it tells for that of the next interval."""
    reading: float = 0.02
    """Time between readings of the wheels' angles, s, from which the odometry is integrated; the twist is that of the last one.
    Chosen: 50 Hz."""
    step: float = 0.002
    """The engine's time step, s. Chosen: at half of it a straight drive differs by less than 0.1 %."""

    def __post_init__(self) -> None:
        typed(self)
        for name, size in (("base_inertia", 3), ("wheel_inertia", 3), ("base_center", 3)):
            value = getattr(self, name)
            if len(value) != size:
                raise ValueError(f"MujocoBurger.{name} must be a sequence of {size} numbers, got {value!r}.")
        signed = ("base_center", "cylinders")
        may_be_zero = ("friction", "caster_friction", "armature", "lead")
        rest = [field.name for field in fields(self) if field.name not in (*signed, *may_be_zero)]
        require(self, "non-negative", *may_be_zero)
        require(self, "positive", *rest)
        require(self, "finite", "base_center")

    def steps(self, dt: float) -> tuple[int, int]:
        """Return the engine's steps in a control interval of dt, s, and how many of them follow the new command.

        Raises:
            ValueError: If they are not whole numbers, or the lead is not shorter than the interval.
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
"""Plants by name. The unicycle is the models' own, with no parameters besides the robot's and the noise's."""


def make_plant(
    plant: str | MujocoBurger = "unicycle", *, friction: float | None = None, caster_friction: float | None = None
) -> MujocoBurger | tuple[()]:
    """Return a plant by its name in `PLANTS`, or as it is given.

    Args:
        plant: The name, or a Burger.
        friction: Of the wheels; for "mujoco" only. None is the default.
        caster_friction: Likewise, of the caster.

    Raises:
        ValueError: If there is none of that name, or a friction is given for the unicycle, or is not finite and >= 0.
    """
    options = {"friction": friction, "caster_friction": caster_friction}
    given = {name: value for name, value in options.items() if value is not None}
    found = plant if isinstance(plant, MujocoBurger) else choose("plant", plant, PLANTS)
    if not given:
        return found
    if not isinstance(found, MujocoBurger):
        raise ValueError(f"friction and caster_friction are for the plant 'mujoco', not for {plant!r}.")
    return replace(found, **given)

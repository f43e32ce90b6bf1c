"""Flags that several commands share: options of environments and of trainings, with a text for the command line.

Importing `turtlebot_gym.Options` takes numba, which ``--help`` need not wait for; a test compares names and defaults.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any

import tyro
from tyro.constructors import ConstructorRegistry, PrimitiveConstructorSpec, PrimitiveTypeInfo


@dataclass(frozen=True, kw_only=True)
class Environment:
    """Options of environments."""

    robot: str = "burger"
    """Robot: a preset, or a file: your own (FILE.yaml), a URDF, Nav2's parameters, or some of these joined by +, such as
    robot.urdf+nav2_params.yaml. An unknown name lists the presets."""
    noise: str = "tutorial"
    """Noise: clean, tutorial, documented, wheel, rough, or a file: your own (FILE.yaml), or robot_localization's ekf.yaml."""
    filter: str = "matched"
    """Filter: matched, calibrated, tutorial, gated, mixture, slip, scale, gyro with --imu, a file with Q and R (FILE.yaml), or
    your own or an object of filterpy (MODULE:NAME)."""
    observation: str = "ekf"
    """What the policy observes. The task's terms, from the robot's pose: ekf (the estimated one), odometry or truth; or
    located, a localizer's, and with it how uncertain it is ahead and aside, and whether its last scan fits. After it, with
    commas, or alone, terms by name, or of your own (MODULE:NAME): "ekf,scan*2"."""
    reward: Annotated[dict[str, float] | None, tyro.conf.arg(metavar="TERM WEIGHT ...")] = None
    """Weights of terms of the reward by name, such as "effort 0.2"; a term of your own is MODULE:NAME."""
    fix: str | None = None
    """External pose sensor that corrects the filter now and then: beacons, late, localization, markers, motion-capture, or a
    file of your own (FILE.yaml)."""
    imu: str | None = None
    """Gyro, which the filter "gyro" reads: mpu9250, calibrated, or a file of your own (FILE.yaml)."""
    world: str | None = None
    """Rooms only: clutter, dense (the default), corridor, office, cellular, crowd, people, a Gazebo world (FILE.world,
    FILE.sdf) or a map (FILE.yaml)."""
    lidar: str | None = None
    """Rooms only: lds01 (the default), lds02, a1, urg04lx or ideal."""
    localizer: str | None = None
    """Localizer, which corrects the belief by scans in the room's map; rooms with wheel odometry only: match, robot, or a file
    of your own (FILE.yaml)."""
    start: str | None = None
    """With a localizer only: known, the localizer begins at the first measurement, or unknown, it looks for the robot in the
    whole map; by default the task's own, which is known."""
    goals: int | None = None
    """Missions only: most goals that are drawn in turn, with a minute for each: one that the robot does not reach by then is
    given up. By default as many as the time allows."""
    arrival: str | None = None
    """Pose that decides on arrival: truth, or belief, the pose that the policy observes, as on a robot; by default the task's
    own, which is truth but in missions."""
    delay: int = 0
    """Delay of commands in steps, 0 to 3."""
    system: str | None = None
    """Kernels of a step of your own (MODULE:NAME): a turtlebot_gym.System, or a function of the parameters that returns one."""

    def require_read(self) -> None:
        """Refuse a gyro that nothing reads, with a `ValueError`: it would change no result."""
        words = (self.filter, self.system, *self.reward_names(), *_words(self.observation))
        if self.imu is not None and self.filter != "gyro" and not any(":" in word for word in words if word):
            raise ValueError(f"imu is not read by filter {self.filter!r}: choose --filter gyro, or leave --imu out.")

    def reward_names(self) -> tuple[str, ...]:
        """Return the names of the reward's terms that are given."""
        return tuple(self.reward or ())

    def described(self, *left_out: str) -> list[str]:
        """Return the options that are not the default, each as a phrase of a table's header, but for some."""
        phrases = []
        for item in fields(self):
            value = getattr(self, item.name)
            if item.name in _DESCRIBED and item.name not in left_out and value not in (item.default, (item.default,)):
                phrases.append(f"{item.name} {_phrase(value)}")
        return phrases


def _words(value: str | tuple[str, ...]) -> tuple[str, ...]:
    return (value,) if isinstance(value, str) else value


def _phrase(value: Any) -> str:
    if isinstance(value, Mapping):
        return " ".join(f"{name} {weight:g}" for name, weight in value.items())
    return ", ".join(value) if isinstance(value, tuple) else str(value)


@dataclass(frozen=True, kw_only=True)
class OfDrive:
    """Options of environments for a drive."""

    switch: str | None = None
    """Square only: the next waypoint becomes current on arrival, or after a time of 15 s, reached or not."""
    laps: int | None = None
    """Square only: number of rounds through the waypoints."""
    plant: str = "unicycle"
    """Model that moves the robot: unicycle, or on open ground mujoco, a Burger with wheels that creep and slip, which needs
    the extra [mujoco]."""


_DESCRIBED = (
    *(item.name for part in (Environment, OfDrive) for item in fields(part) if item.name not in ("robot", "noise")),
    "friction",
    "caster_friction",
)
"""Options on which results depend, in the order of a table's header, which begins with robot and noise."""


@dataclass(frozen=True, kw_only=True)
class Learning:
    """Options of trainings."""

    algo: str = "ppo"
    """Algorithm: ppo, sac or td3; others of Stable-Baselines3, in lower case, with a FILE of hyper-parameters."""
    from_policy: Annotated[str | None, tyro.conf.arg(name="from", metavar="POLICY")] = None
    """Begin with a network that was fitted to this policy, such as bearing, or vfh in rooms; for ppo and a2c."""
    randomize: bool = False
    """Randomize noise, speed scale and delay (in rooms also world and LiDAR) per environment; those given then apply to the
    evaluation."""
    speed_error: float = 0.02
    """With --randomize: largest error of the executed speed, as a share of it, unknown to the filter. On a slippery floor
    wheels lose a tenth."""
    turn_error: float = 0.0
    """With --randomize: largest further error of the executed turning rate, as a share of it, such as that of a wrong track."""
    veer: float = 0.0
    """With --randomize: largest turn per metre driven, rad/m, such as that of unequal wheels."""
    config: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Hyper-parameters, YAML in the form of rl-baselines3-zoo; by default those shipped with the package."""
    steps: int | None = None
    """Environment steps; by default n_timesteps of the hyper-parameters."""
    device: str = "cpu"
    """Device of the network: cpu, cuda, or auto, which uses a GPU for SAC and TD3 if there is one, and the CPU for PPO."""


REGISTRY = ConstructorRegistry()
"""How the command line reads whole numbers: 1000000, 1_000_000 or 1e6."""


@REGISTRY.primitive_rule
def _whole(info: PrimitiveTypeInfo) -> PrimitiveConstructorSpec[Any] | None:
    if info.type is not int:
        return None
    return PrimitiveConstructorSpec(
        nargs=1,
        metavar="INT",
        instance_from_str=lambda words: read_whole(words[0]),
        is_instance=lambda value: isinstance(value, int) and not isinstance(value, bool),
        str_from_instance=lambda value: [str(value)],
    )


def read_whole(text: str) -> int:
    """Return a whole number, also one like 1e6 or 2.5e3.

    Raises:
        ValueError: If it is something else.
    """
    try:
        return int(text)
    except ValueError:
        number = float(text)
        if not number.is_integer() or abs(number) > 2**53:
            raise ValueError(f"{text} is not a whole number.") from None
        return int(number)

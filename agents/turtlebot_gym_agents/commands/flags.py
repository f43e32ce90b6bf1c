"""Flags that several commands share: options of environments and of trainings, with a text for the command line.

Importing `turtlebot_gym.Options` takes gymnasium, which ``--help`` need not wait for; a test compares names and defaults.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any, ClassVar

import tyro
from tyro.constructors import ConstructorRegistry, PrimitiveConstructorSpec, PrimitiveTypeInfo


@dataclass(frozen=True, kw_only=True)
class RobotAndNoise:
    """Options of environments: the robot, its sensors and what a policy sees of them."""

    GROUP: ClassVar[str] = "robot and noise"

    robot: str = "burger"
    """Robot: burger, waffle, turtlebot4, tutorial, or a file of your own (FILE.yaml)."""
    noise: str = "tutorial"
    """Noise: clean, tutorial, documented, wheel, rough, or a file of your own (FILE.yaml)."""
    filter: str = "matched"
    """Filter: matched, calibrated, tutorial, gated, FILE.yaml, or MODULE:NAME. With --imu also gyro. A
    file holds Q and R; a module your own filter, or an object of filterpy."""
    observation: str = "ekf"
    """What the policy observes: ekf, odometry, truth or located, with terms after it. The task's terms come from the robot's
    pose: ekf is the estimated one, located a localizer's, and with it how uncertain it is ahead and aside, and whether its last
    scan fits. After it, with commas, or alone, terms by name, or of your own (MODULE:NAME): "ekf,scan*2"."""
    fix: str | None = None
    """External pose sensor that corrects the filter now and then: beacons, late, localization, markers, motion-capture, or a
    file of your own (FILE.yaml)."""
    imu: str | None = None
    """Gyro, which the filter "gyro" reads: mpu9250, calibrated, or a file of your own (FILE.yaml)."""
    lidar: str | None = None
    """Rooms only: lds01 (the default), lds02, a1, urg04lx, ideal, or a file of your own (FILE.yaml)."""
    localizer: str | None = None
    """Localizer, which corrects the belief by scans in the room's map; rooms with wheel odometry only: match, robot, or a file
    of your own (FILE.yaml)."""
    start: str | None = None
    """With a localizer only: known, the localizer begins at the first measurement, or unknown, it looks for the robot in the
    whole map; by default the task's own, which is known."""
    delay: int = 0
    """Delay of commands in steps, 0 to 3."""
    plant: str = "unicycle"
    """Model that moves the robot: unicycle, or on open ground mujoco, a Burger with wheels that creep and slip, which needs
    the extra [mujoco]."""
    integrator: str = "euler"
    """Integrator of the motion: euler or midpoint."""


@dataclass(frozen=True, kw_only=True)
class OfTask:
    """Options of environments: the task."""

    GROUP: ClassVar[str] = "task"

    world: str | None = None
    """Rooms only: clutter, dense (the default), corridor, office, cellular, crowd, people, FILE.world, FILE.sdf or FILE.yaml.
    The files are Gazebo worlds and maps."""
    goals: int | None = None
    """Missions only: most goals that are drawn in turn, with a minute for each: one that the robot does not reach by then is
    given up. By default as many as the time allows."""
    arrival: str | None = None
    """Pose that decides on arrival: truth, or belief, the pose that the policy observes, as on a robot; by default the task's
    own, which is truth but in missions."""
    switch: str | None = None
    """Square only: the next waypoint becomes current on arrival, or after a time of 15 s, reached or not."""
    laps: int | None = None
    """Square only: number of rounds through the waypoints."""
    waypoints: Annotated[tuple[tuple[float, float, float], ...] | None, tyro.conf.arg(metavar="X Y HEADING ...")] = None
    """Square only: poses to visit instead of the square; m, rad."""
    reward: Annotated[dict[str, float] | None, tyro.conf.arg(metavar="TERM WEIGHT ...")] = None
    """Weights of terms of the reward by name, such as "effort 0.2"; a term of your own is MODULE:NAME."""
    dt: float = 0.1
    """Control interval, s. The limit of an episode is a number of steps."""
    system: str | None = None
    """Kernels of a step of your own (MODULE:NAME): a turtlebot_gym.System, or a function of the parameters that returns one."""


@dataclass(frozen=True, kw_only=True)
class Environment(OfTask, RobotAndNoise):
    """Options of environments."""

    def require_read(self, *, learning: bool = False) -> None:
        """Refuse sensors and filters that nothing reads, with a `ValueError`: they would change no result.

        Args:
            learning: Whether only what the policy observes counts; otherwise the errors of the estimate are results, too.
        """
        filters, observations = _words(self.filter), _words(self.observation)
        words = (*filters, self.system, *self.reward_names(), *observations)
        if any(":" in word for word in words if word):
            return  # code of one's own may read anything
        if self.imu is not None and "gyro" not in filters:
            named = ", ".join(map(repr, filters))
            raise ValueError(f"imu is not read by filter {named}: choose --filter gyro, or leave --imu out.")
        unread = {"truth": ("filter", "fix", "imu", "localizer"), "odometry": ("fix", "imu", "localizer")}
        for name in unread.get(observations[0], ()) if learning and len(observations) == 1 else ():
            if getattr(self, name) not in ("matched", None) or name in getattr(self, "changes", ()):
                what = f"a policy that observes {observations[0]} learns nothing from it"
                raise ValueError(f"{name} would change nothing: {what}. Leave --{name} out, or choose --observation ekf.")

    def reward_names(self) -> tuple[str, ...]:
        """Return the names of the reward's terms that are given."""
        return tuple(self.reward or ())

    def described(self, *left_out: str) -> list[str]:
        """Return the options that are not the default, each as a phrase of a table's header, but for some."""
        defaults = {item.name: item.default for item in fields(Environment)}
        values = {name: getattr(self, name) for name in _DESCRIBED if name not in left_out}
        differ = {name: value for name, value in values.items() if value not in (defaults[name], (defaults[name],))}
        return [f"{name} {_phrase(value)}" for name, value in differ.items()]


def _words(value: str | tuple[str, ...]) -> tuple[str, ...]:
    return (value,) if isinstance(value, str) else value


def _phrase(value: Any) -> str:
    if isinstance(value, Mapping):
        return " ".join(f"{name} {weight:g}" for name, weight in value.items())
    if isinstance(value, tuple):
        return ", ".join(f"({_phrase(part)})" if isinstance(part, tuple) else _phrase(part) for part in value)
    return f"{value:g}" if isinstance(value, float) else str(value)


_DESCRIBED = tuple(item.name for item in (*fields(RobotAndNoise), *fields(OfTask)) if item.name not in ("robot", "noise"))
"""Options on which results depend, in the order of a table's header, which begins with robot and noise."""


@dataclass(frozen=True, kw_only=True)
class Learning:
    """Options of trainings."""

    GROUP: ClassVar[str] = "learning"

    algo: str = "ppo"
    """Algorithm: ppo, sac or td3; others of Stable-Baselines3, in lower case, with a FILE of hyper-parameters."""
    from_policy: Annotated[str | None, tyro.conf.arg(name="from", metavar="POLICY")] = None
    """Begin with a network that was fitted to this policy, such as bearing, or vfh in rooms; for ppo and a2c."""
    randomize: bool = False
    """Randomize noise, speed scale and delay (in rooms also world and LiDAR) per environment. Those given then apply to the
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
    evaluations: int = 5
    """Number of evaluations during training."""
    episodes: int = 500
    """Episodes of the evaluation at the end; those during training have the first 100."""
    threads: int = 1
    """Threads of torch and of the compiled loop; small networks gain nothing from more."""
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

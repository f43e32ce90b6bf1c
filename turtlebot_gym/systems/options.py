"""What an environment is made from: names of presets, files or values, and the checked parameters that they stand for."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from turtlebot_gym.config import FINITE, Numbers, as_int, choose, did_you_mean, given, refusal, short_repr, split
from turtlebot_gym.files import load_object
from turtlebot_gym.localization.tuning import LocalizerTuning, make_localizer
from turtlebot_gym.models.angles import wrap
from turtlebot_gym.models.unicycle import INTEGRATORS
from turtlebot_gym.observations import OBSERVED, ObservationTerm
from turtlebot_gym.observations.reading import read_items
from turtlebot_gym.parameters import REFERENCE_PERIOD, FilterTuning, FixNoise, Noise
from turtlebot_gym.presets import FIXES, make_filter, make_noise, make_robot
from turtlebot_gym.rewards import RewardTerm, default_weights
from turtlebot_gym.robots import Robot
from turtlebot_gym.rooms.lidar import Lidar
from turtlebot_gym.rooms.plan import FloorPlan
from turtlebot_gym.rooms.worlds import World, find_lidar, find_world
from turtlebot_gym.systems.assembly import assemble
from turtlebot_gym.systems.parameters import DT, MAX_DELAY, Parameters, make_room
from turtlebot_gym.systems.sensors import IMUS, ImuNoise
from turtlebot_gym.systems.system import LOCALIZER, System
from turtlebot_gym.tasks import SQUARE_PERIOD, SQUARE_WAYPOINTS, TASKS, Task
from turtlebot_gym.values import Pose

MAX_DEPTH = 25
"""Greatest delay of a fix in steps; each step is stored and compiled."""


class Setup(NamedTuple):
    """What `Options` stand for: the arguments of `turtlebot_gym.Episode`, and of a batch."""

    parameters: Parameters
    waypoints: tuple[Pose, ...]
    """The poses to visit; a goal that the task draws replaces the first."""
    plan: FloorPlan | None
    """Floor plan of a given room."""
    system: System
    """The kernels of a step."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """Everything that an environment is made from.

    They are the keyword arguments of the environments, of `make_parameters` and of evaluations; trainings and commands are made
    from them. A value is a name, a file, a mapping of some fields, or the parameters themselves; `setup` checks them all. A
    mapping with ``base`` changes fields of what that names, ``noise={"base": "rough", "process": {"slip": 0.3}}``.
    """

    task: str | Mapping[str, Any] | Task | None = None
    """What to reach: nav, pose, square, room or mission, or a `turtlebot_gym.Task`, whose finite ``max_steps`` truncates too.
    None for "room" where `world` or `lidar` is given, otherwise for "nav". Registered ids set it."""
    robot: str | Path | Mapping[str, Any] | Robot = "burger"
    """Robot: a preset (the names in `turtlebot_gym.ROBOTS`), or a file of your own (FILE.yaml)."""
    noise: str | Path | Mapping[str, Any] | Noise = "tutorial"
    """Noise: clean, tutorial, documented, wheel, rough, recorded, or a file of your own (FILE.yaml)."""
    filter: str | Path | Mapping[str, Any] | FilterTuning | Callable[..., Any] | object = "matched"
    """Filter: matched, calibrated, tutorial, gated, with an `imu` gyro, a file with Q and R (FILE.yaml),
    or one of your own (MODULE:NAME); in Python also a `turtlebot_gym.FilterTuning`, a mapping of its fields, a class, see
    `turtlebot_gym.estimation.plain`, or an object of filterpy, see `turtlebot_gym.estimation.objects`."""
    observation: str | ObservationTerm | Sequence[str | ObservationTerm] = "ekf"
    """What the policy observes. The task's terms, from the robot's pose: ekf (the estimated one), odometry or truth; or
    located, a localizer's, and with it how uncertain it is ahead and aside, and whether its last scan fits. After it, with
    commas, or alone, terms by name, or of your own (MODULE:NAME), see `turtlebot_gym.observations`: "ekf,scan*2"; in Python
    also a sequence of names and of `turtlebot_gym.ObservationTerm`."""
    fix: str | Path | Mapping[str, Any] | FixNoise | None = None
    """External pose sensor that corrects the filter now and then: beacons, late, localization, markers, motion-capture, or a
    file of your own (FILE.yaml). None for none."""
    imu: str | Path | Mapping[str, Any] | ImuNoise | None = None
    """Gyro, which the filter "gyro" reads: mpu9250, calibrated, or a file of your own (FILE.yaml). None for none."""
    world: str | World | None = None
    """Rooms only: clutter, dense (the default), corridor, office, cellular, crowd, people, a Gazebo world (FILE.world,
    FILE.sdf) or a map (FILE.yaml), or a `turtlebot_gym.rooms.plan.FloorPlan`."""
    lidar: str | Path | Mapping[str, Any] | Lidar | None = None
    """Rooms only: lds01 (the default), lds02, a1, urg04lx, ideal, or a file of your own (FILE.yaml)."""
    localizer: str | Path | Mapping[str, Any] | LocalizerTuning | None = None
    """Localizer, which corrects the belief by scans in the room's map; rooms with wheel odometry only: match, robot, or a file
    of your own (FILE.yaml). None for none."""
    start: str | None = None
    """With a localizer only: known, the localizer begins at the first measurement, or unknown, it looks for the robot in the
    whole map; None for the task's own, which is known."""
    goals: int | None = None
    """Missions only: most goals that are drawn in turn, with a minute for each: one that the robot does not reach by then is
    given up. None for as many as the time allows, or what a Task says."""
    arrival: str | None = None
    """Pose that decides on arrival: truth, or belief, the pose that the policy observes, as on a robot; None for the task's
    own, which is truth but in missions."""
    switch: str | None = None
    """Square only: the next waypoint becomes current on arrival, or after a time of 15 s, reached or not."""
    laps: int | None = None
    """Square only: number of rounds through the waypoints."""
    waypoints: Sequence[Sequence[float]] | None = None
    """Square only: poses to visit instead of the square: x, y and heading; m, rad."""
    reward: Mapping[str | RewardTerm, float] | None = None
    """Weights of the reward's terms by name; other terms keep theirs. A term of your own is MODULE:NAME of a
    `turtlebot_gym.RewardTerm`, or in Python the term itself. None for the task's own weights."""
    delay: int = 0
    """Delay of commands in steps, 0 to 3."""
    dt: float = REFERENCE_PERIOD
    """Control interval, s."""
    integrator: str = "euler"
    """Integrator of the motion: euler or midpoint."""

    system: str | System | Callable[[Parameters], System] | None = None
    """Kernels of a step of your own (MODULE:NAME): a `turtlebot_gym.System`, or a function of the parameters that returns one.
    None for those of the other options."""

    @classmethod
    def of(cls, given: Mapping[str, Any]) -> Options:
        """Return options from keyword arguments; a ``TypeError`` refuses an unknown one."""
        known = [item.name for item in fields(cls)]
        for name in given:
            if name not in known:
                raise TypeError(f"There is no option {name!r}; options are {', '.join(known)}.{did_you_mean(name, known)}")
        return cls(**given)

    def changed(self) -> dict[str, Any]:
        """Return the options that differ from their defaults, as keyword arguments of an environment."""
        values = ((item.name, getattr(self, item.name), item.default) for item in fields(self))
        return {name: value for name, value, default in values if type(value) is not type(default) or value != default}

    @property
    def in_room(self) -> bool:
        """Whether there is a room around the robot."""
        return split(self.task)[0] in ("room", "mission") or self.world is not None or self.lidar is not None

    def course(self) -> tuple[Task, tuple[Pose, ...]]:
        """Return the task and its waypoints; a ``ValueError`` if a name is unknown, or an option does not suit the task."""
        name = ("room" if self.in_room else "nav") if self.task is None else split(self.task)[0]
        task = given(Task, name if self.task is None else self.task, TASKS, "task")
        if task.random and (self.waypoints is not None or self.switch == "time" or self.laps not in (None, 1)):
            raise ValueError("waypoints, switch='time' and laps are for tasks with given waypoints: this one draws its goal.")
        if self.in_room and (name in ("nav", "pose", "square") or not task.random):
            raise ValueError(f"world and lidar are for turtlebot_gym/TurtleBotRooms-v0, got the task {short_repr(name)}.")
        if self.goals is not None and not (self.in_room and task.laps > 1):
            raise ValueError(f"goals are for turtlebot_gym/TurtleBotMissions-v0, got the task {short_repr(name)}.")
        if self.start is not None and self.localizer is None:
            raise ValueError(f"start is for robots that localize themselves and needs {LOCALIZER}.")
        changes: dict[str, Any] = {}
        for option, field, choices in (
            ("arrival", "on_belief", {"truth": False, "belief": True}),
            ("start", "start_known", {"known": True, "unknown": False}),
            ("switch", "switch_period", {"arrival": math.inf, "time": SQUARE_PERIOD}),
        ):
            if (value := getattr(self, option)) is not None:
                changes[field] = choose(option, value, choices)
        for option in ("goals", "laps"):
            if (value := getattr(self, option)) is not None:
                changes["laps"] = as_int(option, value, 1)
        poses = _poses(SQUARE_WAYPOINTS if self.waypoints is None else self.waypoints)
        return replace(task, **changes), poses[:1] if task.random else poses

    def setup(self) -> Setup:
        """Return parameters, waypoints, plan and system; a ``ValueError`` refuses options, and those that do not suit."""
        task, waypoints = self.course()
        late, dt = as_int("delay", self.delay, 0, MAX_DELAY), DT.check("dt", self.dt)
        fix = () if self.fix is None else given(FixNoise, self.fix, FIXES, "fix")
        if fix and round(fix.delay / dt) > MAX_DEPTH:
            raise ValueError(f"fix must come at most {MAX_DEPTH} steps late, got {fix.delay!r} s with dt {dt!r} s.")
        noise, robot = make_noise(self.noise), make_robot(self.robot)
        pose, items = read_items(self.observation)
        if pose == "located" and self.localizer is None:
            raise ValueError(f"observation 'located' needs {LOCALIZER}.")
        imu = () if self.imu is None else given(ImuNoise, self.imu, IMUS, "imu")
        room, plan = self._room(dt)
        own, weights = self._reward()
        parameters = Parameters(
            robot=robot,
            noise=noise,
            tuning=make_filter(self.filter, noise, imu=imu),
            task=task,
            reward=(),
            dt=dt,
            integrator=choose("integrator", self.integrator, INTEGRATORS),
            observed=OBSERVED[pose],
            delay=float(late),
            room=room,
            fix=fix,
            imu=imu,
            localizer=self._localizer(noise, room),
        )
        system = assemble(parameters, self.system, own, () if items == (pose,) else items)
        where = "" if self.system else " in a room" if self.in_room else " on open ground"
        for name in weights:
            known = {term.name: term for term in system.rewards}
            choose(f"reward{where} (a term, or MODULE:NAME of your own)", name, known)
        weighed = [term._replace(weight=weights.get(term.name, term.weight)) for term in system.rewards]
        return Setup(parameters._replace(reward=default_weights(weighed)), waypoints, plan, system)

    def _reward(self) -> tuple[tuple[RewardTerm, ...], dict[str, float]]:
        """Return the reward's terms of one's own, and the weights that are given, by name."""
        reward = {} if self.reward is None else self.reward
        if not isinstance(reward, Mapping) or not all(isinstance(key, (str, RewardTerm)) for key in reward):
            raise refusal("reward", "weights by name, such as {'effort': 0.2}", reward)
        own, weights = list[RewardTerm](), dict[str, float]()
        for key, weight in reward.items():
            term = load_object(key) if isinstance(key, str) and ":" in key else key
            if isinstance(term, RewardTerm):
                own.append(term)
            elif term is not key:
                raise refusal(f"reward[{key!r}]", "a RewardTerm", term)
            name = term.name if isinstance(term, RewardTerm) else term
            weights[name] = FINITE.check(f"reward[{name!r}]", weight)
        return tuple(own), weights

    def _localizer(self, noise: Noise, room: Any) -> LocalizerTuning | tuple[()]:
        """Return the localizer, which needs a room, and wheels that it moves with."""
        if self.localizer is None:
            return ()
        if not room:
            raise ValueError("localizer needs the map of a room: choose one with world=..., such as world='office'.")
        if not noise.odometry.wheel:
            raise ValueError("localizer moves with wheel odometry: choose such a noise, such as noise='wheel'.")
        for name in ("fix", "imu"):
            if getattr(self, name) is not None:
                raise ValueError(f"localizer and {name} exclude each other: leave out one of them.")
        return make_localizer(self.localizer, room.lidar)

    def _room(self, dt: float) -> tuple[Any, FloorPlan | None]:
        """Return the parameters of the room, empty on open ground, and its plan if it is given."""
        if not self.in_room:
            return (), None
        world = find_world("dense" if self.world is None else self.world)
        lidar = find_lidar("lds01" if self.lidar is None else self.lidar)
        return make_room(world, lidar, dt), world if isinstance(world, FloorPlan) else None


def _poses(waypoints: Any) -> tuple[Pose, ...]:
    if not isinstance(waypoints, (list, tuple, np.ndarray)) or not len(waypoints):
        raise refusal("waypoints", "one or more poses (x, y, theta)", waypoints)
    poses = (Numbers(FINITE, 3).check(f"waypoints[{at}]", pose) for at, pose in enumerate(waypoints))
    return tuple(Pose(x, y, wrap(theta)) for x, y, theta in poses)


def make_parameters(task: str | Task | None = None, **options: Any) -> Parameters:
    """Return the checked parameters of an environment with some `Options`, by `Options.setup`, which returns floor plans, too.

    A ``TypeError`` refuses an unknown option.
    """
    return Options.of({"task": task, **options}).setup().parameters

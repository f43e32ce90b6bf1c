"""Interface of a block: a plain object with a ``step``, and declarations of its inputs, outputs and trigger, without ROS.

A ``for`` loop can drive a block just as the shell (`shell`) does, which makes it a node.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

from cmd_vel_guard.values import Mount
from turtlebot_gym.config import Range
from turtlebot_gym.rooms.scan import Scan
from turtlebot_gym.values import Command, Fix, Pose

PERIOD = Range(0.0, 1000.0, open_low=True, open_high=True, unit="s")
"""What the period of a block may be."""
FARTHEST = 1e5
"""Distance from the origin along an axis beyond which no robot, goal or obstacle is, m."""


@dataclass(frozen=True, kw_only=True)
class Input:
    """An input of a block: the latest value that arrived."""

    topic: str
    """Relative topic name; a namespace and remappings apply as usual."""
    type: type
    """Value type registered in `convert`, such as `Pose`, `Estimate` or `Command`; never a message type."""
    max_age: float | None = 0.5
    """Age at which the value counts as missing, s, since it was sent and since it was measured (the guard's `sent`); None holds
    the last value indefinitely."""
    lasts: float = 0.0
    """Time for which a measurement stands, s: the period of a sensor that is slower than others. Its age counts from then."""
    measured: bool = True
    """Whether its stamps are those of a measurement, on which a command then rests; not so for a reference."""
    required: bool = True
    """Whether ``step`` needs the value: if it is missing, ``step`` is not called and the outputs stop. A missing optional value
    is None."""
    sole: bool = False
    """Whether only one node may publish it: with a second one, the value counts as missing. A robot also stands when another
    node has taken its place, until it is enabled again."""
    once: bool = False
    """Whether each value is delivered to one step only."""
    lock_step: str = "latest"
    """Value that a step takes in lock-step: "latest"; "same", that of the step's stamp, for which it waits; "newest", the last
    up to that step, for which it waits too; "absent", none, as values belong to no step; or "refused", if it needs them."""
    halts: bool = False
    """Whether a `Disagreement` with a cause on it stops a robot that the block moves, until it is enabled again."""
    aged: bool = False
    """Whether ``step`` receives the value with its age by the stamps, as an `Stamped`, and with the mount of its frame."""
    reliable: bool = True
    """Reliable QoS if true; best effort otherwise, which matches both kinds of publisher."""
    latched: bool = False
    """Whether it was published once, perhaps before this node started."""
    frame: str | None = None
    """Frame of its messages, without the prefix; None for the world's."""
    message: str = ""
    """Type of its messages, such as "std_msgs/msg/Bool", if no type of values is registered: ``type`` does not count then."""
    read: Callable[[Any], Any] | None = None
    """Function of such a message that returns the value, or raises ``ValueError`` to refuse it."""
    wakes: bool = True
    """Whether its messages wake the node. If not, outside lock-step they are read when another input's message arrives."""


@dataclass(frozen=True, kw_only=True)
class Output:
    """An output of a block, returned by name; if the block omits it, nothing is published."""

    topic: str
    """Relative topic name."""
    type: type
    """Value type."""
    stop: Any = None
    """Value that stops the robot: published for a second when an input is missing, after a fault, when disabled and at the end.

    A block with such an output moves a robot: it starts disabled and is switched by the service ``~/enable``.
    """
    newest: bool = False
    """Whether the output is absent from some steps. In lock-step each step then also publishes on ``TOPIC/newest`` which
    message is the newest, for inputs that wait for it."""
    latched: bool = False
    """Whether late joiners receive the last value, for outputs that are published once. Such values belong to no step of
    lock-step."""
    frame: str | None = None
    """Frame of its messages, without the prefix; None for the world's."""
    mount: Mount | None = None
    """Frame of a value given in a sensor's own frame; if the block publishes a `Transform`, it is also on ``/tf_static``."""


class Nis(NamedTuple):
    """The normalized innovation squared of a filter's last measurement, 1, and from a localizer its evidence."""

    value: float
    fits: float | None = None
    """Share of the last scan's beams that fit the map."""
    weight: float | None = None
    """Weight of the best hypothesis of where the robot is."""


class Disagreement(NamedTuple):
    """Why a filter does not believe its odometry any more."""

    cause: str
    """An empty text if there is no contradiction."""


class InitialPose(Fix):
    """A person's or program's word where the robot is."""


class Resume(NamedTuple):
    """A person's word that the robot may go on."""


class Stamped(NamedTuple):
    """A value measured before the step: any output may be one, and inputs with ``aged`` are."""

    value: Any
    age: float
    """The step's stamp minus the value's, s; negative for a value from after the step's stamp."""
    mount: Pose | None = None
    """Pose of an input's frame in the robot's, by ``/tf_static``; None if that does not state it."""


class Tracks(tuple[float, ...]):
    """The numbers of the term `turtlebot_gym.observations.TRACKS`: the nearest tracks, seen from the robot."""

    __slots__ = ()


class Transform(NamedTuple):
    """The transform from an output's frame to another one."""

    pose: Pose
    """Pose of that frame in the output's."""
    child: str = ""
    """Name of that frame, without the prefix; if empty, the robot's."""


HALT = Input(
    topic="disagreement", type=Disagreement, required=False, max_age=None, latched=True, lock_step="absent", halts=True
)
"""The input of a block that moves a robot on a filter's estimate."""
TF = Output(topic="/tf", type=Transform)
"""The output of a block that publishes transforms, none by default: each must have one owner. As in tf2, the topic is the same
in any namespace: robots share one tree, and the frames' prefix distinguishes them."""
COMMANDED = Input(topic="cmd_vel", type=Command, max_age=None, required=False, lock_step="absent", reliable=False, wakes=False)
"""The input of a filter that compares its odometry with the command in force."""
SCAN = Input(topic="scan", type=Scan, lock_step="newest", aged=True, lasts=0.2, reliable=False, sole=True)
"""The input of a block that sees by LiDAR."""
INITIAL_POSE = Input(topic="initialpose", type=InitialPose, required=False, max_age=None, once=True)
"""The input of an estimator that is shown where the robot is. Nav2's clients send it with the stamp of its first time again and
again until they hear the estimate, so its age does not count."""
RESUME = Input(topic="resume", type=Resume, required=False, once=True, lock_step="absent")
"""The input of a filter that a person lets go on."""


@dataclass(frozen=True)
class Every:
    """Run by the ROS clock at stamps on an exact grid of nanoseconds; in lock-step, as the plant or on an input."""

    period: float
    """s"""
    plant: bool = False
    """Whether the block is the plant, whose steps are the time of lock-step: there its inputs answer its outputs, and it
    publishes ``clock``."""
    answers: str | None = None
    """Name of the input on which a block other than the plant runs in lock-step, at its stamp."""

    def __post_init__(self) -> None:
        PERIOD.check("period", self.period)


@dataclass(frozen=True)
class On:
    """Run on each message of an input, at its stamp."""

    input: str
    """Name of the input."""
    period: float = 0.0
    """Decimate to this period, s; 0 runs on every message."""
    max_gap: float = 1.0
    """Gap between two messages after which the block is reset, s."""


class Block(Protocol):
    """A block, which the shell turns into a node.

    It may also have a ``notice``, one line for users or None, which is logged and shown in the diagnostics; a ``fault``, shown
    as an error; ``figures``, numbers by name; ``services``, functions without arguments by name, offered as ``std_srvs/Empty``;
    ``nav2_name``, the node of Nav2 for which it stands, so that clients find that one active; ``pause``, called instead of
    ``reset`` after a gap in the messages on which it runs; and ``send``, ``cancel`` and ``refuse``, by which it takes goals as
    `WaypointGenerator` does, one at a time and in its world frame, beside its input ``goal``.
    """

    @property
    def inputs(self) -> Mapping[str, Input]:
        """Inputs by their names in ``step``; a class attribute suffices, as for the next two."""
        ...

    @property
    def outputs(self) -> Mapping[str, Output]:
        """Outputs by the names that ``step`` returns."""
        ...

    @property
    def trigger(self) -> Every | On:
        """Trigger of the block."""
        ...

    def reset(self) -> None:
        """Forget everything; the next step is the first."""
        ...

    @property
    def step(self) -> Callable[..., Mapping[str, Any]]:
        """A method ``step(dt, **inputs)`` that returns the outputs by name; ``dt`` is the time since the last step, s, or 0."""
        ...

"""What a block is: a plain object with a ``step``, and the declaration of what goes in, what comes out and when it runs.

There is no ROS in here: a ``for`` loop drives a block as well as the shell does (`shell`), which makes a node of it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Protocol, runtime_checkable

from turtlebot_gym.values import Covariance


def ranged(default: float, low: float, high: float, rule: str) -> Any:
    """Return a number among a block's parameters, with what ``ros2 param describe`` says of its values.

    Args:
        default: A whole number makes a parameter of whole numbers.
        low: Least value.
        high: Greatest value, which may be infinite.
        rule: In words, where the ends do not belong to it or other parameters matter; the class itself checks it.
    """
    return field(default=default, metadata={"range": (low, high), "rule": rule})


@dataclass(frozen=True, kw_only=True)
class Input:
    """A value that a block is given: the latest one that arrived."""

    topic: str
    """Relative topic name, which a namespace and remappings change as usual."""
    type: type
    """Its value type, which `convert` knows: `Pose`, `Estimate`, `Command`; never a message."""
    max_age: float | None = 0.5
    """Age from which on it counts as missing, s, by the steady clock; None holds the last value for ever."""
    required: bool = True
    """Whether ``step`` needs it: where it is missing, ``step`` is not called and the outputs stop. An optional one is None."""
    once: bool = False
    """Whether each value is delivered to a single step."""
    lock_step: str = "latest"
    """What a step in lock-step takes: "latest", the value at hand; "same", the value of the step's own stamp, for which it
    waits; "newest", the last one that its output had said by that step, for which it waits too; or "refused", where the value
    belongs to no step."""
    aged: bool = False
    """Whether ``step`` is given the value with its age by the stamps, as an `Aged`."""
    reliable: bool = True
    """Reliable QoS if true; best effort otherwise, which matches both kinds of publisher."""


class Mount(NamedTuple):
    """A sensor's own frame, and where it lies in the robot's."""

    frame: str
    """Its name, without the prefix of the robot's frames."""
    x: float
    """m"""
    y: float
    yaw: float
    """Direction of its x axis, rad."""


@dataclass(frozen=True, kw_only=True)
class Output:
    """A value that a block returns under its name; where it leaves it out, nothing is published."""

    topic: str
    """Relative topic name."""
    type: type
    """Its value type."""
    stop: Any = None
    """What stops the robot: sent for a second when an input is missing, after a fault, when disabled and at the end.

    A block with such an output moves a robot: it starts disabled and is switched by the service ``~/enable``.
    """
    newest: bool = False
    """Whether it does not come in every step. In lock-step it then also says, in each step on ``TOPIC/newest``, which message
    is the newest one, for inputs that wait for that."""
    reliable: bool = True
    """Reliable QoS if true; best effort otherwise, as for sensor data. Lock-step is always reliable."""
    latched: bool = False
    """Whether late joiners receive the last value, for outputs that are published once. Such values belong to no step of
    lock-step."""
    covariance: Callable[[], Covariance] | None = None
    """Returns the covariance of a value that travels as Odometry, if the value itself has none; asked after each step."""
    transform: bool = False
    """Whether a pose that travels as Odometry is published on ``/tf`` as well, as the transform to its child frame."""
    mount: Mount | None = None
    """The frame of a value that a sensor states in its own; where the block publishes transforms, it is on ``/tf_static``."""


class Aged(NamedTuple):
    """A value that was measured before the step: an output may be one, and an input is where it says so."""

    value: Any
    age: float
    """The step's stamp minus the value's, s; negative for a value from after the step's stamp."""


@dataclass(frozen=True)
class Every:
    """Run by the ROS clock, at stamps on an exact grid of nanoseconds; in lock-step, as the plant or on an input."""

    period: float
    """s"""
    speed: float | None = None
    """Where given, the block is the plant: it runs so many times faster than real time, and other than at 1 sets ``clock``. In
    lock-step its inputs answer its outputs; the speed is then the upper limit, and 0 is none."""
    answers: str | None = None
    """Name of the input on which another block runs in lock-step, at its stamp."""
    witness: str | None = None
    """Topic on which a recorder says how far it has heard a plant in lock-step: time waits for it too, so that nothing is
    lost."""
    through: Mapping[str, type] = field(default_factory=dict)
    """Topics, with their value types, over which a plant's outputs lead to its inputs: for the report of who does not
    answer."""

    def __post_init__(self) -> None:
        if not 0.0 < self.period < 1e3 or not (self.speed is None or 0.0 <= self.speed < 1e3):
            raise ValueError(
                f"Every: period and speed must be positive and below 1000, got {self.period!r} and {self.speed!r}."
            )


@dataclass(frozen=True)
class On:
    """Run on each message of an input, at its stamp."""

    input: str
    """Name of the input."""
    period: float = 0.0
    """Decimate to this period, s; 0 runs on every message."""
    max_gap: float = 1.0
    """Gap between two messages from which on the block is reset, s."""


@runtime_checkable
class Notices(Protocol):
    """A block that notices something which a person should know of: it is logged, and stands in the diagnostics."""

    @property
    def notice(self) -> str | None:
        """One line; None where there is nothing."""
        ...


class Block(Protocol):
    """What the shell turns into a node."""

    @property
    def inputs(self) -> Mapping[str, Input]:
        """What goes in, by the names that ``step`` knows; an attribute of the class will do, as for the next two."""
        ...

    @property
    def outputs(self) -> Mapping[str, Output]:
        """What comes out, by the names that ``step`` returns."""
        ...

    @property
    def trigger(self) -> Every | On:
        """When it runs."""
        ...

    def reset(self) -> None:
        """Forget everything; the next step is the first."""
        ...

    @property
    def step(self) -> Callable[..., Mapping[str, Any]]:
        """A method ``step(dt, **inputs)`` that returns the outputs by name.

        ``dt`` is the time since the last step, s; 0 on the first step of a block that runs on messages. The inputs are the
        values of those declared, by name.
        """
        ...

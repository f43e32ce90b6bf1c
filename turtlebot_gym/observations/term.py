"""A term of an observation: its name, its numbers with their bounds and unit, and how a robot gets them."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.config import POSITIVE, as_int, refusal
from turtlebot_gym.files import source_of

MOST = 100  # numbers of a term, values of it, and steps from one to the next
SOURCE = re.compile(r"[A-Za-z_][\w.]*:[A-Za-z_]\w*", re.ASCII)


@dataclass(frozen=True, slots=True)
class ObservationTerm:
    """A term of an observation: one number, or several. A term of one's own needs a ``topic`` that brings it to a robot."""

    name: str
    """Its name, by which policies and bundles ask for it."""
    of: Callable[..., Any]
    """``of(world, p)``, a kernel, returns its number, or a tuple of its numbers; it takes `systems.Snapshot` and
    `systems.Parameters`. Of a term in a scene, ``of(scene)`` returns an array."""
    low: float | tuple[float, ...]
    """Lower bound of each number; it is clipped to the bounds."""
    high: float | tuple[float, ...]
    """Upper bounds."""
    unit: str = ""
    """Unit of its numbers, such as "m"; empty for shares and for several units."""
    sensor: Any = None
    """A `systems.Sensor` that the term reads, which the robot then has: ``world.senses`` holds its value under its name."""
    topic: str = ""
    """ROS topic that brings the term on a robot; empty if only the environment has it."""
    message: str = ""
    """Type of the topic's messages, such as "std_msgs/msg/Bool"."""
    convert: Callable[[Any], Any] | None = None
    """Function of a message that returns the number, or the numbers."""
    lasts: float = 0.5
    """Age from which a message counts as missing, s; the robot then stands."""
    in_scene: bool = False
    """Whether its numbers are an array of the scene: of a LiDAR, for example."""
    length: int = 1
    """How many values it shows: the present one, and before it those of earlier steps."""
    every: int = 1
    """Steps from one of them to the next."""
    source: str = ""
    """"module:name" of a term of one's own."""

    def __post_init__(self) -> None:
        if not (isinstance(self.name, str) and self.name.isidentifier()):
            raise refusal("ObservationTerm.name", "a name, such as 'bumper'", self.name)
        term = f"ObservationTerm {self.name!r}"
        low, high = _numbers(self.low), _numbers(self.high)
        if not (1 <= low.size <= MOST and low.shape == high.shape and (low < high).all()):
            raise refusal(f"{term}: low", f"up to {MOST} finite numbers, each below that of high", (self.low, self.high))
        if bool(self.topic) != bool(self.message and self.convert):
            raise ValueError(f"{term}: topic, message and convert belong together.")
        POSITIVE.check(f"{term}: lasts", self.lasts)
        for name in ("length", "every"):
            as_int(f"{term}: {name}", getattr(self, name), 1, MOST)
        if self.source and not SOURCE.fullmatch(self.source):
            raise refusal(f"{term}: source", "MODULE:NAME", self.source)
        object.__setattr__(self, "low", tuple(low.tolist()))
        object.__setattr__(self, "high", tuple(high.tolist()))

    @property
    def bounds(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Lower and upper bounds of the present numbers."""
        return self.low, self.high  # type: ignore[return-value]

    @property
    def width(self) -> int:
        """How many numbers it has at a time."""
        return len(self.bounds[0])

    @property
    def size(self) -> int:
        """How many numbers of an observation it is."""
        return self.width * self.length

    def over(self, length: int, *, every: int = 1) -> ObservationTerm:
        """Return the term as a history: the present value, and earlier ones after it; before an episode, the first one."""
        return replace(self, length=length, every=every)

    def read(self, value: Any) -> tuple[float, ...]:
        """Return numbers that were measured for the term, clipped to its bounds; a ``ValueError`` refuses others."""
        numbers = _numbers(value)
        if len(numbers) != self.width:
            raise refusal(f"the term {self.name!r}", f"{self.width} finite number{'s' * (self.width > 1)}", value)
        return tuple(np.clip(numbers, *self.bounds).tolist())

    def example(self, world: Any, p: Any) -> Any:
        """Return the value of a term in a world, before it is clipped; a ``ValueError`` refuses another number of numbers."""
        value = getattr(self.of, "__wrapped__", self.of)(world, p)
        if (count := len(value) if isinstance(value, tuple) else 1) != self.width:
            raise ValueError(f"the term {self.name!r} has bounds of {self.width} numbers, but its kernel returns {count}.")
        return value

    @property
    def spelled(self) -> str:
        """How the option ``observation`` names the term."""
        history = "" if self.length == 1 else f"*{self.length}" + (f"@{self.every}" if self.every > 1 else "")
        return (self.source or self.name) + history

    def sourced(self) -> ObservationTerm:
        """Return the term with its source, so that a bundle can name it; a ``ValueError`` refuses one without any."""
        source = self.source or source_of(self.over(1), self.of.__module__, "__main__")
        if not source:
            raise refusal(f"the term {self.name!r}", "at the top level of its module, by a name that a bundle states", self.of)
        return replace(self, source=source)


def _numbers(value: Any) -> NDArray[np.float64]:
    """Return finite numbers as an array of one axis; an empty one for anything else."""
    try:
        numbers = np.atleast_1d(np.asarray(value, np.float64))
    except (TypeError, ValueError, OverflowError):
        return np.empty(0)
    return numbers if numbers.ndim == 1 and np.isfinite(numbers).all() else np.empty(0)

"""Parameters: dataclasses as ROS parameters, which are checked once before anything is published and read-only from then on.

rclpy ignores a misspelled parameter and refuses ``rate:=10`` for a double; this module does the opposite.
"""

from __future__ import annotations

from dataclasses import MISSING, dataclass, fields
from difflib import get_close_matches
from typing import Any, get_type_hints

from rclpy.node import Node

from turtlebot_gym_ros.node.block import Mount
from turtlebot_gym_ros.robot.standalone import declare_one, described, descriptor_of

_ROS_OWN = ("use_sim_time", "start_type_description_service", "qos_overrides.")


@dataclass(frozen=True, slots=True, kw_only=True)
class Common:
    """Parameters of every node; a block's parameters may override their defaults."""

    frame: str = "odom"
    """World frame. Poses in other frames are refused."""
    body_frame: str = "base_footprint"
    """The robot's frame in estimates and commands."""
    frame_prefix: str = ""
    """Prefix of both frames, such as "robot1/" for robot1/odom, like that of robot_state_publisher, so that robots share one
    tree."""
    enable_stamped_cmd_vel: bool = True
    """Whether velocities are TwistStamped, as on a Jazzy robot, or Twist, as on a Humble one."""
    start_enabled: bool = False
    """Whether a node that moves a robot starts enabled, without a call of ``~/enable``."""
    lock_step: bool = False
    """Whether time is simulated and waits for each step's answer, see `lockstep`; must be the same in all nodes. Never on a
    robot."""

    def __post_init__(self) -> None:
        if self.lock_step and not self.enable_stamped_cmd_vel:
            raise ValueError("lock_step needs enable_stamped_cmd_vel: an unstamped Twist cannot be tied to a step.")

    @property
    def world(self) -> str:
        """The world frame with its prefix."""
        return self.frame_prefix + self.frame

    @property
    def body(self) -> str:
        """The robot's frame with its prefix."""
        return self.frame_prefix + self.body_frame

    def sensor(self, mount: Mount) -> str:
        """The frame of a sensor with its prefix."""
        return self.frame_prefix + mount.frame


def _values(params: type) -> dict[str, tuple[type, Any]]:
    """Return type and default of each field of a parameter class."""
    types = get_type_hints(params)
    return {
        item.name: (types[item.name], item.default if item.default_factory is MISSING else item.default_factory())
        for item in fields(params)
    }


def _convert(name: str, value: Any, kind: type) -> Any:
    """Return a parameter's value in its type; integers are accepted as floats."""
    if kind is float and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    if type(value) is not kind:
        raise ValueError(f"parameter {name} must be of type {kind.__name__}, got {value!r} ({type(value).__name__}).")
    return value


def declare(node: Node, *params: type) -> tuple[Any, ...]:
    """Declare the fields of parameter classes as read-only parameters of a node, and return the filled classes.

    Args:
        node: A node that was created with ``automatically_declare_parameters_from_overrides=True``.
        *params: Dataclasses with defaults for all fields, whose docstrings are the descriptions. If two share a name, the later
            one counts.

    Raises:
        ValueError: If a given parameter does not exist, has the wrong type, or is refused by its class.
    """
    declared: dict[str, tuple[type, Any]] = {}
    for each in params:
        declared |= _values(each)
    given: dict[str, Any] = dict(node.get_parameters_by_prefix(""))
    for name in given:
        if name not in declared and not name.startswith(_ROS_OWN):
            close = get_close_matches(name, declared, n=1)
            hint = f"did you mean {close[0]}?" if close else f"there are {', '.join(sorted(declared))}."
            raise ValueError(f"{node.get_name()} has no parameter {name!r}: {hint}")
    values: dict[str, Any] = {}
    texts = {name: text for each in params for name, text in described(each).items()}
    shown = {item.name: descriptor_of(item, texts.get(item.name, "")) for each in params for item in fields(each)}
    for name, (kind, default) in declared.items():
        values[name] = _convert(name, given[name].value, kind) if name in given else default
    made = tuple(each(**{item.name: values[item.name] for item in fields(each)}) for each in params)
    for name in declared:
        if name in given:
            node.undeclare_parameter(name)
        declare_one(node, name, values[name], shown[name])
    return made

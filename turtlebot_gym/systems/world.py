"""The state that an environment keeps between steps, part by part, and the outcome of a step."""

from __future__ import annotations

from typing import Any, NamedTuple

from turtlebot_gym.values import Command, Pose, State


class Body(NamedTuple):
    """True state of the robot."""

    true_state: State
    command: Command
    """The command in force, within the robot's limits."""
    asked: tuple[Command, Command, Command]
    """The policy's last commands, as many as the longest delay, newest first; kept where commands are delayed."""
    wheels: Pose
    """The pose integrated from the wheels; the true pose where odometry does not integrate them."""
    slipping: bool


class Course(NamedTuple):
    """Progress of the robot along its waypoints."""

    reference: Pose
    """The waypoint to reach."""
    following: Pose
    """The waypoint after it; the same one if it is the last."""
    visited: float
    """Number of waypoints done."""


class RoomState(NamedTuple):
    """State of the robot in its room."""

    pose: Pose
    """True pose at the end of the previous step."""
    way: float
    """Length of the shortest path to the goal, m."""
    clearance: float
    """Distance from the robot's footprint to the nearest surface, m; negative on contact."""
    least: float
    """Least clearance since the start, m."""
    path_length: float
    """Distance driven since the start, m."""
    scan_age: float
    """Age of the newest scan by its stamp, s."""
    collided: bool
    """Whether the robot touches something."""
    given: float
    """Steps from the start until the goal was given."""


class Snapshot(NamedTuple):
    """The whole state of an environment."""

    body: Body
    senses: Any
    """The sensors' values, a field for each sensor: `values.Senses`, or a type from `values.senses_of`."""
    estimate: Any
    """State of the filter: `estimation.ekf.Estimate`, or another filter's."""
    course: Course
    steps: float
    """Steps since the start."""
    room: Any = ()
    """State of the robot in its room, `RoomState`; an empty tuple on open ground."""


class Outcome(NamedTuple):
    """Result of a step besides the observation; reward and shares are known last, from the others."""

    reward: float
    distance: float
    """True distance to the waypoint to reach, m."""
    is_success: bool
    terminated: bool
    truncated: bool
    reached: bool
    """Whether a waypoint was completed and the next one became current."""
    shares: Any = ()
    """What each term adds to the reward, a field for each, see `turtlebot_gym.rewards`."""

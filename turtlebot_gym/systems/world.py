"""What an environment remembers from step to step, part by part, and what it tells of a step."""

from __future__ import annotations

from typing import Any, NamedTuple

from turtlebot_gym.values import Command, Pose, State


class Body(NamedTuple):
    """The robot as it really is."""

    true_state: State
    command: Command
    """The command in force, within the robot's limits."""
    asked: tuple[Command, Command, Command]
    """The last commands that the policy asked for, as many as the longest delay, the newest first."""
    wheels: Pose
    """The pose that the wheels have integrated."""
    slipping: bool


class Course(NamedTuple):
    """How far the robot is on its way."""

    reference: Pose
    """The waypoint to reach."""
    following: Pose
    """The one after it; itself where there is none."""
    visited: float
    """Waypoints done with."""


class World(NamedTuple):
    """All that an environment remembers."""

    body: Body
    senses: Any
    """What the sensors say: `values.Senses`, or with fixes `systems.fixes.TrackedSenses`."""
    estimate: Any
    """What the filter remembers: `estimation.ekf.Estimate`, or another filter's."""
    course: Course
    steps: float
    """Steps since the start."""
    room: Any = ()
    """What is known of the room around: nothing on open ground, `systems.rooms.Around` in a room."""


class Outcome(NamedTuple):
    """What a step tells besides the observation."""

    reward: float
    distance: float
    """True distance to the waypoint to reach, m."""
    is_success: bool
    terminated: bool
    truncated: bool
    reached: bool
    """Whether a waypoint was done with, and the next one taken."""

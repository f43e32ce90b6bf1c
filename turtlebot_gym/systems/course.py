"""The task of options, and the waypoints to visit."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from turtlebot_gym.config import LARGEST, as_int, choose, given, refusal, short_repr, split
from turtlebot_gym.models.angles import wrap
from turtlebot_gym.tasks import SQUARE_PERIOD, SQUARE_WAYPOINTS, TASKS, Task
from turtlebot_gym.values import Pose

if TYPE_CHECKING:
    from turtlebot_gym.systems.options import Options


def course_of(options: Options) -> tuple[Task, tuple[Pose, ...]]:
    """Return the task and its waypoints; see `Options.course`."""
    name = ("room" if options.in_room else "nav") if options.task is None else split(options.task)[0]
    task = given(Task, name if options.task is None else options.task, TASKS, "task")
    if task.random and (options.waypoints is not None or options.switch == "time" or options.laps not in (None, 1)):
        raise ValueError("waypoints, switch='time' and laps are for tasks with given waypoints: this one draws its goal.")
    if options.in_room and (name in ("nav", "pose", "square") or not task.random):
        raise ValueError(
            f"world and lidar are for turtlebot_gym/TurtleBotRooms-v0 and its task 'room', got the task {short_repr(name)}."
        )
    changes: dict[str, Any] = {}
    if options.goals is not None:
        if not (options.in_room and task.laps > 1):
            raise ValueError(
                f"goals are for turtlebot_gym/TurtleBotMissions-v0 and its task 'mission', got {short_repr(name)}."
            )
        changes["laps"] = as_int("goals", options.goals, 1)
    if options.arrival is not None:
        changes["on_belief"] = choose("arrival", options.arrival, {"truth": False, "belief": True})
    if options.start is not None:
        if options.localizer is None:
            raise ValueError("start is for robots that localize themselves: choose a localizer, such as localizer='match'.")
        changes["start_known"] = choose("start", options.start, {"known": True, "unknown": False})
    if options.switch is not None:
        changes["switch_period"] = choose("switch", options.switch, {"arrival": math.inf, "time": SQUARE_PERIOD})
    if options.laps is not None:
        changes["laps"] = as_int("laps", options.laps, 1)
    poses = _poses(SQUARE_WAYPOINTS if options.waypoints is None else options.waypoints)
    task = replace(task, **changes)
    return task, poses[:1] if task.random else poses


def _poses(waypoints: Any) -> tuple[Pose, ...]:
    try:
        poses = tuple(Pose(*map(float, waypoint)) for waypoint in waypoints)
    except (TypeError, ValueError):
        poses = ()
    if not poses or not all(abs(number) <= LARGEST for pose in poses for number in pose):
        raise refusal("waypoints", f"one or more finite poses (x, y, theta), at most {LARGEST:g} m away", waypoints)
    return tuple(Pose(pose.x, pose.y, wrap(pose.theta)) for pose in poses)

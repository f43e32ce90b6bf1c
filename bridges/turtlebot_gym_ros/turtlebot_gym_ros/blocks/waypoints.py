"""The reference: a sequence of waypoints, switched by time or on arrival."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

from turtlebot_gym.estimation.ekf import Estimate
from turtlebot_gym.files import load
from turtlebot_gym.models.angles import sincos, wrap
from turtlebot_gym.systems import Options
from turtlebot_gym.tasks import SQUARE_PERIOD, SQUARE_WAYPOINTS, believed_to_arrive, by_time, due
from turtlebot_gym.validation import POSITIVE, Range, shown, typed
from turtlebot_gym.values import Pose
from turtlebot_gym_ros.node.block import Every, Input, Output


class WaypointGenerator:
    """Publish the waypoint to reach and the one after it periodically, so that a loss of the node is visible.

    It steps by the clock; in lock-step it answers each estimate, and its rule is then the environment's with
    ``arrival="belief"``. By time, the clock starts with the first estimate; the last waypoint stays. A pose from RViz replaces
    all waypoints. A reset restarts with the first one.

    Inputs: ``estimate`` (`Estimate`, on ``estimate``; optional), ``goal`` (`Pose`, on ``goal_pose``; optional), and if
    ``waypoints`` is "room", ``room_goal`` (`Pose`, on ``room_goal``; optional). Outputs: ``reference`` (`Pose`, on
    ``reference``), ``following`` (`Pose`, on ``next_reference``), in the world frame. Parameters: those of `Params`.
    """

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Params:
        """Parameters of the waypoints."""

        waypoints: str = "square"
        """"square", the tutorial's; "room", the goal of the simulator's room; or the path of a YAML or CSV file with x, y (m)
        and theta (rad)."""
        switch: str = "arrival"
        """When to switch to the next waypoint: on "arrival" by the estimate, or after a "time", reached or not."""
        switch_period: Annotated[float, POSITIVE.of("s")] = SQUARE_PERIOD
        """Time after which the next waypoint becomes current, s, with the switch by "time"."""
        radius: Annotated[float, POSITIVE.of("m")] = 0.3
        """Distance within which a waypoint counts as reached, m; the belief must be inside by 0.05 m, or a third of it."""
        laps: Annotated[int, Range(1, 2**31, whole=True)] = 1
        """Number of rounds through the waypoints."""
        relative: bool = False
        """Whether waypoints are relative to the first estimate instead of the world frame."""
        period: Annotated[float, Range(0.0, 1000.0, open_low=True, open_high=True, unit="s")] = 0.1
        """Period of publishing, s."""

        def __post_init__(self) -> None:
            typed(self, "")

    inputs = {
        "estimate": Input(topic="estimate", type=Estimate, required=False, reliable=False),
        "goal": Input(topic="goal_pose", type=Pose, required=False, max_age=None, once=True),
    }
    outputs = {
        "following": Output(topic="next_reference", type=Pose),
        "reference": Output(topic="reference", type=Pose),
    }

    def __init__(self, params: Params) -> None:
        in_room = params.waypoints == "room"
        if in_room:
            room_goal = Input(topic="room_goal", type=Pose, required=False, lock_step="same")
            self.inputs = {**self.inputs, "room_goal": room_goal}
        given = SQUARE_WAYPOINTS if in_room or params.waypoints == "square" else _load_waypoints(params.waypoints)
        task, self._waypoints = Options(task="square", waypoints=given, switch=params.switch, laps=params.laps).course()
        self._task = replace(task, radius=params.radius, switch_period=params.switch_period if by_time(task) else math.inf)
        self._relative, self._in_room = params.relative, in_room
        self.trigger = Every(params.period, answers="estimate")
        self.reset()

    def reset(self) -> None:
        """Restart with the first waypoint."""
        self._poses: Sequence[Pose] = () if self._relative or self._in_room else self._waypoints
        self._room_goal: Pose | None = None
        self._laps = self._task.laps
        self._visited = 0
        self._steps = 0

    def step(self, dt: float, estimate: Estimate | None, goal: Pose | None, room_goal: Pose | None = None) -> dict[str, Pose]:
        """Return the waypoint to reach and the one after it; nothing before they are known."""
        if room_goal is not None and room_goal != self._room_goal:  # the goal of another episode
            self._room_goal = room_goal
            goal = room_goal if goal is None else goal
        if goal is not None:
            self._poses, self._laps, self._visited, self._steps = (goal,), 1.0, 0, 0
        if not self._poses:
            if estimate is None or self._in_room:
                return {}
            origin = estimate.belief.mean
            self._poses = [_compose(Pose(origin.x, origin.y, origin.theta), pose) for pose in self._waypoints]
        last = int(len(self._poses) * self._laps) - 1
        if self._is_done_with(dt, estimate) and self._visited < last:
            self._visited += 1
        following = self._poses[min(self._visited + 1, last) % len(self._poses)]
        return {"reference": self._poses[self._visited % len(self._poses)], "following": following}

    def _is_done_with(self, dt: float, estimate: Estimate | None) -> bool:
        steps, timed = self._steps, by_time(self._task)
        self._steps += estimate is not None or steps > 0
        if timed or not steps:  # the first step of an episode is not judged
            return steps > 0 and due(steps, self._visited, self._task, dt)
        reference = self._poses[self._visited % len(self._poses)]
        return estimate is not None and believed_to_arrive(estimate.belief.mean, reference, self._task)


def _compose(origin: Pose, relative: Pose) -> Pose:
    """Transform a relative pose into the world frame."""
    sine, cosine = sincos(origin.theta)
    return Pose(
        origin.x + cosine * relative.x - sine * relative.y,
        origin.y + sine * relative.x + cosine * relative.y,
        wrap(origin.theta + relative.theta),
    )


def _load_waypoints(path: str) -> list[Pose]:
    """Read waypoints from a file: a YAML list of ``[x, y, theta]`` or of mappings, or CSV lines with or without a header.

    Args:
        path: The file, ending in .yaml, .yml or .csv.

    Raises:
        ValueError: If the file cannot be read; the message names the file and the entry.
    """
    file = Path(path).expanduser()
    if file.suffix not in (".yaml", ".yml", ".csv"):
        raise ValueError(f"waypoints must be 'square', 'room', or a .yaml, .yml or .csv file, got {path!r}.")
    try:
        rows = _read_csv(file) if file.suffix == ".csv" else _read_yaml(file)
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise ValueError(f"waypoints: cannot read {path!r}: {error}.") from error
    return [_pose(path, number, row) for number, row in enumerate(rows, start=1)]


def _read_csv(file: Path) -> list[Any]:
    with file.open(newline="") as stream:
        rows = [row for row in csv.reader(stream) if row and not row[0].startswith("#")]
    has_header = bool(rows) and [cell.strip() for cell in rows[0]] == ["x", "y", "theta"]
    return rows[1:] if has_header else rows


def _read_yaml(file: Path) -> list[Any]:
    try:
        content = load(file)
    except ValueError as error:
        raise ValueError(f"waypoints: {error}") from error
    rows = content.get("waypoints") if isinstance(content, dict) else content
    if not isinstance(rows, list):
        raise ValueError(f"waypoints: {str(file)!r} must hold a list of waypoints, got {shown(content)}.")
    return rows


def _pose(path: str, number: int, row: Any) -> Pose:
    """Return a file's entry as a pose."""
    try:
        if isinstance(row, dict):
            return Pose(**{name: float(value) for name, value in row.items()})
        x, y, theta = map(float, row)
        return Pose(x, y, theta)
    except (TypeError, ValueError, OverflowError) as error:
        raise ValueError(f"waypoints: entry {number} of {path!r} must be x, y and theta, got {shown(row)}.") from error

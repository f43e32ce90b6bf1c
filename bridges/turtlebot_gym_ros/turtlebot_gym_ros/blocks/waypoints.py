"""The reference: a sequence of waypoints, switched by time or on arrival."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

from turtlebot_gym.config import NON_NEGATIVE, POSITIVE, Range, check_fields
from turtlebot_gym.estimation.ekf import Estimate
from turtlebot_gym.files import load
from turtlebot_gym.models.angles import sincos
from turtlebot_gym.models.odometry import increment
from turtlebot_gym.systems import Options
from turtlebot_gym.tasks import SQUARE_PERIOD, SQUARE_WAYPOINTS, believed_to_arrive, by_time, due
from turtlebot_gym.values import ORIGIN, Pose
from turtlebot_gym_ros.node.block import PERIOD, Every, Input, Output
from turtlebot_gym_ros.node.errand import Errand, Failure

ROOM_GOAL = Input(topic="room_goal", type=Pose, required=False, lock_step="same", sole=True)


class WaypointGenerator:
    """Publish the waypoint to reach and the one after it periodically, so that a loss of the node is visible.

    It steps by the clock; in lock-step it answers each estimate, and its rule is then the environment's with
    ``arrival="belief"``. By time, the clock starts with the first estimate; the last waypoint stays. A reset restarts with the
    first one.

    A goal takes the place of all waypoints: a pose from RViz, or a goal of the action ``navigate_to_pose``, if ``nav2_msgs`` is
    installed. That one is reached when the controller is done with it; it is given up, with the reason, without an estimate for
    2.5 s, and without progress for ``patience``. If a goal is refused, cancelled or given up, the robot
    stays where it is until the next goal or a reset.

    Inputs, all optional: ``estimate`` (`Estimate`, on ``estimate``), ``goal`` (`Pose`, on ``goal_pose``), and if ``waypoints``
    is "room", ``room_goal`` (`Pose`, on ``room_goal``). Outputs: ``reference`` (`Pose`, on ``reference``), ``following``
    (`Pose`, on ``next_reference``), in the world frame.
    """

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Params:
        """Parameters of the waypoints."""

        frame: str = "odom"
        """World frame; poses in other frames are refused."""
        waypoints: str = "square"
        """"square", "room", the goal of the simulator's room, or a .yaml file, a list of [x, y, theta]. The square is the
        tutorial's; m and rad."""
        switch: str = "arrival"
        """When to switch to the next waypoint: on "arrival" by the estimate, or after a "time"."""
        switch_period: Annotated[float, POSITIVE.of("s")] = SQUARE_PERIOD
        """Time after which the next waypoint becomes current, s, with the switch by "time"."""
        radius: Annotated[float, POSITIVE.of("m")] = 0.3
        """Distance within which a waypoint counts as reached, m. The belief must be inside by 0.05 m, or a third of it."""
        laps: Annotated[int, Range(1, 2**31, whole=True)] = 1
        """Number of rounds through the waypoints."""
        relative: bool = False
        """Whether waypoints are relative to the first estimate instead of the world frame."""
        goal_tolerance: Annotated[float, NON_NEGATIVE.of("m")] = 0.15
        """Distance within which an action's goal is reached, m; with 0 it is ``radius``. As in velocity_controller."""
        patience: Annotated[float, POSITIVE.of("s")] = 30.0
        """Time without coming nearer after which an action's goal is given up, s. Without an estimate that takes 2.5 s."""
        period: Annotated[float, PERIOD] = 0.1
        """Period of publishing, s."""

        def __post_init__(self) -> None:
            check_fields(self, "")

    inputs = {
        "estimate": Input(topic="estimate", type=Estimate, required=False, reliable=False, sole=True),
        "goal": Input(topic="goal_pose", type=Pose, required=False, max_age=None, once=True),
    }
    outputs = {"following": Output(topic="next_reference", type=Pose), "reference": Output(topic="reference", type=Pose)}
    trigger = Every(0.1, answers="estimate")

    def __init__(self, params: Params) -> None:
        self._params, self._in_room = params, params.waypoints == "room"
        if self._in_room:
            self.inputs = {**self.inputs, "room_goal": ROOM_GOAL}
        course = SQUARE_WAYPOINTS if self._in_room or params.waypoints == "square" else _load_waypoints(params.waypoints)
        task, self._waypoints = Options(task="square", waypoints=course, switch=params.switch, laps=params.laps).course()
        self._task = replace(task, radius=params.radius, switch_period=params.switch_period if by_time(task) else math.inf)
        self._target = replace(task, radius=params.goal_tolerance or params.radius)
        self._errand: Errand | None = None
        self.notice: str | None = None
        """Why the last goal was refused or given up, if so."""
        self.trigger = replace(self.trigger, period=params.period)
        self.reset()

    def reset(self) -> None:
        """Restart with the first waypoint."""
        if self._errand:
            self._errand.end("failed", Failure.OTHER, "the node was reset")
        self._errand, self._here, self._rests, self.notice = None, None, False, None
        self._poses: Sequence[Pose] = () if self._params.relative or self._in_room else self._waypoints
        self._room_goal: Pose | None = None
        self._laps = self._task.laps
        self._visited = 0
        self._steps = 0

    def send(self, goal: Pose, *, awaited: bool = False) -> Errand:
        """Take a goal in the world frame, in place of all waypoints and of an earlier goal; somebody may await its outcome."""
        errand = self._take(Errand(goal=goal, awaited=awaited))
        self._head_for(goal)
        return errand

    def refuse(self, why: str, code: Failure = Failure.NOT_LOCALIZED) -> Errand:
        """Refuse a goal that is no pose in the world frame, and let the robot stay where it is."""
        errand = self._take(Errand(goal=ORIGIN))
        errand.end("failed", code, why)
        self.notice = f"goal refused, so the robot stays where it is: {errand.reason}"
        self._stay()  # no other drive takes its place
        return errand

    def _take(self, errand: Errand) -> Errand:
        if self._errand:
            self._errand.end("failed", Failure.OTHER, "another goal took its place")
        self._errand = errand
        return errand

    def _head_for(self, goal: Pose) -> None:
        self._poses, self._laps, self._visited, self._steps, self._rests, self.notice = (goal,), 1.0, 0, 0, False, None

    def cancel(self, errand: Errand) -> None:
        """Give up a goal, if it is still on its way, and let the robot stay where it is."""
        if errand.is_active:
            errand.end("cancelled")
            self._stay()

    def _stay(self) -> None:
        """Let the robot stay where it is: the controller is done at once, and without a pose it has no reference."""
        pose = self._here if self._params.goal_tolerance > 0.0 else None
        self._poses, self._laps, self._visited, self._rests = () if pose is None else (pose,), 1.0, 0, True

    def step(self, dt: float, estimate: Estimate | None, goal: Pose | None, room_goal: Pose | None = None) -> dict[str, Pose]:
        """Return the waypoint to reach and the one after it; nothing before they are known."""
        self._here = None if estimate is None else Pose(*estimate.belief.mean[:3])
        if room_goal is not None and room_goal != self._room_goal:  # the goal of another episode
            self._room_goal = room_goal
            self._head_for(room_goal)
        if goal is not None:
            self.send(goal)
        if self._errand and self._errand.is_active:
            self._attend(self._errand, dt, estimate)
        if not self._poses:
            if estimate is None or self._in_room or self._rests:
                return {}
            start = Pose(*estimate.belief.mean[:3])
            self._poses = [increment(start, ORIGIN, pose, sincos(start.theta)) for pose in self._waypoints]
        last = int(len(self._poses) * self._laps) - 1
        if self._is_done_with(dt, estimate) and self._visited < last:
            self._visited += 1
        following = self._poses[min(self._visited + 1, last) % len(self._poses)]
        return {"reference": self._poses[self._visited % len(self._poses)], "following": following}

    def _attend(self, errand: Errand, dt: float, estimate: Estimate | None) -> None:
        """Follow a goal on its way: reached by belief, or given up if somebody waits for it."""
        errand.time += dt
        if estimate is not None and self._here is not None:
            errand.at(self._here)
            if believed_to_arrive(estimate.belief.mean, errand.goal, self._target):
                errand.end("reached")
        if errand.awaited and (why := errand.overdue(self._params.patience)):
            errand.end("failed", *why)
        if errand.state == "failed":
            self.notice = f"goal given up: {errand.reason}"
            self._stay()

    def _is_done_with(self, dt: float, estimate: Estimate | None) -> bool:
        steps, timed = self._steps, by_time(self._task)
        self._steps += estimate is not None or steps > 0
        if timed or not steps:  # the first step of an episode is not judged
            return steps > 0 and due(steps, self._visited, self._task, dt)
        reference = self._poses[self._visited % len(self._poses)]
        return estimate is not None and believed_to_arrive(estimate.belief.mean, reference, self._task)


def _load_waypoints(path: str) -> Any:
    """Read a YAML list of ``[x, y, theta]``; `Options` checks the numbers."""
    try:
        return load(Path(path).expanduser())
    except (ValueError, OSError) as error:
        raise ValueError(f"waypoints must be 'square', 'room', or a .yaml file, got {path!r}: {error}") from error

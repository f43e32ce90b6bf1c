"""A policy that drives on beliefs: its observation from a belief, goals and a scan, and from its action a command."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.beams import TURN, narrow_gap
from turtlebot_gym.models.unicycle import command_of, limit
from turtlebot_gym.observations import (
    EVIDENCE,
    OPEN_GROUND,
    SCAN,
    SCAN_AGE,
    TERMS,
    TRACKS,
    History,
    evidence_of,
    goal_from,
    next_goal_from,
    row_of,
    size_of,
    stated_deviations,
    twist_of,
    uncertainty_of,
)
from turtlebot_gym.parameters import REFERENCE_PERIOD, Noise
from turtlebot_gym.presets import make_noise, make_robot
from turtlebot_gym.robots import Robot
from turtlebot_gym.rooms.lidar import MAX_AGE
from turtlebot_gym.rooms.scan import Scan, beams_in
from turtlebot_gym.rooms.sectors import Pooling
from turtlebot_gym.scan_watch import ScanWatch
from turtlebot_gym.systems.parameters import DT
from turtlebot_gym.validation import FINITE, NON_NEGATIVE, PROBABILITY
from turtlebot_gym.values import Command, Covariance, Pose, State
from turtlebot_gym_agents.policies.fit import robot_of
from turtlebot_gym_agents.policies.named import bare, bundle_of, make_policy
from turtlebot_gym_agents.policies.policy import PolicyWithMemory, terms_of
from turtlebot_gym_agents.policies.protection import SafetyLayer, within_layer
from turtlebot_gym_agents.policies.seen_space import LIDAR_X, LOOK, SeenSpace
from turtlebot_gym_agents.policies.yielding import Yielding

_LEAST_MARGIN = 0.06
"""Clearance down to which a robot inside its safety margins drives on, m; below it, the guard stops it."""
MARGIN, AHEAD = 0.05, 1.0
"""Clearance, m, and time, s, at which a robot brakes at the latest: it must not pass between two beams unseen from there."""
LAG = 0.4
"""Longest time from a motion to its effect in a scan, s: one revolution, and the driver."""
RETURNS = 0.02
"""Least share of a scan's beams that return something: fewer come from a covered LiDAR, or from a hall beyond its range."""
COVERED = "the robot turns: a part of its LiDAR seems to be covered"
AT_PLACE = 0.05
"""Distance up to which a LiDAR's place is taken for that with which policies are trained, m: there it varies by as much."""
_PAUSE = 2.5
"""Periods without a command after which a history, a frame stack or the state of a recurrent network begins anew."""


class NotBelievedError(ValueError):
    """A scan that the robot must not drive by: it cannot be read, or the LiDAR is frozen, covered or mounted otherwise."""


class BeliefDriver:
    """Drive a robot with a policy from beliefs that were checked before, as the ROS node ``velocity_controller`` does.

    The robot does not drive where its LiDAR has not looked, see `SeenSpace`: it turns, and looks. A LiDAR that is frozen,
    covered or mounted otherwise is refused, see `turtlebot_gym.scan_watch`. Apart from that, only the policy avoids obstacles
    without ``safety_margin``.

    Args:
        policy: What `make_policy` takes: a bundle's file, "ppo-rooms", "vfh", ...
        robot: A name in `turtlebot_gym.ROBOTS`, a file, or a robot; None for the one on a bundle's card, else "burger".
        period: Control period, s; None for the one on a bundle's card, else 0.1.
        noise: Noise of the motion, for which a `SafetyLayer` allows, as for `make_noise`.
        lidar_yaw: Direction of the LiDAR's frame in the robot's frame, rad.
        lidar_beams: Number of beams that a scan must have; 0 for any.
        lidar_returns: Least share of a scan's beams that return something; with 0, those that return nothing are believed.
        safety_margin: Clearance that a policy that sees keeps within a `SafetyLayer`, m; 0 for no layer.

    Raises:
        ValueError: If the policy is unknown or made for another robot or period.
        ImportError: If the policy is a bundle and onnxruntime is missing.
    """

    def __init__(
        self,
        policy: str | Path,
        *,
        robot: str | Robot | None = None,
        period: float | None = None,
        noise: str | Noise = "tutorial",
        lidar_yaw: float = 0.0,
        lidar_beams: int = 0,
        lidar_returns: float = RETURNS,
        safety_margin: float = 0.0,
    ) -> None:
        bundle = bundle_of(bare(str(policy)))
        if bundle and (robot is None or period is None):
            from turtlebot_gym_agents.policies.bundle import BundlePolicy

            card = BundlePolicy(bundle, robot=robot, dt=period).card
            robot, period = robot_of(card.robot) if robot is None else robot, card.dt if period is None else period
        robot, motion = "burger" if robot is None else robot, make_noise(noise)
        self.robot = make_robot(robot)
        """The robot, whose limits a command keeps."""
        self.period = DT.check("period", REFERENCE_PERIOD if period is None else period)
        """Control period, s."""
        self._policy = make_policy(str(policy), robot=robot, dt=self.period, noise=motion)
        self._recurrent = _recurrent(self._policy)
        self.terms = terms_of(self._policy) or OPEN_GROUND
        """The terms of the policy's observation."""
        names = [term.name for term in self.terms]
        self.sees, self.is_located = SCAN.name in names, EVIDENCE.name in names
        """Whether it needs scans, and a localizer's evidence."""
        if SCAN_AGE.name in names and not self.sees:
            raise ValueError("a policy that reads 'scan_age' must read 'scan', too.")
        self.own_terms = tuple(term for term in self.terms if term.name not in TERMS or term.name == TRACKS.name)
        """The terms that are not computed here, such as those of a tracker: `act` needs their numbers."""
        if NON_NEGATIVE.check("safety_margin", safety_margin) and self.sees:
            behind = max(safety_margin, SafetyLayer.margin_behind)
            margins: dict[str, Any] = {"margin": safety_margin, "margin_behind": behind, "least_margin": _LEAST_MARGIN}
            self._policy = within_layer(self._policy, self.robot, self.period, noise=motion, **margins)
            self.terms = terms_of(self._policy) or OPEN_GROUND
        self._yaw, self._returns = FINITE.check("lidar_yaw", lidar_yaw), PROBABILITY.check("lidar_returns", lidar_returns)
        self.pool = Pooling(yaw=self._yaw, beams=lidar_beams)
        """Pools scans into the sectors of the observation."""
        self.seen_space = SeenSpace(self.robot, self.period)
        """Keeps the robot where beams have passed; its ``notice`` says when it does."""
        self.observation: NDArray[np.float32] = np.zeros(size_of(self.terms), np.float32)
        """Last observation of the policy, shape (n,), the numbers of its terms."""
        self._history, self._is_first = History(self.terms, 1), True
        self._time = self._last = 0.0
        self.action: NDArray[np.float32] = np.zeros(2, np.float32)
        """Last action of the policy, shape (2,), in [-1, 1] or clipped to it."""
        BeliefDriver.reset(self)  # not that of a derived class, which is not complete yet

    def reset(self) -> None:
        """Begin an episode: clear the memory of a policy that has one, and what was seen."""
        self._time, self._last, self._is_first = 0.0, 0.0, True
        self.seen_space.reset()
        narrow = narrow_gap(self.robot.radius, MARGIN + self.robot.max_linear * AHEAD)
        self._watch, self._measured = ScanWatch(lag=LAG, returns=self._returns, narrow=narrow, now=0.0), -math.inf
        self._turned, self._looked = 0.0, 0.0  # while the LiDAR seems to be covered: angle, rad, and time, s
        if isinstance(self._policy, PolicyWithMemory):
            self._policy.reset(np.ones((), np.bool_))  # of shape (...), as observations are (..., n)

    def look(self, scan: Scan, twist: Command, age: float, now: float, mount: Pose | None = None) -> list[float]:
        """Return the sectors of a scan for `command`, in which beams that say nothing are unknown, see `scan_watch`.

        Args:
            scan: The newest scan.
            twist: The robot's twist.
            age: Age of the scan, s.
            now: Current time, s.
            mount: Pose of its frame in the robot's frame; None for the usual place, turned by ``lidar_yaw``.

        Raises:
            NotBelievedError: With one line. A robot whose LiDAR seems to be covered in part turns once around first: the edges
                of a cover turn with it.
            ValueError: If it has another number of beams than ``lidar_beams``.
        """
        self._watch.track.add(twist, now)
        if now - age > self._measured + 1e-6:  # between two scans, each step has the last one again
            self._measured, at, self._bad = now - age, mount or Pose(LIDAR_X, 0.0, self._yaw), ""
            try:
                beams = self._watch.hear(beams_in(scan), self._measured, mount=at, range_max=scan.range_max)
                self._scan = scan._replace(ranges=beams.ranges)
            except ValueError as why:
                self._bad = str(why)
        if why := self._bad or self._watch.trouble():
            raise NotBelievedError(why)
        covered = self._watch.covered
        self._turned = self._turned + abs(twist.omega) * (now - self._looked) if covered else 0.0
        self._looked = now
        if self._turned > TURN:
            raise NotBelievedError(
                f"{math.degrees(covered):.0f} degrees of the LiDAR return nothing, however the robot turns: it is covered"
            )
        return self.pool(self._scan, _shifted(mount))

    def command(
        self,
        mean: State,
        covariance: Covariance,
        nis: float,
        reference: Pose,
        following: Pose,
        sectors: Sequence[float] = (),
        scan_age: float = 0.0,
        evidence: tuple[float, float] | None = None,
        own: Mapping[str, tuple[float, ...]] = MappingProxyType({}),
        now: float | None = None,
    ) -> Command:
        """Return the command for a belief and a scan's `pool`, checked before; the other arguments are those of `act`.

        Call it once per period, unless ``now``, the current time in s, is given.

        Raises:
            ValueError: If the policy does not return two finite numbers.
        """
        values: dict[str, Any] = {
            "goal": goal_from(mean, reference),
            "twist": twist_of(mean, self.robot),
            "uncertainty": uncertainty_of(stated_deviations(covariance), nis),
            "next_goal": next_goal_from(mean, following),
            "evidence": () if evidence is None else evidence_of(mean.theta, covariance, *evidence),
            "scan": tuple(sectors),
            "scan_age": min(max(scan_age, 0.0), MAX_AGE),
            **own,
        }
        self.observation = np.array(row_of(self.terms, [values[term.name] for term in self.terms]), np.float32)
        # What was seen before it stood is not what was seen a step ago.
        paused = now is not None and now - self._last > _PAUSE * self.period
        if paused and self._recurrent is not None:
            self._recurrent.reset(np.ones((), np.bool_))
        if self._history:
            row = self.observation[None]
            if self._is_first or paused:
                self._history.begin(row, np.ones(1, np.bool_))
            else:
                self._history.advance(row)
        self._is_first, self._last = False, self._time if now is None else now
        self.action = np.asarray(self._policy(self.observation), np.float32)
        if self.action.shape != (2,) or not all(map(math.isfinite, self.action.tolist())):
            raise ValueError(f"a policy must return two finite numbers, got {self.action!r}")
        forward, turn = self.action.tolist()
        wish = limit(command_of(forward, turn, self.robot), self.robot)
        self._time = self._time + self.period if now is None else now
        if not sectors or self.pool.seen is None:
            return wish
        if self._watch.covered:
            self.seen_space.notice = COVERED
            return Command(0.0, min(LOOK, self.robot.max_angular))
        return self.seen_space.limit(wish, Command(mean.v, mean.omega), self.pool.seen, scan_age, self._time)


def _shifted(mount: Pose | None) -> Pose | None:
    """Return a LiDAR's mount as seen from the place from which policies see; at that place if it is near."""
    if mount is None:
        return None
    x, y = mount.x - LIDAR_X, mount.y
    return Pose(*((x, y) if math.hypot(x, y) > AT_PLACE else (0.0, 0.0)), mount.theta)


def _recurrent(policy: Any) -> Any:
    """Return the bundle with memory that a policy is, or has within its layers; None if there is none."""
    while isinstance(policy, (SafetyLayer, Yielding)):
        policy = policy.policy
    return policy if getattr(policy, "card", None) is not None and policy.memory else None

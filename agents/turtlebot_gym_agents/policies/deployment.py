"""A policy on your own sensors, without ROS: from the measurements of a robot or another simulator to a command."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from turtlebot_gym.config import FINITE, NON_NEGATIVE, PROBABILITY, Range, refusal
from turtlebot_gym.estimation.agreement import Agreement
from turtlebot_gym.estimation.filters import FilterObject, filter_of
from turtlebot_gym.models.unicycle import command_of, limit
from turtlebot_gym.observations import (
    EVIDENCE,
    OPEN_GROUND,
    SCAN,
    SCAN_AGE,
    TERMS,
    TRACKS,
    evidence_of,
    goal_from,
    next_goal_from,
    twist_of,
    uncertainty_of,
)
from turtlebot_gym.observations.columns import History, row_of, size_of
from turtlebot_gym.parameters import REFERENCE_PERIOD, FilterTuning, Noise
from turtlebot_gym.presets import make_filter, make_noise, make_robot
from turtlebot_gym.robots import Robot
from turtlebot_gym.rooms.lidar import MAX_AGE
from turtlebot_gym.rooms.scan import Scan
from turtlebot_gym.systems.parameters import DT
from turtlebot_gym.values import ORIGIN, STOP, Command, Covariance, Odometry, Pose, State
from turtlebot_gym_agents.policies.fit import robot_of
from turtlebot_gym_agents.policies.measured import SHARES, TWIST, covariance_of, pose_of, scan_of
from turtlebot_gym_agents.policies.named import bare, bundle_of, make_policy
from turtlebot_gym_agents.policies.policy import PolicyWithMemory, terms_of
from turtlebot_gym_agents.policies.protection import SafetyLayer, within_layer
from turtlebot_gym_agents.policies.scans import Scans
from turtlebot_gym_agents.policies.yielding import Yielding

_AGE = Range(0.0, MAX_AGE, unit="s")
_INTERVAL = Range(0.0, 1.0, open_low=True, unit="s")
_LEAST_MARGIN = 0.06
"""Clearance down to which a robot inside its safety margins drives on, m; below it, the guard stops it."""
RETURNS = 0.02
"""Least share of a scan's beams that return something: fewer come from a covered LiDAR, or from a hall beyond its range."""
_PAUSE = 2.5
"""Periods without a command after which a history, a frame stack or the state of a recurrent network begins anew."""


class Deployment:
    """Drive a robot with a policy, as the environments and the ROS node ``velocity_controller`` do.

    `act` checks measurements and returns a command; `command` is the part without checks, which the node uses too. With
    ``filter``, a name for `make_filter` such as "matched", the package's own filter is inside, and poses are those of odometry;
    otherwise they come from a localization, with their covariance. The filter is matched to ``noise``, and predicts by the
    ``integrator``, "euler" or "midpoint".

    The robot does not drive where its LiDAR has not looked, see `SeenSpace`: it turns, and looks. A LiDAR that is frozen,
    covered or mounted otherwise is refused, see `turtlebot_gym.scan_watch`. Apart from that, only the policy avoids obstacles,
    unless a `SafetyLayer` keeps the clearance ``safety_margin``, m. The caller must stop the robot if an exception is raised.
    `act` also compares pose, twist and its own last command (`Agreement`): if they contradict each other for longer than noise
    can, it returns `STOP` until `reset`, and ``disagreement`` says why.

    ``robot`` and ``period``, s, are by default those on a bundle's card, else "burger" and 0.1. The LiDAR's frame is turned by
    ``lidar_yaw``, rad, in the robot's; a scan has ``lidar_beams`` beams, or any number if 0, of which at least the share
    ``lidar_returns`` return something: with 0, for halls beyond its range, beams that return nothing are believed. An unknown
    policy, one made for another robot or period, and a filter that reads more than odometry are refused.
    """

    def __init__(
        self,
        policy: str | Path,
        *,
        robot: str | Robot | None = None,
        period: float | None = None,
        filter: str | FilterTuning | None = None,
        noise: str | Noise = "tutorial",
        integrator: str = "euler",
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
        robot, noise = "burger" if robot is None else robot, make_noise(noise)
        self.robot = make_robot(robot)
        """The robot, whose limits a command keeps."""
        self.period = DT.check("period", REFERENCE_PERIOD if period is None else period)
        """Control period, s."""
        self._policy = make_policy(str(policy), robot=robot, dt=self.period, noise=noise)
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
            self._policy = within_layer(self._policy, self.robot, self.period, noise=noise, **margins)
            self.terms = terms_of(self._policy) or OPEN_GROUND
        yaw, returns = FINITE.check("lidar_yaw", lidar_yaw), PROBABILITY.check("lidar_returns", lidar_returns)
        self.scans = Scans(self.robot, self.period, yaw=yaw, beams=lidar_beams, returns=returns)
        """Reads scans for `command`, and keeps the robot where beams have passed."""
        self.observation: NDArray[np.float32] = np.zeros(size_of(self.terms), np.float32)
        """Last observation of the policy, shape (n,), the numbers of its terms."""
        self._history = History(self.terms, 1)
        self.action: NDArray[np.float32] = np.zeros(2, np.float32)
        """Last action of the policy, shape (2,), in [-1, 1] or clipped to it."""
        if filter is not None and self.is_located:
            raise ValueError("filter must be None for a policy that reads 'evidence': it is a localizer's.")
        self.filter: FilterObject | None = None
        """The filter inside, with its belief; None without one."""
        if filter is not None:
            tuning = make_filter(filter, noise)
            if more := set(filter_of(tuning).reads) - {"odometry"}:
                raise ValueError(f"filter must read odometry only, but this one also reads {', '.join(sorted(more))}.")
            self.filter = FilterObject(tuning, dt=self.period, integrator=integrator)
        self._agreement = Agreement(self.robot, noise, leaps=filter is None)
        self.reset()

    def reset(self) -> None:
        """Begin an episode: clear the filter, the memory of a policy that has one, what was seen, and a disagreement."""
        self._time, self._last, self._is_first = 0.0, 0.0, True
        self.scans.reset()
        if isinstance(self._policy, PolicyWithMemory):
            self._policy.reset(np.ones((), np.bool_))  # of shape (...), as observations are (..., n)
        self._agreement.begin()
        self._command, self._begun = STOP, False

    def act(
        self,
        pose: ArrayLike | None,
        covariance: ArrayLike | None,
        twist: ArrayLike,
        scan: Scan | None,
        goal: ArrayLike,
        *,
        following: ArrayLike | None = None,
        nis: float = 0.0,
        scan_age: float = 0.0,
        dt: float | None = None,
        evidence: ArrayLike | None = None,
        own: Mapping[str, ArrayLike] | None = None,
    ) -> Command:
        """Return the command for the next control period, within the robot's limits; `STOP` while there is a `disagreement`.

        Call it once per period. Poses and goals are in one world frame.

        Args:
            pose: x, y and heading; m, rad. With a filter inside, odometry's, or None if none arrived in this period.
            covariance: Variances of x, y and heading, or their 3 x 3 matrix; zeros for exact poses, None with a filter inside.
            twist: Speed and turning rate in the robot's frame, m/s and rad/s: estimated, or as measured by the wheels.
            scan: The LiDAR's newest scan as its driver sends it; None if the policy sees none.
            goal: The waypoint to reach: x, y and heading.
            following: The waypoint after it; None if there is none.
            nis: Normalized innovation squared of the last measurement; 0 for exact poses, and with a filter inside.
            scan_age: Age of the scan by its stamp, s.
            dt: Time since the last call, s, for a filter inside; None for a period.
            evidence: For a policy that reads it, from a localizer: shares of fitting beams and of the best hypothesis.
            own: Numbers of each of `own_terms` by name; they are clipped to its bounds.

        Raises:
            ValueError: With one line, if an input is invalid or does not fit; filter and policy then keep their memory.
        """
        interval = self.period if dt is None else _INTERVAL.check("dt", dt)
        self._time += interval  # also if the rest is refused: what was seen grows older
        reference = pose_of("goal", goal)
        after = reference if following is None else pose_of("following", following)
        speeds = Command(*TWIST.check("twist", twist))
        age = _AGE.check("scan_age", scan_age)
        self._require("scan", scan, self.sees, "a Scan")
        sectors = () if scan is None else self.scans.look(scan_of(scan), speeds, age, self._time)
        self._require("evidence", evidence, self.is_located, "shares of fitting beams and of the best hypothesis")
        shares, values = None if evidence is None else SHARES.check("evidence", evidence), self._numbers(own or {})
        at = None if pose is None else pose_of("pose", pose)
        if self.filter:
            if covariance is not None or nis != 0.0:
                raise ValueError("covariance must be None and nis 0 with a filter inside, which states its own.")
            self._believe(self.filter, at, speeds, interval)
            (mean, P), nis = self.filter.belief, self.filter.nis
        else:
            if at is None or covariance is None:
                missing = "pose" if at is None else "covariance"
                raise ValueError(f"{missing} must be given without a filter inside, got None; zero variances for exact poses.")
            mean, P = State(*at, *speeds), covariance_of(covariance)
            nis = NON_NEGATIVE.check("nis", nis)
        self._agreement.judge(interval, Odometry(at or ORIGIN, speeds, at is not None), self._command)
        if self.disagreement:
            return STOP
        self._command = self.command(mean, P, nis, reference, after, sectors, age, shares, values, self._time)
        return self._command

    def command(
        self,
        mean: State,
        covariance: Covariance,
        nis: float,
        reference: Pose,
        following: Pose,
        sectors: Sequence[float] = (),
        scan_age: float = 0.0,
        evidence: Sequence[float] | None = None,
        own: Mapping[str, tuple[float, ...]] = MappingProxyType({}),
        now: float | None = None,
    ) -> Command:
        """Return the command for a belief and the sectors that `scans` has read, checked before; the rest is as for `act`.

        Call it once per period, unless ``now``, the current time in s, is given.

        Raises:
            ValueError: If the policy does not return two finite numbers.
        """
        values: dict[str, Any] = {
            "goal": goal_from(mean, reference),
            "twist": twist_of(mean, self.robot),
            "uncertainty": uncertainty_of(covariance, nis),
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
        return self.scans.limit(wish, Command(mean.v, mean.omega), scan_age, self._time) if sectors else wish

    @property
    def notice(self) -> str:
        """Why the last command was not the policy's, since a LiDAR has not looked there; empty if it was."""
        return self.scans.seen_space.notice

    @property
    def disagreement(self) -> str:
        """Why pose, twist and command are not believed any more, until `reset`; an empty text if they are."""
        return self._agreement.cause

    def _require(self, name: str, value: Any, read: bool, what: str) -> None:
        """Refuse a measurement that the policy does not read, and a missing one that it reads."""
        if (value is not None) != read:
            raise refusal(name, f"{what if read else 'None'} for a policy that reads {'' if read else 'no '}{name!r}", value)

    def _numbers(self, own: Mapping[str, Any]) -> dict[str, tuple[float, ...]]:
        """Return the numbers of `own_terms`, clipped to their bounds."""
        names = [term.name for term in self.own_terms]
        if {*own} != {*names}:
            raise ValueError(f"own must have the terms that the policy reads, {names}, got {[*own]}.")
        return {term.name: term.read(own[term.name]) for term in self.own_terms}

    def _believe(self, filter: FilterObject, pose: Pose | None, twist: Command, dt: float) -> None:
        """Advance the filter inside by an interval."""
        if self._begun:
            filter.dt = dt
            filter.step(twist, pose)
        elif pose is None:
            raise ValueError("pose must be given in the first call, got None.")
        else:
            filter.start(pose)
            self._begun = True


def _recurrent(policy: Any) -> Any:
    """Return the bundle with memory that a policy is, or has within its layers; None if there is none."""
    while isinstance(policy, (SafetyLayer, Yielding)):
        policy = policy.policy
    return policy if getattr(policy, "card", None) is not None and policy.memory else None

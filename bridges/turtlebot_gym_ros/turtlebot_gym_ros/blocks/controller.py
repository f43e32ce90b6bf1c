"""The controller: any policy, from the environment's observation to a command within the robot's limits."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Any

from turtlebot_gym.config import FINITE, NON_NEGATIVE, Range, check_fields, short_repr
from turtlebot_gym.estimation.agreement import Agreement
from turtlebot_gym.estimation.ekf import Estimate
from turtlebot_gym.models.angles import wrap
from turtlebot_gym.mounts import SAME_WAY
from turtlebot_gym.observations import TRACKS, ObservationTerm
from turtlebot_gym.observations.reading import own_term
from turtlebot_gym.presets import make_noise, make_robot
from turtlebot_gym.tasks import NAV, believed_to_arrive
from turtlebot_gym.values import STOP, Command, Odometry, Pose
from turtlebot_gym_agents.policies.deployment import Deployment
from turtlebot_gym_agents.policies.scans import NotBelievedError
from turtlebot_gym_ros.node.block import HALT, SCAN, Input, Nis, On, Output, Stamped, Tracks

OLDEST = 0.5
"""Age of a measurement on which a command may rest, s: the guard's."""
OWN = "own_"
"""Beginning of the name of an input that brings a term of a policy's own."""
VARIANCE_FLOOR = 1e-6
"""Replacement for a stated variance of exactly zero, (1 mm)^2 or (1 mrad)^2, since no pose is known exactly."""


def _input_of(term: ObservationTerm, named: Mapping[str, ObservationTerm]) -> Input:
    """Return the input that brings a term of a policy's own.

    A bundle only says what it reads: which code reads its topic, a person says, so that no bundle names a module. Raises
    `ValueError` if no topic brings the term, or it has other numbers than the policy was made for.
    """
    if term.name == TRACKS.name:
        return Input(topic="tracks", type=Tracks, lock_step="same", reliable=False, sole=True)
    here = term if term.convert else named.get(term.name)
    if here is None:
        made_with = f", such as {term.source}" if term.source else ""
        raise ValueError(f"the policy reads {term.name!r}: name it in the parameter terms, MODULE:NAME{made_with}.")
    if here.bounds != term.bounds:
        made, has = short_repr(term.bounds), short_repr(here.bounds)
        raise ValueError(f"the policy reads {term.name!r} with bounds {made}, but {here.source} has {has}.")
    convert = here.convert
    if convert is None:
        raise ValueError(f"the policy reads {term.name!r}: give {here.source} a topic, message and convert.")
    return Input(
        topic=here.topic,
        type=tuple,
        message=here.message,
        read=lambda message: here.read(convert(message)),
        max_age=min(here.lasts, OLDEST),
        lasts=max(here.lasts - OLDEST, 0.0),
        lock_step="refused",
        reliable=False,
        sole=True,
    )


class VelocityController:
    """Drive to the reference with a policy. One that reads the term "scan" sees the room by LiDAR, one that reads "evidence"
    needs a localizer, one that reads "tracks" a `PeopleTracker`; others see only poses. A term of its own comes on the topic
    that the term names.

    It steps with each estimate, decimated to the policy's period. Within ``goal_tolerance`` of a last waypoint it is done: it
    stops and releases the robot until the reference changes. With a LiDAR that is frozen, covered or mounted otherwise, by the
    rule of the guard's monitor (`scan_watch`) and the estimate's twist, it stands.

    Inputs: in the world frame ``estimate`` (`Estimate`, on ``estimate``), ``reference`` (`Pose`, on ``reference``),
    ``following`` (`Pose`, on ``next_reference``; optional: the waypoint after it); ``nis`` (`Nis`, on ``nis``; optional, but
    for "evidence"); ``disagreement``, on which the robot stops until it is enabled; for a policy that sees ``scan`` (`Scan`, on
    ``scan``, of a full revolution); and ``own_NAME`` for each term of the policy's own. Outputs: ``command`` (`Command`, on
    ``cmd_vel``).
    """

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Params:
        """Parameters of the controller."""

        policy: str = "bearing"
        """A baseline such as "bearing", a bundle (FILE.onnx), gains (FILE.yaml), or "module:callable". A file of gains is a
        baseline's; bundles that come with the package are "ppo-nav" and "ppo-square"."""
        terms: str = ""
        """Terms of your own that a bundle reads, MODULE:NAME with commas: topics bring them."""
        robot: str = "burger"
        """A name in `turtlebot_gym.robots.ROBOTS`, or a FILE.yaml."""
        noise: str = "tutorial"
        """Noise of the motion, for the safety layer: one of `turtlebot_gym.presets.NOISES`, or FILE.yaml."""
        period: Annotated[float, Range(0.001, 10.0, unit="s")] = 0.1
        """Period for which the policy was made, s; slower estimates are an error."""
        goal_tolerance: Annotated[float, NON_NEGATIVE.of("m")] = 0.15
        """Distance to a last waypoint within which the robot is done, m; with 0 it never is. The belief must be inside by 0.05
        m, or a third of it."""
        lidar_yaw: Annotated[float, FINITE.of("rad")] = 0.0
        """Direction of the LiDAR in the robot's frame, rad: pi/2 on a TurtleBot 4; 0: by /tf_static. With another direction
        than ``/tf_static`` states the robot stands."""
        lidar_beams: Annotated[int, Range(0, 2**31, whole=True)] = 0
        """Number of beams that a scan must have; 0 for any."""
        lidar_returns: Annotated[float, Range(0.0, 1.0)] = 0.0
        """Least share of a scan's beams that return something, or the robot stands; 0 for any. Less must last for 0.5 s: the
        LiDAR may be covered. With 0, beams that return nothing are believed, as in a simulation."""

        safety_margin: Annotated[float, NON_NEGATIVE.of("m")] = 0.0
        """Clearance that a policy that sees keeps, within its safety layer, m; 0 for no layer. On a robot it is 0.08 m: then
        the guard's collision monitor hardly ever intervenes."""

        def __post_init__(self) -> None:
            check_fields(self, "")
            if 0.0 < self.goal_tolerance < 0.01:
                rule = "must be 0, or at least 0.01 m, the resolution of a TurtleBot3"
                raise ValueError(f"goal_tolerance {rule}, got {self.goal_tolerance!r}.")

    inputs = {
        "nis": Input(topic="nis", type=Nis, required=False, lock_step="same", reliable=False, wakes=False, sole=True),
        "estimate": Input(topic="estimate", type=Estimate, reliable=False, sole=True),
        "reference": Input(topic="reference", type=Pose, lock_step="same", measured=False, sole=True),
        "following": Input(topic="next_reference", type=Pose, required=False, lock_step="same", sole=True),
        "disagreement": HALT,
    }
    outputs = {"command": Output(topic="cmd_vel", type=Command, stop=STOP)}
    trigger = On("estimate", period=0.1)

    def __init__(self, params: Params) -> None:
        self.trigger = replace(self.trigger, period=params.period)
        self.driver = Deployment(
            params.policy,
            robot=params.robot,
            period=params.period,
            lidar_yaw=params.lidar_yaw,
            lidar_beams=params.lidar_beams,
            lidar_returns=params.lidar_returns,
            safety_margin=params.safety_margin,
            noise=params.noise,
        )
        """The policy; it stores its last observation and action."""
        self._agreement = Agreement(make_robot(params.robot), make_noise(params.noise), leaps=True)
        self._goal = replace(NAV, radius=params.goal_tolerance) if params.goal_tolerance > 0.0 else None
        self._warned = False
        if self.driver.sees:
            self.inputs = {**self.inputs, "scan": SCAN}
        named = {term.name: term for term in map(own_term, filter(None, params.terms.split(",")))}
        unread = sorted(named.keys() - {term.name for term in self.driver.own_terms})
        if unread:
            raise ValueError(f"the parameter terms names {unread[0]!r}, which the policy does not read: leave it out.")
        self.inputs = {**self.inputs, **{f"{OWN}{term.name}": _input_of(term, named) for term in self.driver.own_terms}}
        self.notice: str | None = None
        """Why the robot stands in spite of its policy, if so."""
        self._yaw = params.lidar_yaw
        self.reset()

    def reset(self) -> None:
        """Forget the last episode, including a policy's memory."""
        self._done_with: Pose | None = None
        self._agreement.begin()
        self._time = 0.0
        self.notice = None
        self.driver.reset()

    def step(
        self,
        dt: float,
        estimate: Estimate,
        reference: Pose,
        following: Pose | None,
        scan: Stamped | None = None,
        nis: Nis | None = None,
        **own: tuple[float, ...],
    ) -> dict[str, Any]:
        """Return the command, or nothing if the robot is done; ``own`` are the numbers of the policy's own terms.

        An estimate whose pose repeats itself to the bit while its twist says that the robot moves raises `ValueError`. It may
        leap, as a localization does.
        """
        self._time += dt
        mean, P = estimate.belief
        self._agreement.judge(dt, Odometry(Pose(*mean[:3]), Command(mean.v, mean.omega), True))
        if self._agreement.cause:
            raise ValueError(f"the estimate is not believed: {self._agreement.cause}")
        if min(P.xx, P.yy, P.tt) <= 0.0:
            P = P._replace(**{name: getattr(P, name) or VARIANCE_FLOOR for name in ("xx", "yy", "tt")})
            if not self._warned:
                logging.getLogger(__name__).warning("An estimate states a variance of zero; taken as %g.", VARIANCE_FLOOR)
            self._warned = True
        is_last = following is None or following == reference
        if self._goal and is_last and (reference == self._done_with or believed_to_arrive(mean, reference, self._goal)):
            self._done_with = reference
            return {}
        self._done_with = None
        seen: tuple[Any, float] = ((), 0.0)
        evidence: tuple[float, float] | None = None
        if self.driver.is_located and nis is not None and nis.fits is not None and nis.weight is not None:
            evidence = nis.fits, nis.weight
        try:
            if scan is not None:
                seen = self._look(scan, Command(mean.v, mean.omega)), scan.age
            if self.driver.is_located and evidence is None:
                raise NotBelievedError("its policy needs a localizer, whose evidence is not on nis")
        except NotBelievedError as why:
            self.notice = f"the robot stands: {why}"
            return {"command": STOP}
        surprise = estimate.nis if nis is None else nis.value
        after = following or reference
        terms = {name.removeprefix(OWN): numbers for name, numbers in own.items()}
        command = self.driver.command(mean, P, surprise, reference, after, *seen, evidence, terms, self._time)
        self.notice = self.driver.notice or None
        return {"command": command}

    def _look(self, scan: Stamped, twist: Command) -> list[float]:
        """Return the sectors of a scan, or raise `NotBelievedError` with the reason for which it must not be used."""
        yaw = scan.mount.theta if scan.mount else self._yaw
        if self._yaw and abs(wrap(yaw - self._yaw)) > SAME_WAY:
            raise NotBelievedError(f"lidar_yaw is {self._yaw:.3f}, but /tf_static says {yaw:.3f} rad: correct one of them")
        return self.driver.scans.look(scan.value, twist, scan.age, self._time, scan.mount)

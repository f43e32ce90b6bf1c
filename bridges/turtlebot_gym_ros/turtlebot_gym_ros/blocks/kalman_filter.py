"""The estimator: the environment's own filter, triggered by odometry."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Annotated, Any

from turtlebot_gym.estimation.ekf import Estimate
from turtlebot_gym.estimation.filters import filter_of
from turtlebot_gym.estimation.fixes import depth_of, no_fix, with_fixes
from turtlebot_gym.models.angles import sincos
from turtlebot_gym.models.odometry import increment
from turtlebot_gym.models.unicycle import INTEGRATORS, limit
from turtlebot_gym.parameters import MAX_FIX_AGE, FilterTuning
from turtlebot_gym.presets import make_filter, make_noise, make_robot
from turtlebot_gym.validation import Range, choose, typed
from turtlebot_gym.values import STOP, Command, Fix, Odometry, Pose, senses_of
from turtlebot_gym_ros.blocks.credible import Credible, Gate, bounded
from turtlebot_gym_ros.node.block import Aged, Input, Nis, On, Output

REMEMBERED = depth_of(0.01)
"""Number of steps stored for late fixes: half a second of odometry at 100 Hz, longer at lower rates."""
STANDS = Command(0.01, 0.05)
"""Twist up to which the odometry of a robot says that it stands; m/s, rad/s."""
_SENSES = senses_of(("odometry", "fix"))


class KalmanFilter:
    """Estimate the pose from odometry.

    It begins with the first odometry, and predicts with the twist that the wheels executed: the exact one from the simulator,
    or the wheels' measured twist, with its noise, on a robot. If a pose drops out, it only predicts; if messages are lost, it
    predicts period by period, and restarts after ``max_gap``. Nothing is published without odometry, so a loss of odometry is
    visible.

    With ``takes_fixes`` it also uses external pose measurements, each at its own stamp, up to 0.5 s late.

    Odometry that the robot cannot have driven, and fixes that its belief rules out, are refused, see `credible`: counted,
    reported, and not used. A person puts the robot elsewhere by a pose on ``initialpose``, as RViz sends it, while it stands:
    the filter starts anew from there, with the stated variances, and from then on reads odometry from there.

    Inputs: ``odometry`` (`Odometry`, on ``odom``, every message); with ``twist`` "commanded", ``command`` (`Command`, on
    ``cmd_vel``; optional, the last value holds); with ``takes_fixes``, ``fix`` (`Fix`, on ``pose_fix``, optional); and ``seat``
    (`Fix`, on ``initialpose``, optional).
    Outputs: ``nis`` (`Nis`, on ``nis``), the normalized innovation squared, and ``estimate`` (`Estimate`, on ``estimate``), at
    odometry's stamp and in its frame.
    Parameters: those of `Params`.
    """

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Params:
        """Parameters of the filter."""

        robot: str = "burger"
        """A name in `turtlebot_gym.robots.ROBOTS`."""
        noise: str = "tutorial"
        """Noise to which the filter is matched: a name in `turtlebot_gym.presets.NOISES`, or a FILE.yaml."""
        filter: str = "matched"
        """A name in `turtlebot_gym.presets.FILTERS`: matched, calibrated, tutorial, gated, mixture, slip or scale."""
        integrator: str = "euler"
        """"euler" or "midpoint"."""
        twist: str = "executed"
        """Twist of the prediction: "executed", that in ``/odom``, or "commanded", the last ``/cmd_vel``, for odometry without a
        twist; not in lock-step. Commands are not tied to steps: on a busy machine the filter used another one than the robot in
        109 of 402 steps, and its error rose from 0.038 m to as much as 0.113 m."""
        takes_fixes: bool = False
        """Whether to use external pose measurements on ``pose_fix`` too, such as localization in a map or motion capture: in
        the filter's frame, with their covariance; a heading with a negative variance is ignored."""
        period: Annotated[float, Range(0.0, 60.0, open_low=True, unit="s")] = 0.1
        """Longest interval predicted in one step, s."""
        max_gap: Annotated[float, Range(0.0, 60.0, open_low=True, open_high=True, unit="s")] = 1.0
        """Gap in the odometry after which the filter restarts, s."""

        publish_tf: bool = False
        """Whether to publish the estimate on ``/tf`` too, from the world frame to the robot's. That transform must have one
        owner: set it only if the robot's bring-up does not publish it. Needs a ROS installation."""

        def __post_init__(self) -> None:
            typed(self, "")
            if self.period > self.max_gap:
                raise ValueError(f"period must be at most max_gap, {self.max_gap!r} s, got {self.period!r}.")

    inputs = {
        "odometry": Input(topic="odom", type=Odometry, reliable=False, sole=True),
        "seat": Input(topic="initialpose", type=Fix, required=False, once=True),
    }
    outputs = {"nis": Output(topic="nis", type=Nis), "estimate": Output(topic="estimate", type=Estimate)}

    def __init__(self, params: Params) -> None:
        self.trigger = On("odometry", max_gap=params.max_gap)
        if params.publish_tf:
            self.outputs = {**self.outputs, "estimate": replace(self.outputs["estimate"], transform=True)}
        self._period = params.period
        self._robot = make_robot(params.robot)
        self._tuning = make_filter(params.filter, make_noise(params.noise))
        self._filter = filter_of(self._tuning)
        self._credible, self._gate = Credible(self._robot, self._tuning, longest=params.max_gap), Gate()
        self._middle = choose("integrator", params.integrator, INTEGRATORS)
        if choose("twist", params.twist, {"executed": False, "commanded": True}):
            command = Input(topic="cmd_vel", type=Command, max_age=None, required=False, lock_step="refused")
            self.inputs = {**self.inputs, "command": command}
            self._executed = lambda odometry, command: limit(command or STOP, self._robot)
        if params.takes_fixes:
            self._filter = with_fixes(self._filter, REMEMBERED)
            fix = Input(topic="pose_fix", type=Fix, required=False, max_age=1.0, lock_step="newest", aged=True, reliable=False)
            self.inputs = {**self.inputs, "fix": fix}
        self.notice: str | None = None
        """Why the last message was refused, until the next one of its kind is accepted."""
        self.figures = {"refused odometry": 0, "refused fixes": 0, "refused initial poses": 0}
        """Number of messages that were refused, by kind."""
        self.reset()

    @staticmethod
    def _executed(odometry: Odometry, command: Command | None) -> Command:
        """Return the twist to predict with."""
        return odometry.twist

    def reset(self) -> None:
        """Restart with the next odometry."""
        self._estimate: Estimate | None = None
        self._senses = _SENSES(Odometry(Pose(0.0, 0.0, 0.0), STOP, False), no_fix())
        self._time = 0.0
        self._unused = 0.0
        self._last_fix: tuple[Fix, float] | None = None
        self._seat: tuple[Pose, Pose] | None = None  # the odometry and where the person said that the robot is, at one time
        self._credible.begin(None)
        self._gate.forget()
        self.notice = None

    def step(
        self,
        dt: float,
        odometry: Odometry,
        command: Command | None = None,
        fix: Aged | None = None,
        seat: Fix | None = None,
    ) -> dict[str, Any]:
        """Return the estimate after an odometry message that is ``dt`` later than the one before; nothing if it is refused."""
        self._time += dt
        tuning = self._take_seat(odometry, seat) if seat else self._tuning
        begins = self._estimate is None or dt <= 0.0  # the first message, or the first after a pause
        if begins:
            self._credible.begin(None)
            self._unused = 0.0
        if why := self._credible.refusal(odometry, dt):
            self._unused += dt
            self._refuse("odometry", why)
            return {}
        self._accept("odometry")
        dt, self._unused = dt + self._unused, 0.0
        now = odometry._replace(twist=self._executed(odometry, command))
        if self._seat:
            read, place = self._seat
            now = now._replace(pose=increment(place, read, now.pose, sincos(place.theta - read.theta)))
        senses = _SENSES(now, no_fix())
        after = self._filter.start(senses, tuning) if begins else self._advance(senses, dt)
        self._gate.remember(self._time, after.belief)
        if (new := self._new(fix)).arrived and not begins:
            senses = _SENSES(now, new)
            after = self._advance(senses, dt)
            self._gate.remember(self._time, after.belief)
        self._estimate, self._senses = after, senses
        return {"nis": Nis(after.nis), "estimate": after}

    def _advance(self, senses: Any, dt: float) -> Any:
        """Return the estimate ``dt`` after the last one, s, by what the sensors say then."""
        estimate, before = self._estimate, self._senses
        nothing = _SENSES(Odometry(before.odometry.pose, senses.odometry.twist, False), no_fix())
        n = max(1, round(dt / self._period))
        share = round(dt / n, 9)  # stamps are whole nanoseconds, so 0.3 s is exactly three times 0.1 s
        for _ in range(n - 1):
            estimate = self._filter.step(estimate, before, nothing, self._tuning, share, self._middle)
        return self._filter.step(estimate, before, senses, self._tuning, share, self._middle)

    def _take_seat(self, odometry: Odometry, seat: Fix) -> FilterTuning:
        """Start anew where a person says that the robot is, if it stands; return the tuning to start with."""
        v, omega = odometry.twist
        if abs(v) > STANDS.v or abs(omega) > STANDS.omega or not odometry.measured:
            self._refuse("initial poses", f"the robot must stand, but drives with {v:g} m/s and {omega:g} rad/s")
        elif seat.R[2] == math.inf:
            self._refuse("initial poses", "it has no heading")
        elif why := Gate().refusal(seat, self._time):
            self._refuse("initial poses", why)
        else:
            time = self._time
            self.reset()
            self._time, self._seat = time, (odometry.pose, seat.pose)
            return replace(self._tuning, R=bounded(seat).R, from_origin=False)
        return self._tuning

    def _new(self, fix: Aged | None) -> Fix:
        """Return a fix with its age, if it is new, recent enough and credible."""
        if fix is None:
            return no_fix()
        stamp = self._time - fix.age
        last, self._last_fix = self._last_fix, (fix.value, stamp)
        if last is not None and last[0] == fix.value and abs(last[1] - stamp) < 1e-6:
            return no_fix()
        if fix.age < -self._period:
            why = f"stamped {-fix.age:.2f} s in the future: are the clocks synchronized (NTP)?"
        elif fix.age > MAX_FIX_AGE + 1e-6:
            why = f"{fix.age:.2f} s old: steps are stored for {MAX_FIX_AGE} s"
        else:
            why = self._gate.refusal(bounded(fix.value), stamp)
        if why:
            self._refuse("fixes", why)
            return no_fix()
        self._accept("fixes")
        return bounded(fix.value)._replace(age=max(fix.age, 0.0))

    def _refuse(self, kind: str, why: str) -> None:
        """Count a refused message, and report it."""
        self.figures[f"refused {kind}"] += 1
        self.notice = f"{kind} refused: {why}"

    def _accept(self, kind: str) -> None:
        """End the report on refused messages of a kind."""
        if self.notice and self.notice.startswith(kind):
            self.notice = None

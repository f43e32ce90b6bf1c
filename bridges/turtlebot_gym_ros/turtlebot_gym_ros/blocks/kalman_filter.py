"""The estimator: the environment's own filter, triggered by odometry."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Annotated, Any

from turtlebot_gym.config import Range, check_fields, choose
from turtlebot_gym.estimation.agreement import Agreement
from turtlebot_gym.estimation.ekf import Estimate
from turtlebot_gym.estimation.filters import filter_of
from turtlebot_gym.estimation.fixes import NO_FIX, with_fixes
from turtlebot_gym.models.angles import sincos
from turtlebot_gym.models.odometry import increment
from turtlebot_gym.models.unicycle import INTEGRATORS, limit
from turtlebot_gym.parameters import MAX_FIX_AGE, FilterTuning
from turtlebot_gym.presets import make_filter, make_noise, make_robot
from turtlebot_gym.values import ORIGIN, STOP, Command, Fix, Odometry, Pose, senses_of
from turtlebot_gym_ros.blocks.credible import DISAGREEMENT, Credibility, Gate, bounded
from turtlebot_gym_ros.node.block import COMMANDED, INITIAL_POSE, RESUME, TF, Input, Nis, On, Output, Resume, Stamped, Transform

REMEMBERED = round(MAX_FIX_AGE / 0.01)
"""Number of steps stored for late fixes: half a second of odometry at 100 Hz, longer at lower rates."""
EULER = INTEGRATORS["euler"]
"""The rule by which the environments move by default, too."""
STANDS = Command(0.01, 0.05)
"""Twist up to which the odometry of a robot says that it stands; m/s, rad/s."""
UNSEEN = 0.15
"""Standard deviation that is added to what the filter knew of position and heading when a person lets it go on, m and rad: the
robot took that way to stand."""
FIX = Input(topic="pose_fix", type=Fix, required=False, max_age=1.0, lock_step="newest", aged=True, reliable=False)
_SENSES = senses_of(("odometry", "fix"))


class KalmanFilter:
    """Estimate the pose from odometry.

    It begins with the first odometry, and predicts with the twist that the wheels executed: the exact one from the simulator,
    the measured one, with its noise, on a robot. If a pose drops out, or messages are lost, it only predicts, and it restarts
    after ``max_gap``. Nothing is published without odometry. With ``takes_fixes`` it also uses external pose measurements, each
    at its own stamp, up to 0.5 s late.

    Odometry that contradicts itself or the command in force (`agreement`), and fixes that the belief rules out (`credible`),
    are refused: counted, reported, and not used. A contradiction that lasts is final: the cause is published on
    ``disagreement``, at which controllers stop, and no estimate follows until a person lets the robot go on. Enabling a
    controller does (``resume``): the filter then goes on from where it believed the robot. A pose on ``initialpose``, as RViz
    sends it, puts a standing robot elsewhere.

    Inputs: ``odometry`` (`Odometry`, on ``odom``), ``command`` (`Command`, on ``cmd_vel``), with ``takes_fixes`` ``fix``
    (`Fix`, on ``pose_fix``), ``initial_pose`` (`InitialPose`, on ``initialpose``), ``resume`` (`Resume`, on ``resume``); all
    but the first optional. Outputs, at odometry's stamp and in its frame: ``nis`` (`Nis`, on ``nis``), ``estimate``
    (`Estimate`, on ``estimate``), and ``disagreement`` (`Disagreement`, on ``disagreement``, when it changes).
    """

    @dataclass(frozen=True, slots=True, kw_only=True)
    class Params:
        """Parameters of the filter."""

        robot: str = "burger"
        """A name in `turtlebot_gym.robots.ROBOTS`, or a FILE.yaml."""
        noise: str = "tutorial"
        """Noise to which it is matched: a name in `turtlebot_gym.presets.NOISES`, or a FILE.yaml."""
        filter: str = "matched"
        """A name in `turtlebot_gym.presets.FILTERS`, a FILE.yaml with Q and R, or your MODULE:NAME. The names are matched,
        calibrated, tutorial and gated; NAME is a filter of your own, or an object of filterpy."""
        twist: str = "executed"
        """Twist of the prediction: "executed", in ``/odom``, or "commanded", the last ``/cmd_vel``. The second is for odometry
        without a twist; not in lock-step. Commands are not tied to steps: on a busy machine the filter used another one than
        the robot in 109 of 402 steps, and its error rose from 0.038 m to as much as 0.113 m. Then odometry that stands still
        0.5 s after a command to move is refused, but a jump is not noticed."""
        takes_fixes: bool = False
        """Whether to use external pose measurements on ``pose_fix`` too, with their variances. They are in the filter's frame,
        such as localization in a map or motion capture; a heading with a negative variance is ignored."""
        period: Annotated[float, Range(0.0, 60.0, open_low=True, unit="s")] = 0.1
        """Longest interval predicted in one step, s."""
        max_gap: Annotated[float, Range(0.0, 60.0, open_low=True, open_high=True, unit="s")] = 1.0
        """Gap in the odometry after which the filter restarts, s."""
        publish_tf: bool = False
        """Whether to publish the estimate on ``/tf`` too, if the robot's bring-up does not. The transform from the world frame
        to the robot's must have one owner. Needs a ROS installation."""

        def __post_init__(self) -> None:
            check_fields(self, "")
            if self.period > self.max_gap:
                raise ValueError(f"period must be at most max_gap, {self.max_gap!r} s, got {self.period!r}.")

    inputs = {
        "odometry": Input(topic="odom", type=Odometry, reliable=False, sole=True),
        "command": COMMANDED,
        "initial_pose": INITIAL_POSE,
        "resume": RESUME,
    }
    outputs = {
        "nis": Output(topic="nis", type=Nis),
        "estimate": Output(topic="estimate", type=Estimate),
        "disagreement": DISAGREEMENT,
    }
    trigger = On("odometry")

    def __init__(self, params: Params) -> None:
        self.trigger = replace(self.trigger, max_gap=params.max_gap)
        if params.publish_tf:
            self.outputs = {**self.outputs, "tf": TF}
        self._period = params.period
        self._robot = make_robot(params.robot)
        noise = make_noise(params.noise)
        self._tuning = make_filter(params.filter, noise)
        self._filter = filter_of(self._tuning)
        self._by_command = choose("twist", params.twist, {"executed": False, "commanded": True})
        self._agreement = Agreement(self._robot, noise, leaps=self._by_command)  # a robot follows its command late
        self._gate, self._verdict = Gate(), Credibility()
        if self._by_command:
            self.inputs = {**self.inputs, "command": replace(COMMANDED, lock_step="refused")}
        if params.takes_fixes:
            self._filter = with_fixes(self._filter, REMEMBERED)
            self.inputs = {**self.inputs, "fix": FIX}
        self.notice: str | None = None
        """Why the last message was refused, until the next one of its kind is accepted."""
        self.figures: dict[str, Any] = {"refused odometry": 0, "refused fixes": 0, "refused initial poses": 0}
        """Number of messages that were refused, by kind."""
        self.reset()

    def reset(self) -> None:
        """Restart with the next odometry, wherever it is."""
        self._seat: tuple[Pose, Pose] | None = None  # the odometry and where the robot was at that time
        self._agreement.begin()
        self._restart()
        self.notice = None

    @property
    def fault(self) -> str | None:
        """Why odometry is not believed any more, until a person lets the filter go on."""
        return self._verdict.fault

    def _restart(self) -> None:
        self._estimate: Estimate | None = None
        self._senses = _SENSES(Odometry(ORIGIN, STOP, False), NO_FIX)
        self._time = self._unused = 0.0
        self._last_fix: tuple[Fix, float] | None = None
        self._gate.forget()

    def pause(self) -> None:
        """Restart with the next odometry, which must be about where it was: nobody knows how long it has paused."""
        if not self._agreement.cause:
            self._agreement.pause()
            self._restart()

    def step(
        self,
        dt: float,
        odometry: Odometry,
        command: Command | None = None,
        fix: Stamped | None = None,
        initial_pose: Fix | None = None,
        resume: Resume | None = None,
    ) -> dict[str, Any]:
        """Return the estimate after an odometry message that is ``dt`` later than the one before; none if it is refused."""
        if self._estimate is not None and dt <= 0.0:
            self.pause()
        self._time += dt
        tuning = self._take_seat(odometry, initial_pose) if initial_pose else self._tuning
        if self._agreement.cause and resume is not None:
            tuning = self._go_on(odometry)
        begins = self._estimate is None
        twist = limit(command or STOP, self._robot) if self._by_command else odometry.twist
        judged = Odometry(odometry.pose, twist, odometry.measured) if self._by_command else odometry
        if why := self._agreement.judge(max(dt, 0.0), judged, command):
            self._unused += dt
            self._refuse("odometry", why)
            return self._verdict.news(self._agreement.cause)
        self._accept("odometry")
        dt, self._unused = dt + self._unused, 0.0
        now = odometry._replace(twist=twist)
        if self._seat:
            read, place = self._seat
            now = now._replace(pose=increment(place, read, now.pose, sincos(place.theta - read.theta)))
        senses = _SENSES(now, NO_FIX)
        after = self._filter.start(senses, tuning) if begins else self._advance(senses, dt)
        self._gate.remember(self._time, after.belief)
        if (new := self._new(fix)).arrived and not begins:
            senses = _SENSES(now, new)
            after = self._advance(senses, dt)
            self._gate.remember(self._time, after.belief)
        self._estimate, self._senses = after, senses
        values = {"nis": Nis(after.nis), "estimate": after} | self._verdict.news(self._agreement.cause)
        return values | ({"tf": Transform(Pose(*after.belief.mean[:3]))} if "tf" in self.outputs else {})

    def _advance(self, senses: Any, dt: float) -> Any:
        """Return the estimate ``dt`` after the last one, s, by what the sensors say then."""
        estimate, before = self._estimate, self._senses
        nothing = _SENSES(Odometry(before.odometry.pose, senses.odometry.twist, False), NO_FIX)
        n = max(1, round(dt / self._period))
        share = round(dt / n, 9)  # stamps are whole nanoseconds, so 0.3 s is exactly three times 0.1 s
        for _ in range(n - 1):
            estimate = self._filter.step(estimate, before, nothing, self._tuning, share, EULER)
        return self._filter.step(estimate, before, senses, self._tuning, share, EULER)

    def _take_seat(self, odometry: Odometry, initial_pose: Fix) -> FilterTuning:
        """Start anew where a person says that the robot is, if it stands; return the tuning to start with."""
        why = Gate().refusal(initial_pose, self._time)
        v, omega = odometry.twist
        if not (odometry.measured and abs(v) <= STANDS.v and abs(omega) <= STANDS.omega):
            why = f"the robot must stand, but drives with {v:g} m/s and {omega:g} rad/s"
        elif initial_pose.R[2] == math.inf:
            why = "it has no heading"
        if not why:
            return self._place(odometry, initial_pose)
        self._refuse("initial poses", why)
        return self._tuning

    def _place(self, odometry: Odometry, place: Fix) -> FilterTuning:
        """Start anew from a pose, and read odometry from there; return the tuning to start with."""
        time = self._time
        self.reset()
        self._time, self._seat = time, (odometry.pose, place.pose)
        return replace(self._tuning, R=bounded(place).R, from_origin=False)

    def _go_on(self, odometry: Odometry) -> FilterTuning:
        """Start anew from where the robot was believed to be when its odometry began to contradict itself."""
        if self._estimate is None:  # odometry has contradicted itself since its first message
            self.reset()
            return self._tuning
        mean, P = self._estimate.belief
        variances = P.xx + UNSEEN**2, P.yy + UNSEEN**2, P.tt + UNSEEN**2
        return self._place(odometry, Fix(Pose(*mean[:3]), variances, 0.0, True))

    def _new(self, fix: Stamped | None) -> Fix:
        """Return a fix with its age, if it is new, recent enough and credible."""
        if fix is None:
            return NO_FIX
        stamp = self._time - fix.age
        last, self._last_fix = self._last_fix, (fix.value, stamp)
        if last is not None and last[0] == fix.value and abs(last[1] - stamp) < 1e-6:
            return NO_FIX
        if fix.age < -self._period:
            why = f"stamped {-fix.age:.2f} s in the future: are the clocks synchronized (NTP)?"
        elif fix.age > MAX_FIX_AGE + 1e-6:
            why = f"{fix.age:.2f} s old: steps are stored for {MAX_FIX_AGE} s"
        else:
            why = self._gate.refusal(bounded(fix.value), stamp)
        if why:
            self._refuse("fixes", why)
            return NO_FIX
        self._accept("fixes")
        return bounded(fix.value)._replace(age=max(fix.age, 0.0))

    def _refuse(self, kind: str, why: str) -> None:
        self.figures[f"refused {kind}"] += 1
        self.notice = f"{kind} refused: {why}"

    def _accept(self, kind: str) -> None:
        if self.notice and self.notice.startswith(kind):
            self.notice = None

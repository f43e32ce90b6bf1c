"""Stated uncertainty of a simulated odometry, as from a well-calibrated driver."""

from __future__ import annotations

from turtlebot_gym.estimation.ekf import Estimate
from turtlebot_gym.estimation.filters import filter_of
from turtlebot_gym.models.unicycle import execution_variances
from turtlebot_gym.parameters import REFERENCE_PERIOD, DeadReckoning, Noise
from turtlebot_gym.presets import matched
from turtlebot_gym.values import Covariance, Odometry, Senses


class OdometryUncertainty:
    """The covariance of pose and twist in ``/odom``, from the noise model.

    A measured pose has the variances of its noise, spikes and quantization; a bias is in no covariance. The error of integrated
    wheels starts at zero and grows with the drift of the noise model, with correlated axes. The twist is that of the wheels,
    and its variance is that of the robot's execution. Nothing is certain: the floors are those of `presets.matched`.

    Args:
        noise: The true noise.
        dt: Control interval, s.
        integrator: The integrator, a value of `models.unicycle.Integrator`.
    """

    def __init__(self, noise: Noise, *, dt: float, integrator: float) -> None:
        self._tuning = matched(noise)
        self._dt, self._integrator = dt, integrator
        self._filter = filter_of(self._tuning)
        self.reset()

    def reset(self) -> None:
        """Restart with the next measurement."""
        self._before: Senses | None = None
        self._estimate: Estimate | None = None

    def hear(self, odometry: Odometry) -> None:
        """Take the odometry after a control interval, or at the start."""
        senses = Senses(odometry)
        if isinstance(self._tuning.kind, DeadReckoning):
            self._estimate = (
                self._filter.start(senses, self._tuning)
                if self._estimate is None or self._before is None
                else self._filter.step(self._estimate, self._before, senses, self._tuning, self._dt, self._integrator)
            )
        self._before = senses

    def covariance(self) -> Covariance:
        """Return the covariance of the last measurement; m, rad, m/s and rad/s."""
        assert self._before is not None
        R, Q, share = self._tuning.R, self._tuning.Q, self._dt / REFERENCE_PERIOD
        var_v, var_omega = execution_variances(self._before.odometry.twist, self._tuning.process, self._dt)
        vv, ww = max(var_v, Q[3] * share), max(var_omega, Q[4] * share)
        if self._estimate is not None:
            return self._estimate.belief.covariance._replace(vv=vv, ww=ww)
        return Covariance(R[0], 0.0, 0.0, R[1], 0.0, R[2], vv, ww)

"""Filters as textbooks have them: matrices in NumPy, which share no code with the package."""

import math

import numpy as np

from turtlebot_gym.estimation.ekf import Estimate
from turtlebot_gym.estimation.filters import covariance_of
from turtlebot_gym.parameters import Tutorial
from turtlebot_gym.values import Belief, State

MIDDLE = {"euler": 0.0, "midpoint": 0.5}


def difference(angle):
    """Return the angle in (-pi, pi]."""
    return math.atan2(math.sin(angle), math.cos(angle))


def off(x, other):
    """Return the difference of two states, with the heading's on the circle."""
    apart = np.array(x) - other
    apart[2] = difference(apart[2])
    return apart


def believing(kalman_filter, x, P):
    """Give a filter the belief with a mean of five numbers and a covariance of 5 x 5; return the filter."""
    kalman_filter.estimate = Estimate(Belief(State(*map(float, x)), covariance_of(np.asarray(P, float))), 0.0, 0.0)
    return kalman_filter


class Textbook:
    """``x = f(x, u), P = F P F' + Q; K = P H' S^-1, x += K nu, P = (I - K H) P (I - K H)' + K R K'``.

    A sixth state, a constant, may follow the pose and the twist.
    """

    def __init__(self, x, P, tuning, dt=0.1, integrator="euler"):
        self.x, self.P, self.tuning, self.dt = np.array(x, float), np.array(P, float), tuning, dt
        self.middle = MIDDLE[integrator]

    def predict(self, command):
        x, y, theta, v, omega, *sixth = self.x
        n, dt, t = len(self.x), self.dt, self.tuning
        along = theta + self.middle * omega * dt
        moved = [x + v * math.cos(along) * dt, y + v * math.sin(along) * dt, difference(theta + omega * dt)]
        self.x = np.array([*moved, *command, *sixth])
        F = np.eye(n)
        F[0, 2:5] = -v * math.sin(along) * dt, math.cos(along) * dt, -v * math.sin(along) * self.middle * dt**2
        F[1, 2:5] = v * math.cos(along) * dt, math.sin(along) * dt, v * math.cos(along) * self.middle * dt**2
        F[2, 4] = dt
        F[3, 3] = F[4, 4] = float(isinstance(t.kind, Tutorial))
        v2, omega2, p = command[0] ** 2, command[1] ** 2, t.process
        Q = np.zeros(n)
        Q[:5] = np.array(t.Q) * dt / 0.1
        Q[3] = max(Q[3], (p.alpha1 * v2 + p.alpha2 * omega2) * 0.1 / dt)
        Q[4] = max(Q[4], (p.alpha3 * v2 + p.alpha4 * omega2) * 0.1 / dt)
        self.P = F @ self.P @ F.T + np.diag(Q)

    def update(self, z, R=None, H=None):
        """Correct by a pose, or a position if the heading's variance is infinite; or by what `H` projects on.

        R has the variances, and perhaps the covariances of x and y, x and heading, y and heading.
        """
        R = np.array(self.tuning.R if R is None else R)
        variances, known = R[: len(z)], np.isfinite(R[: len(z)])
        matrix = np.diag(variances)
        if len(R) == 6:
            matrix[[0, 0, 1], [1, 2, 2]] = matrix[[1, 2, 2], [0, 0, 1]] = R[3:]
        z, R = np.array(z)[known], matrix[np.ix_(known, known)]
        H = np.eye(len(z), len(self.x)) if H is None else H
        nu = z - H @ self.x
        if len(nu) == 3 and not isinstance(self.tuning.kind, Tutorial):
            nu[2] = difference(nu[2])
        S = H @ self.P @ H.T + R
        K = self.P @ H.T @ np.linalg.inv(S)
        rest = np.eye(len(self.x)) - K @ H
        self.x = self.x + K @ nu
        self.x[2] = difference(self.x[2])
        self.P = rest @ self.P @ rest.T + K @ R @ K.T
        self.nu, self.S, self.nis = nu, S, nu @ np.linalg.solve(S, nu)

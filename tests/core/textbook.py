"""Filters as textbooks have them: matrices in NumPy and mixtures of Gaussians, which share no code with the package."""

import math
from copy import copy

import numpy as np
from scipy.stats import multivariate_normal

MIDDLE = {"euler": 0.0, "midpoint": 0.5}


def difference(angle):
    """Return the angle in (-pi, pi]."""
    return math.atan2(math.sin(angle), math.cos(angle))


def off(x, other):
    """Return the difference of two states, with the heading's on the circle."""
    apart = np.array(x) - other
    apart[2] = difference(apart[2])
    return apart


class Textbook:
    """``x = f(x, u), P = F P F' + Q; K = P H' S^-1, x += K nu, P = (I - K H) P (I - K H)' + K R K'``.

    A sixth state may follow the pose and the twist: the executed share of a command if it ``scales``, or else a constant.
    """

    def __init__(self, x, P, tuning, dt=0.1, integrator="euler", scales=False):
        self.x, self.P, self.tuning, self.dt = np.array(x, float), np.array(P, float), tuning, dt
        self.middle, self.scales, self.weight = MIDDLE[integrator], scales, 1.0

    def predict(self, command):
        x, y, theta, v, omega, *sixth = self.x
        n, dt, t = len(self.x), self.dt, self.tuning
        along = theta + self.middle * omega * dt
        share = sixth[0] if self.scales else 1.0
        moved = [x + v * math.cos(along) * dt, y + v * math.sin(along) * dt, difference(theta + omega * dt)]
        self.x = np.array([*moved, share * command[0], share * command[1], *sixth])
        F = np.eye(n)
        F[0, 2:5] = -v * math.sin(along) * dt, math.cos(along) * dt, -v * math.sin(along) * self.middle * dt**2
        F[1, 2:5] = v * math.cos(along) * dt, math.sin(along) * dt, v * math.cos(along) * self.middle * dt**2
        F[2, 4] = dt
        F[3, 3] = F[4, 4] = float(getattr(t.kind, "remember_velocity", False))
        if self.scales:
            F[3:5, 5] = command
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
        if len(nu) == 3 and getattr(self.tuning.kind, "wrap_innovation", True):
            nu[2] = difference(nu[2])
        S = H @ self.P @ H.T + R
        K = self.P @ H.T @ np.linalg.inv(S)
        rest = np.eye(len(self.x)) - K @ H
        self.x = self.x + K @ nu
        self.x[2] = difference(self.x[2])
        self.P = rest @ self.P @ rest.T + K @ R @ K.T
        self.nu, self.S, self.nis = nu, S, nu @ np.linalg.solve(S, nu)
        self.likelihood = multivariate_normal.pdf(nu, np.zeros(len(nu)), S)


def weighed(parts, weights):
    """Return the Gaussian with the moments of a mixture whose headings lie near each other, with its total weight."""
    merged, total = copy(parts[0]), sum(weights)
    if total > 0.0:
        aside = [off(part.x, merged.x) for part in parts]
        mean = sum(weight / total * away for weight, away in zip(weights, aside, strict=True))
        merged.P = sum(
            weight / total * (part.P + np.outer(away - mean, away - mean))
            for weight, part, away in zip(weights, parts, aside, strict=True)
        )
        merged.x = merged.x + mean
        merged.x[2] = difference(merged.x[2])
    merged.weight = total
    return merged


class Mixture:
    """Hypotheses, of which each explains a measured heading as right, too great or too small.

    Each stands for the first heading's explanation and, if ``modes`` are given, for whether the robot grips or slips.
    """

    def __init__(self, z, tuning, modes=None):
        kind = tuning.kind
        self.half, self.modes, self.nis = 0.5 * kind.spike_probability, modes, 0.0
        self.shares = {0.0: 1.0 - kind.spike_probability, kind.spike: self.half, -kind.spike: self.half}
        self.hypotheses = {}
        for offset, share in self.shares.items():
            for mode in modes or [False]:
                part = Textbook([z[0], z[1], z[2] - offset, 0.0, 0.0], np.diag([*tuning.R, 0.0, 0.0]), tuning)
                part.weight = 0.0 if mode else share
                self.hypotheses[offset, mode] = part

    def step(self, command, z):
        for part in self.hypotheses.values():
            part.predict(command)
        if z is not None:
            self._weigh(z)
        if self.modes:  # probabilities of each mode after gripping and after slipping, and the executed share in it
            self.hypotheses = {
                (offset, mode): self._mixed(offset, chances, share, command)
                for offset in self.shares
                for mode, (chances, share) in self.modes.items()
            }

    def _weigh(self, z):
        likely, surprise = {}, 0.0
        for key, part in self.hypotheses.items():
            parts, weights = [], []
            for offset, share in self.shares.items():
                explained = copy(part)
                explained.update([z[0], z[1], part.x[2] + difference(z[2] - part.x[2]) - offset])
                parts, weights = [*parts, explained], [*weights, part.weight * share * explained.likelihood]
                surprise += weights[-1] * explained.nis
            likely[key] = weighed(parts, weights)
        total = sum(part.weight for part in likely.values())
        for part in likely.values():
            part.weight /= total
        self.hypotheses, self.nis = likely, surprise / total

    def _mixed(self, offset, chances, share, command):
        before = [self.hypotheses[offset, mode] for mode in (False, True)]
        part = weighed(before, [chance * hypothesis.weight for chance, hypothesis in zip(chances, before, strict=True)])
        part.x[3:] = share * np.array(command)
        return part

    def belief(self):
        parts = list(self.hypotheses.values())
        return weighed(parts, [part.weight for part in parts])

"""Regression of the true motion on the recorded twist: wheels, marker and noise of a drive whose truth is recorded.

From row to row the truth moves ahead, aside and turns. All three are linear in the wheels' and the marker's parameters, and in
the noise of the execution and of the truth, with the *measured* heading as the direction ahead: so nothing of second order
counts as evidence, with either integrator. Noise of the truth enters two motions in a row, with opposite signs. The covariance
is therefore banded, and its Cholesky factor takes time proportional to the number of rows.

Variances maximize the restricted likelihood, which counts the fitted linear parameters; those follow by generalized least
squares.

References:
    Patterson, Thompson, "Recovery of inter-block information when block sizes are unequal", *Biometrika* 58 (1971).
    Huber, "Robust estimation of a location parameter", *Annals of Mathematical Statistics* 35 (1964).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from turtlebot_gym.compiled.cache import in_machine_code
from turtlebot_gym.parameters import REFERENCE_PERIOD
from turtlebot_gym_lab.calibration.motions import Array, Motions

LINEAR = ("scale", "turn_scale", "veer", "drift", "marker_x", "marker_y", "marker_theta")
"""Parameters of the mean motion."""
USUAL = np.array([1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
"""Their values for wheels as assumed, and a truth of the middle of the axle."""
FREE = np.array([0.3, 0.5, 0.5, 0.1, 0.3, 0.3, 1.0]) ** -2.0
"""Inverse variances of a prior so wide that it counts only where a drive says nothing ..."""
WHEELS_ONLY = np.where([True, True, True, False, False, False, True], FREE, 1e12)
"""... and of one by which the twist has no drift, and the truth is that of the middle of the axle."""
VARIANCES = ("alpha1", "alpha2", "alpha3", "alpha4", "truth_position", "truth_heading")
"""Parameters of the covariance; of the truth as standard deviations, m and rad."""

RESOLUTION = 1e-6
"""Standard deviation of each number of a truth with noise, m and rad: the last digit that files have."""
EXACT = 1e-5
"""Deviation to the side below which a truth is exact, m; motion capture is worse. It then is each number's deviation ..."""
FINEST = 1e-8
"""... down to this one, for which the regression can be solved, m."""
JUMP = 8.0
"""Standard deviations beyond which an error is a jump and not noise."""
HUBER = 1.345
"""Standard deviations beyond which an error counts by its size instead of its square."""
ROUNDS = 4
"""Most rounds in which jumps are looked for."""
MOST = 0.1
"""Share of jumps above which none is left out: so many are the noise itself."""
TURNED = 0.2
"""Largest correction of the marker's direction for which the regression counts as linear, rad."""
LEAST = 1e-5
"""Least first value of an alpha."""
_MEDIAN = 0.6745
"""Median size of a standard normal number."""


class _Model(NamedTuple):
    """The regression of n motions, linear at a guess: 3 n numbers, each motion's ahead, aside and turn."""

    y: Array
    """Shape (3 n,)."""
    X: Array
    """Shape (3 n, 7), for the coefficients of `_coefficients`."""
    parts: Array
    """Covariance for a variance of 1 of each of `VARIANCES`, as lower bands, shape (6, 3 n, 6)."""
    resolution: float
    """Standard deviation that each number has in any case, m and rad."""

    def rest(self, guess: Array) -> Array:
        """Return what parameters leave unexplained, shape (n, 3)."""
        return (self.y - self.X @ _coefficients(guess)).reshape(-1, 3)


def _coefficients(linear: Array) -> Array:
    """Return what the mean is linear in: speed, turn, turn by speed, and the rest; the marker's direction from the guess."""
    scale, turn_scale, veer, drift, x, y, _ = linear
    return np.array([scale, scale * turn_scale, scale * veer, drift, x, y, 0.0])


def _parameters(coefficients: Array, guess: Array) -> Array:
    """Return the parameters of `LINEAR` with some `_coefficients`, whose last one is the change of the marker's direction."""
    speed, turn, by_speed, drift, x, y, direction = coefficients
    return np.array([speed, turn / speed, by_speed / speed, drift, x, y, guess[6] + direction])


def _model(motions: Motions, guess: Array, integrator: float) -> _Model:
    """Return the regression, linear at a guess of `LINEAR`."""
    n, dt, (v, omega), turn = len(motions.dt), motions.dt, motions.twist.T, motions.step[:, 2]
    scale, turn_scale, _, _, forward, left, direction = guess
    ahead_of = motions.heading + integrator * turn - direction
    sine, cosine = np.sin(ahead_of), np.cos(ahead_of)
    ahead = cosine * motions.step[:, 0] + sine * motions.step[:, 1]
    aside = -sine * motions.step[:, 0] + cosine * motions.step[:, 1]
    # Headings of the robot at both ends, from the direction ahead.
    last, first = (1.0 - integrator) * turn, -integrator * turn
    along, across = np.cos(last) - np.cos(first), np.sin(last) - np.sin(first)

    y, X = np.stack([ahead, aside, turn], axis=1), np.zeros((n, 3, 7))
    X[:, 0, 0], X[:, 0, 4], X[:, 0, 5] = v * dt, along, -across
    X[:, 1, 4], X[:, 1, 5], X[:, 1, 6] = across, along, -scale * v * dt
    X[:, 2, 1], X[:, 2, 2], X[:, 2, 3] = omega * dt, v * dt, -dt

    # Effect of the truth's errors at the end of a motion; at its start it is the opposite, except for the heading.
    ends, starts = np.zeros((n, 3, 3)), np.zeros((n, 3, 3))
    ends[:, 0, 0], ends[:, 0, 1], ends[:, 1, 0], ends[:, 1, 1] = cosine, sine, -sine, cosine
    starts[:, :2, :2] = -ends[:, :2, :2]
    for effect, sign, share in ((ends, 1.0, integrator), (starts, -1.0, 1.0 - integrator)):
        d_last, d_first = sign * (1.0 - integrator), -sign * integrator
        d_along = -np.sin(last) * d_last + np.sin(first) * d_first
        d_across = np.cos(last) * d_last - np.cos(first) * d_first
        effect[:, 0, 2] = share * aside - forward * d_along + left * d_across
        effect[:, 1, 2] = -share * ahead - forward * d_across - left * d_along
        effect[:, 2, 2] = sign

    parts = np.zeros((6, n, 3, 6))
    per_variance = REFERENCE_PERIOD * dt
    parts[0, :, 0, 0], parts[1, :, 0, 0] = scale**2 * v**2 * per_variance, scale**2 * omega**2 * per_variance
    share = (scale * turn_scale) ** 2
    parts[2, :, 2, 0], parts[3, :, 2, 0] = share * v**2 * per_variance, share * omega**2 * per_variance
    following = np.flatnonzero(motions.follows)
    for at, columns in ((4, slice(0, 2)), (5, slice(2, 3))):
        A, B = starts[:, :, columns], ends[:, :, columns]
        covariances = A @ A.swapaxes(1, 2) + B @ B.swapaxes(1, 2)
        shared = A[following] @ B[following - 1].swapaxes(1, 2)
        for i in range(3):
            for j in range(3):
                if i >= j:
                    parts[at, :, j, i - j] = covariances[:, i, j]
                parts[at, following - 1, j, 3 + i - j] = shared[:, i, j]
    model = _Model(y.reshape(-1), X.reshape(-1, 7), parts.reshape(6, 3 * n, 6), RESOLUTION)
    side = float(_sizes(model.rest(guess))[1])
    return model._replace(resolution=max(side, FINEST)) if side < EXACT else model


class Regression(NamedTuple):
    """Generalized least squares for some variances."""

    linear: Array
    """The parameters of `LINEAR`, shape (7,)."""
    covariance: Array
    """Their covariance, shape (7, 7)."""
    residuals: Array
    """Whitened residuals, shape (n, 3): independent standard normal numbers if the model holds."""
    influence: Array
    """How far each motion moves the parameters, shape (n, 7)."""
    likelihood: float
    """Restricted log-likelihood, up to a constant."""


@in_machine_code("regression of drives")
def _whiten(bands: Any, white: Any) -> float:
    """Replace a covariance, in bands, by its Cholesky factor, whiten columns of numbers in place, and return the logarithm of
    the determinant; LAPACK's banded routines take ten times as long for so few bands."""
    rows, columns = white.shape
    width = bands.shape[1]
    determinant = 0.0
    for row in range(rows):
        if not bands[row, 0] > 0.0:
            return math.inf
        determinant += math.log(bands[row, 0])
        root = math.sqrt(bands[row, 0])
        for i in range(width):
            bands[row, i] /= root
        for column in range(columns):
            white[row, column] /= root
        for i in range(1, min(width, rows - row)):
            share = bands[row, i]
            if share != 0.0:
                for k in range(i, min(width, rows - row)):
                    bands[row + i, k - i] -= share * bands[row, k]
                for column in range(columns):
                    white[row + i, column] -= share * white[row, column]
    return determinant


class RegressionProblem(NamedTuple):
    """The regression of a drive with one integrator, without jumps; what remains is to fit the variances."""

    motions: Motions
    model: _Model
    guess: Array
    """The parameters of `LINEAR` at which it is linear, shape (7,)."""
    roots: Array
    """First values of the roots of `VARIANCES`: six, or four if the truth is exact."""
    jumps: NDArray[np.intp]
    """Rows that were left out because the truth, or the twist, jumped."""
    prior: Array
    """Inverse variances of the prior, `FREE` or `WHEELS_ONLY`."""

    @property
    def is_exact(self) -> bool:
        """Whether the truth is exact."""
        return len(self.roots) == 4

    def is_far(self) -> NDArray[np.bool_]:
        """Return at which motions an error is larger than noise can be, shape (n,)."""
        variances = np.tensordot(self.roots**2, self.model.parts[: len(self.roots), :, 0], axes=1) + RESOLUTION**2
        return np.asarray((self.model.rest(self.guess) ** 2 > JUMP**2 * variances.reshape(-1, 3)).any(axis=1))

    def solve(self, roots: Array) -> Regression:
        """Return the regression for some roots of `VARIANCES`."""
        z, W, information, coefficients, likelihood = self._solved(roots)
        speed, turn, by_speed = coefficients[:3]
        to_linear = np.eye(7)
        to_linear[1, :2] = -turn / speed**2, 1.0 / speed
        to_linear[2, 0], to_linear[2, 2] = -by_speed / speed**2, 1.0 / speed
        inverse = np.linalg.inv(information)
        covariance = to_linear @ inverse @ to_linear.T
        influence = (W * z[:, None]).reshape(-1, 3, 7).sum(axis=1) @ (to_linear @ inverse).T
        return Regression(_parameters(coefficients, self.guess), covariance, z.reshape(-1, 3), influence, likelihood)

    def likelihood(self, roots: Array) -> float:
        """Return the restricted log-likelihood of some roots of `VARIANCES`, as `solve` does, in less time."""
        return self._solved(roots)[-1]

    def _solved(self, roots: Array) -> tuple[Array, Array, Array, Array, float]:
        """Return whitened residuals and regressors, the information, the coefficients and the likelihood."""
        model, guess = self.model, self.guess
        bands = np.tensordot(roots**2, model.parts[: len(roots)], axes=1)
        bands[:, 0] += model.resolution**2
        white = np.column_stack([model.rest(guess).reshape(-1), model.X])
        determinant = _whiten(bands, white)
        if not math.isfinite(determinant):
            raise ValueError("the covariance is singular.")
        z, W = white[:, 0], white[:, 1:]
        information = W.T @ W + np.diag(self.prior)
        pull = W.T @ z + self.prior * (_coefficients(USUAL) - _coefficients(guess))
        change = np.linalg.solve(information, pull)
        z = z - W @ change
        likelihood = -0.5 * (determinant + np.linalg.slogdet(information)[1] + float(z @ z))
        return z, W, information, _coefficients(guess) + change, float(likelihood)


def problem_of(motions: Motions, integrator: float, *, rounds: int = ROUNDS, prior: Array = FREE) -> RegressionProblem:
    """Return the regression of motions.

    Args:
        motions: The motions.
        integrator: The integrator, a value of `models.unicycle.Integrator`.
        rounds: Most rounds in which jumps are looked for.
        prior: `FREE` or `WHEELS_ONLY`.
    """
    jumps = np.zeros(0, np.intp)
    while True:
        guess = _robust_guess(motions, integrator, prior)
        model = _model(motions, guess, integrator)
        problem = RegressionProblem(motions, model, guess, _first_roots(motions, guess, model.rest(guess)), jumps, prior)
        # Motion by motion: noise of the truth would make a jump look like a place that lasts.
        far = problem.is_far()
        if rounds == 0 or not far.any() or far.mean() > MOST:
            return problem
        jumps, motions, rounds = np.union1d(jumps, motions.row[far]), motions.without(far), rounds - 1


def relinearized(problem: RegressionProblem, guess: Array, integrator: float) -> RegressionProblem:
    """Return a problem linear at a better guess, with the same roots; far from the first guess there is none."""
    if abs(guess[6] - problem.guess[6]) > TURNED:
        return problem
    return problem._replace(guess=guess, model=_model(problem.motions, guess, integrator))


def _sizes(rest: Array) -> Array:
    """Return the standard deviation of each column by its median size, shape (3,)."""
    return np.median(np.abs(rest), axis=0) / _MEDIAN


def _robust_guess(motions: Motions, integrator: float, prior: Array) -> Array:
    """Return the parameters of `LINEAR` with large errors counted by their size."""
    guess = USUAL.copy()
    chord = (motions.step[:, 0] + 1j * motions.step[:, 1]) * np.exp(-1j * (motions.heading + integrator * motions.step[:, 2]))
    length = np.abs(chord)
    pull = (motions.twist[:, 0] * motions.dt * np.divide(chord, length, out=np.zeros_like(chord), where=length > 0.0)).sum()
    guess[6] = -math.atan2(pull.imag, pull.real) if abs(pull) > 0.0 else 0.0
    for _ in range(10):
        model = _model(motions, guess, integrator)
        residuals = model.rest(guess)
        sizes = np.maximum(_sizes(residuals), RESOLUTION)
        weights = (1.0 / np.maximum(1.0, np.abs(residuals / sizes) / HUBER) / sizes**2).reshape(-1)
        information = (model.X * weights[:, None]).T @ model.X + np.diag(prior)
        pull = model.X.T @ (weights * residuals.reshape(-1)) + prior * (_coefficients(USUAL) - _coefficients(guess))
        guess = _parameters(_coefficients(guess) + np.linalg.solve(information, pull), guess)
    return guess


def _first_roots(motions: Motions, guess: Array, residuals: Array) -> Array:
    """Return rough roots of `VARIANCES` from the residuals' moments; four if the truth is exact."""
    sizes = _sizes(residuals)
    residuals = np.clip(residuals, -6.0 * sizes, 6.0 * sizes)
    position = 0.5 * float(sizes[1]) ** 2
    is_exact = math.sqrt(position) < EXACT
    products = residuals[1:, 2] * residuals[:-1, 2] * motions.follows[1:]
    # An error of the truth ends one motion and begins the next.
    heading = 0.0 if is_exact else max(-float(products.sum()) / max(int(motions.follows[1:].sum()), 1), EXACT**2)
    squares = motions.twist**2 * (REFERENCE_PERIOD * motions.dt)[:, None]
    roots = []
    for at, known_variance, share in ((0, position, guess[0]), (2, heading, guess[0] * guess[1])):
        over = np.maximum(residuals[:, at] ** 2 - 2.0 * known_variance, -2.0 * known_variance)
        weight = 1.0 / (sizes[at] ** 2 + squares.sum(axis=1) * 1e-3 + RESOLUTION**2)
        alphas, _ = nnls(squares * (share**2 * weight)[:, None], over * weight)
        roots += np.sqrt(np.maximum(alphas, LEAST)).tolist()
    return np.array(roots if is_exact else [*roots, math.sqrt(position), math.sqrt(heading)])

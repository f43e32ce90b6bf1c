"""Drives whose measured poses spike as real sensors do, and a plain gated extended Kalman filter of filterpy as the peer."""

import math

import numpy as np
from filterpy.kalman import ExtendedKalmanFilter
from scipy import stats

from turtlebot_gym.estimation.filters import filter_of, matrix
from turtlebot_gym.models.unicycle import advance
from turtlebot_gym.values import Command, Odometry, Pose, Senses

DT, EULER = 0.1, 0.0
SPIKES = ("leap", "off", "flip")
"""2 % position leaps of .5 m; half a second 42 cm off, 1 % of the time begun; 2 % heading flips by pi."""


def _difference(angle):
    return (angle + math.pi) % (2.0 * math.pi) - math.pi


def spiky_drive(noise, spike, seed, steps=300):
    """Return twists (T, 2) that hold from each step on, true poses and measured poses (T, 3); the first is no spike."""
    rng, process, root = np.random.default_rng(seed), noise.process, np.sqrt(noise.odometry.R)
    pose, executed = Pose(*rng.uniform([-1.0, -1.0, -3.0], [1.0, 1.0, 3.0])), (0.0, 0.0)
    twists, truth, measured, ends, twist, offset = [], [], [], 0, np.zeros(2), np.zeros(2)
    for step in range(steps):
        if step % 10 == 0:
            twist = np.array([rng.uniform(0.05, 0.22), rng.uniform(-1.0, 1.0)])
        if step:
            pose = advance(pose, *executed, DT, EULER)
        v, omega = twist**2
        deviations = (
            math.sqrt(process.alpha1 * v + process.alpha2 * omega),
            math.sqrt(process.alpha3 * v + process.alpha4 * omega),
        )
        executed = tuple((twist + rng.normal(0.0, deviations)).tolist())
        z, draw, to = np.array(pose) + root * rng.normal(size=3), rng.random(), rng.uniform(-math.pi, math.pi)
        if step and spike == "leap" and draw < 0.02:
            z[:2] += 0.5 * math.cos(to), 0.5 * math.sin(to)
        elif step and spike == "flip" and draw < 0.02:
            z[2] += math.pi
        elif step and spike == "off":
            if step >= ends + 20 and draw < 0.02:  # two seconds apart at least
                ends, offset = step + 5, 0.42 * np.array([math.cos(to), math.sin(to)])
            z[:2] += offset if step < ends else 0.0
        z[2] = _difference(z[2])
        for record, value in ((twists, twist), (truth, pose), (measured, z)):
            record.append(value)
    return np.array(twists), np.array(truth), np.array(measured)


def by_filter(tuning, twists, measured):
    """Return means (T, 5) and covariances (T, 5, 5) of a filter of the package on a drive."""
    start, step, *_ = filter_of(tuning)
    before, estimate, beliefs = None, None, []
    for at, (twist, z) in enumerate(zip(twists.tolist(), measured.tolist(), strict=True)):
        senses = Senses(Odometry(Pose(*z), Command(*twist), True))
        estimate = step(estimate, before, senses, tuning, DT, EULER) if at else start(senses, tuning)
        before = senses
        beliefs.append(estimate.belief)
    return np.array([belief.mean for belief in beliefs]), np.array([matrix(belief.covariance) for belief in beliefs])


def by_peer(tuning, twists, measured, confidence=0.999):
    """Return the same of filterpy's extended Kalman filter, which refuses poses beyond a quantile of chi-square."""
    gate, peer = stats.chi2.ppf(confidence, 3), ExtendedKalmanFilter(dim_x=5, dim_z=3)
    peer.R, H = np.diag(tuning.R), np.eye(3, 5)
    peer.x, peer.P = np.array([*measured[0], 0.0, 0.0]), np.diag([*tuning.R, 0.0, 0.0])
    means, covariances = [peer.x], [peer.P]
    for twist, z in zip(twists[1:], measured[1:], strict=True):
        x, y, theta, v, omega = peer.x
        sine, cosine, p = math.sin(theta), math.cos(theta), tuning.process
        peer.F = np.diag([1.0, 1.0, 1.0, 0.0, 0.0])
        peer.F[:2, 2] = -v * sine * DT, v * cosine * DT
        peer.F[:2, 3], peer.F[2, 4] = (cosine * DT, sine * DT), DT
        peer.x = np.array([x + v * cosine * DT, y + v * sine * DT, _difference(theta + omega * DT), *twist])
        var = p.alpha1 * twist[0] ** 2 + p.alpha2 * twist[1] ** 2, p.alpha3 * twist[0] ** 2 + p.alpha4 * twist[1] ** 2
        peer.Q = np.diag([0.0, 0.0, 0.0, max(var[0], tuning.Q[3]), max(var[1], tuning.Q[4])])
        peer.P = peer.F @ peer.P @ peer.F.T + peer.Q
        nu = z - peer.x[:3]
        nu[2] = _difference(nu[2])
        if nu @ np.linalg.solve(peer.P[:3, :3] + peer.R, nu) <= gate:
            peer.update(peer.x[:3] + nu, lambda x: H, lambda x: x[:3])
            peer.x[2] = _difference(peer.x[2])
        means.append(peer.x.copy())
        covariances.append(peer.P.copy())
    return np.array(means), np.array(covariances)


def errors(truth, means, covariances, after=20):
    """Return mean squares of position and heading error, m^2 and rad^2, and mean NEES of the pose, from a step on."""
    off = means[after:, :3] - truth[after:]
    off[:, 2] = _difference(off[:, 2])
    nees = np.einsum("ti,tij,tj->t", off, np.linalg.inv(covariances[after:, :3, :3]), off)
    return (off[:, :2] ** 2).sum(axis=1).mean(), (off[:, 2] ** 2).mean(), nees.mean()

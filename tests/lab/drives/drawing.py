"""Drives whose noise is known, and drives as tables."""

import numpy as np

from turtlebot_gym.drive import Drive


def draw(
    rows=600,
    *,
    seed=5,
    dt=0.1,
    alphas=(0.004, 0.004, 0.004, 0.004),
    scale=1.0,
    deviations=(0.03, 0.04, 0.05),
    bias=(0.0, 0.0, 0.0),
):
    """Return a drive by the textbook's equations, written out: twists with noise, Euler steps, and poses with noise."""
    random = np.random.default_rng(seed)
    twist, truth = np.zeros((rows, 2)), np.zeros((rows, 3))
    v = omega = 0.0
    for k in range(1, rows):
        if k % 15 == 1:
            v, omega = ((0.2, 0.0), (0.0, random.choice((-0.8, 0.8))), (0.15, random.uniform(-0.5, 0.5)))[random.integers(3)]
        twist[k] = v, omega
        done_v = scale * (v + np.sqrt(alphas[0] * v**2 + alphas[1] * omega**2) * random.standard_normal())
        done_omega = scale * (omega + np.sqrt(alphas[2] * v**2 + alphas[3] * omega**2) * random.standard_normal())
        x, y, theta = truth[k - 1]
        truth[k] = x + done_v * np.cos(theta) * dt, y + done_v * np.sin(theta) * dt, theta + done_omega * dt
    odometry = truth + bias + deviations * random.standard_normal((rows, 3))
    return Drive(time=dt * np.arange(rows), twist=twist, odometry=wrapped(odometry), true_state=wrapped(truth))


def wrapped(poses):
    return np.column_stack([poses[:, :2], np.remainder(poses[:, 2] + np.pi, 2.0 * np.pi) - np.pi])


def columns_of(drive):
    """Return a drive as a table's columns by name."""
    columns = np.column_stack([drive.time, drive.twist, drive.odometry, drive.truth]).T.copy()
    return dict(zip(["t", "v", "omega", "x", "y", "theta", "true_x", "true_y", "true_theta"], columns, strict=True))


def write(path, columns, *, mark=","):
    """Write a table of columns by name; NaN as an empty cell."""
    rows = zip(*columns.values(), strict=True)
    lines = [mark.join(columns), *(mark.join("" if cell != cell else repr(float(cell)) for cell in row) for row in rows)]
    path.write_text("\n".join(lines) + "\n")
    return path

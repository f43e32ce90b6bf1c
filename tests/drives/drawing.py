"""Drives whose noise is known, drives as tables, and recorded ones."""

from pathlib import Path

import numpy as np
import pytest

from turtlebot_gym.drives import Drive, RoomData, Seen
from turtlebot_gym.rooms.scan import Scan
from turtlebot_gym.values import Pose

COLUMNS = ("true_state", "odometry", "estimate", "covariance", "reference", "command", "twist", "nis", "clearance", "level")


def recorded(name):
    """Return the path of a recording; without it, the test is skipped."""
    path = Path(__file__).parents[3] / "shared" / "data" / name
    if not path.exists():
        pytest.skip(f"NOT TESTED ON REAL DATA: the recorded drive {path} is missing")
    return path


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


def columns_of(drive, names="t v omega x y theta true_x true_y true_theta"):
    """Return a drive as a table's columns by name; the first nine quantities in their order."""
    columns = np.column_stack([drive.time, drive.twist, drive.odometry, drive.truth]).T.copy()
    return dict(zip(names.split(), columns, strict=False))


def write(path, columns, *, mark=","):
    """Write a table of columns by name; NaN as an empty cell."""
    rows = zip(*columns.values(), strict=True)
    lines = [mark.join(columns), *(mark.join("" if cell != cell else repr(float(cell)) for cell in row) for row in rows)]
    path.write_text("\n".join(lines) + "\n")
    return path


def random_drive(rows=8, *, seed=0):
    """Return a drive of random numbers, with a scan in every second row."""
    random = np.random.default_rng(seed)
    columns = {name: random.normal(size=getattr(Drive(time=np.arange(rows)), name).shape) for name in COLUMNS}
    columns["covariance"] = columns["covariance"] @ columns["covariance"].transpose(0, 2, 1)
    ranges = random.uniform(0.1, 3.0, (rows, 36)).astype(np.float32)
    return Drive(
        time=0.1 * np.arange(rows),
        **columns,
        report=tuple(f"report {k}" for k in range(rows)),
        circles=tuple(random.normal(size=(rows, 2, 3))),
        hypotheses=tuple(random.normal(size=(rows, 2, 4))),
        scans=tuple(
            Seen(row, Pose(*random.normal(size=3)), Scan(ranges[row], 0.0, 0.1745, 0.1, 3.5)) for row in range(0, rows, 2)
        ),
        around=RoomData("random"),
        outcome="the end",
    )

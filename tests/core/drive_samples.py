"""Drives for tests: of random numbers, and recorded ones."""

from pathlib import Path

import numpy as np
import pytest

from turtlebot_gym.drive import Drive, RoomData, Seen
from turtlebot_gym.rooms.scan import Scan
from turtlebot_gym.values import Pose

COLUMNS = (
    *("true_state", "odometry", "estimate", "covariance", "reference", "command", "twist"),
    *("nis", "clearance", "level", "tracks"),
)


def recorded(name):
    """Return the path of a recording; without it, the test is skipped."""
    path = Path(__file__).parents[3] / "shared" / "data" / name
    if not path.exists():
        pytest.skip(f"NOT TESTED ON REAL DATA: the recorded drive {path} is missing")
    return path


def random_drive(rows=8):
    """Return a drive of random numbers, with a scan in every second row."""
    random = np.random.default_rng(0)
    columns = {name: random.normal(size=getattr(Drive(time=np.arange(rows)), name).shape) for name in COLUMNS}
    columns["covariance"] = columns["covariance"] @ columns["covariance"].transpose(0, 2, 1)
    columns["tracks"][..., -1] = random.choice((0.0, 0.5, 1.0), (rows, 5))
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

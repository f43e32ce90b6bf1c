"""A recorded drive for the tests of the lab."""

from pathlib import Path

import numpy as np
import pytest


@pytest.fixture
def drive(tmp_path) -> Path:
    """A recorded drive straight on, whose wheels overstate the way by 2 %."""
    time = np.linspace(0.0, 20.0, 1001)
    rows = np.stack([time, np.full_like(time, 0.204), 0.0 * time, 0.2 * time, 0.0 * time, 0.0 * time], axis=1)
    np.savetxt(tmp_path / "straight.csv", rows, delimiter=",", header="t,vx,gyro,px,py,theta", comments="")
    return tmp_path / "straight.csv"

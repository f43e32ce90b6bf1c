"""Recorded drives in the view: one of wheels and truth alone is replayed, another one shown as it is."""

import numpy as np
import pytest

from turtlebot_gym_agents.watch import read_recorded


@pytest.mark.parametrize("names", ["vx,gyro,px,py,theta", "v,omega,x,y,theta"])
def test_a_drive_without_measured_poses_is_replayed_and_another_one_shown_as_it_is(names, tmp_path):
    rows = [f"{0.1 * k:.1f},0.2,0.0,{0.02 * k:.2f},0.0,0.0" for k in range(30)]
    (tmp_path / "drive.csv").write_text("\n".join([f"t,{names}", *rows]))
    drive = read_recorded(tmp_path / "drive.csv", label="mine", noise="clean")
    assert drive.around.label == "mine"
    if names.startswith("vx"):
        np.testing.assert_allclose(drive.true_state[:, 0], 0.02 * np.arange(30), atol=1e-9)
        np.testing.assert_allclose(drive.estimate[:, 0], drive.true_state[:, 0], atol=1e-3)
        assert np.isfinite(drive.odometry).all()
    else:
        np.testing.assert_allclose(drive.odometry[:, 0], 0.02 * np.arange(30), atol=1e-9)
        assert np.isnan(drive.estimate).all()

"""Recorded drives in the view: one of wheels and truth alone is replayed, another one shown as it is."""

import numpy as np

from turtlebot_gym_agents.watch import read_recorded


def test_a_drive_without_measured_poses_is_replayed(tmp_path):
    rows = [f"{0.1 * k:.1f},0.2,0.0,{0.02 * k:.2f},0.0,0.0" for k in range(30)]
    (tmp_path / "drive.csv").write_text("\n".join(["t,vx,gyro,px,py,theta", *rows]))
    drive = read_recorded(tmp_path / "drive.csv", label="mine", noise="clean")
    assert drive.around.label == "mine"
    np.testing.assert_allclose(drive.true_state[:, 0], 0.02 * np.arange(30), atol=1e-9)
    np.testing.assert_allclose(drive.estimate[:, 0], drive.true_state[:, 0], atol=1e-3)
    assert np.isfinite(drive.odometry).all()


def test_measured_poses_are_shown_as_they_are(tmp_path):
    rows = [f"{0.1 * k:.1f},0.2,0.0,{0.02 * k:.2f},0.0,0.0" for k in range(30)]
    (tmp_path / "drive.csv").write_text("\n".join(["t,v,omega,x,y,theta", *rows]))
    drive = read_recorded(tmp_path / "drive.csv")
    np.testing.assert_allclose(drive.odometry[:, 0], 0.02 * np.arange(30), atol=1e-9)
    assert np.isnan(drive.estimate).all()

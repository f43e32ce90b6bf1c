"""The command ``calibrate``: from a drive of the environment to a noise file, and how good it is on recorded drives."""

import json
from dataclasses import replace

import numpy as np
import pytest
from drive_samples import recorded
from simulated import simulated_log

from turtlebot_gym import Noise, OdometryNoise, ProcessNoise, make_filter, make_noise
from turtlebot_gym_agents.commands.cli import main
from turtlebot_gym_lab.calibration import CalibrationEstimate, calibrate
from turtlebot_gym_lab.commands.calibration_report import interval_text
from turtlebot_gym_lab.drives import read
from turtlebot_gym_lab.evaluation.replay import replay, replay_seeds

RECORDED = ("wifibot1.txt", "wifibot2.txt")
MINE = Noise(
    process=ProcessNoise(alpha1=0.006, alpha2=0.005, alpha3=0.004, alpha4=0.007, scale=0.97),
    odometry=OdometryNoise(R=(0.03**2, 0.03**2, 0.06**2), bias=(0.01, 0.0, 0.02), dropout_probability=0.05),
)


@pytest.fixture(scope="module")
def table(tmp_path_factory):
    log = simulated_log(MINE, seed=2, steps=800)
    path = tmp_path_factory.mktemp("log") / "drive.csv"
    names = "t,v,omega,x,y,theta,true_x,true_y,true_theta"
    columns = np.column_stack([log.time, log.twist, log.odometry, log.truth])
    np.savetxt(path, columns, delimiter=",", header=names, comments="")
    return path


def test_a_noise_file_a_figure_and_numbers_are_written(table, tmp_path, capsys):
    out, report, picture = tmp_path / "mine.yaml", tmp_path / "mine.json", tmp_path / "mine.png"
    assert main(["calibrate", str(table), "--out", str(out), "--json", str(report), "--plot", str(picture)]) == 0
    printed = capsys.readouterr().out
    assert "measured poses, fitted to the truth" in " ".join(printed.split())
    noise = make_noise(str(out))
    assert noise.process.scale == pytest.approx(0.97, abs=0.01)
    assert noise.odometry.R[0] == pytest.approx(0.03**2, rel=0.2)
    text = out.read_text()
    assert text.startswith("# Calibrated from drive.csv by turtlebot-gym")
    assert "95 % interval" in text
    numbers = json.loads(report.read_text())
    assert numbers["config"]["log"] == str(table)
    assert numbers["estimates"]["scale"]["low"] < 0.97 < numbers["estimates"]["scale"]["high"]
    assert picture.stat().st_size > 10_000


def test_a_file_that_makes_the_wheels_worse_is_not_written_unless_forced(tmp_path, capsys):
    # The wheels of the first half are 10 % smaller than assumed, those of the second half 10 % larger.
    log = simulated_log(MINE, seed=2, steps=1600)
    middle = len(log) // 2
    size = np.where(np.arange(len(log)) < middle, 1.0 / 0.87, 1.0 / 1.07)
    columns = np.column_stack([log.time, log.twist * size[:, None], log.truth])
    table, out = tmp_path / "far.csv", tmp_path / "far.yaml"
    np.savetxt(table, columns, delimiter=",", header="t,v,omega,true_x,true_y,true_theta", comments="")
    command = ["calibrate", str(table), "--odometry", "wheel", "--out", str(out)]
    assert main(command) == 2
    assert "far.yaml is not written: The file makes the wheels worse" in " ".join(capsys.readouterr().err.split())
    assert not out.exists()
    assert main([*command, "--force"]) == 0
    assert "The file makes the wheels worse" in out.read_text()


def test_parameters_that_innovations_cannot_determine_are_reported(table, capsys):
    assert main(["calibrate", str(table), "--truth", "none"]) == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert "fitted to the innovations alone" in printed
    assert "bias_x │ a shift of all poses looks like another origin: record the truth" in printed


@pytest.mark.parametrize(("name", "other"), [RECORDED, pytest.param(*RECORDED[::-1], marks=pytest.mark.slow)])
def test_a_calibrated_filter_knows_its_error_on_another_recorded_drive(name, other):
    drive, calibrated = read(recorded(other)), read(recorded(name))
    measured = replay(calibrated, noise="documented", seed=1000, rate=np.inf).odometry
    fitted = calibrate(replace(calibrated, odometry=measured))
    # What is measured has no bias, as the calibration knows it; the other filter assumes the preset "wheel".
    unbiased = replace(make_noise("documented"), odometry=replace(make_noise("documented").odometry, bias=(0.0, 0.0, 0.0)))
    after = replay_seeds(drive, range(2), noise=unbiased, filter=make_filter("calibrated", fitted.noise))
    before = replay_seeds(drive, range(2), noise="documented", filter="matched")
    assert after.nees.mean() <= 4.0 < before.nees.mean()
    assert after.filter.position_mean.mean() <= 0.026


@pytest.mark.parametrize(
    ("low", "high", "shown"), [(0.99999, 1.00001, "0.99999 to 1"), (1.0, 1.0, "undetermined"), (0.2, np.inf, "0.2 to ?")]
)
def test_the_ends_of_an_interval_are_told_apart(low, high, shown):
    assert interval_text(CalibrationEstimate(value=1.0, low=low, high=high)) == shown

"""The command ``calibrate``: from a drive of the environment to a noise file, and what it is worth on recorded drives."""

import json
from pathlib import Path

import numpy as np
import pytest

from turtlebot_gym import Noise, OdometryNoise, ProcessNoise, make_noise
from turtlebot_gym.calibration import calibrate
from turtlebot_gym.drives import read
from turtlebot_gym_agents.commands.cli import main
from turtlebot_gym_agents.evaluation.calibration import judge, measured_log, simulated_log

DATA = Path(__file__).parents[3] / "shared" / "data"
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
    out, told, picture = tmp_path / "mine.yaml", tmp_path / "mine.json", tmp_path / "mine.png"
    assert main(["calibrate", str(table), "--out", str(out), "--json", str(told), "--plot", str(picture)]) == 0
    printed = capsys.readouterr().out
    assert "measured poses, fitted to the truth" in " ".join(printed.split())
    noise = make_noise(str(out))
    assert noise.process.scale == pytest.approx(0.97, abs=0.01)
    assert noise.odometry.R[0] == pytest.approx(0.03**2, rel=0.2)
    text = out.read_text()
    assert text.startswith("# Calibrated from drive.csv by turtlebot-gym")
    assert "95 % interval" in text
    numbers = json.loads(told.read_text())
    assert numbers["config"]["log"] == str(table)
    assert numbers["estimates"]["scale"]["low"] < 0.97 < numbers["estimates"]["scale"]["high"]
    assert picture.stat().st_size > 10_000


def test_a_drive_that_the_model_does_not_describe_gives_no_file_unless_forced(tmp_path, capsys):
    log, random = simulated_log(MINE, seed=2, steps=300), np.random.default_rng(0)
    far = 0.3 * random.standard_t(2.1, size=(len(log), 3)) * np.abs(log.twist[:, :1])  # of the place, in each step
    columns = np.column_stack([log.time, log.twist, log.truth + np.cumsum(0.1 * far, axis=0)])
    table, out = tmp_path / "far.csv", tmp_path / "far.yaml"
    np.savetxt(table, columns, delimiter=",", header="t,v,omega,true_x,true_y,true_theta", comments="")
    command = ["calibrate", str(table), "--odometry", "wheel", "--segment", "0", "--out", str(out)]
    assert main(command) == 2
    assert "far.yaml is not written: The model does not describe the drive" in " ".join(capsys.readouterr().err.split())
    assert not out.exists()
    assert main([*command, "--force"]) == 0
    assert "The model does not describe the drive" in out.read_text()


def test_what_innovations_cannot_tell_is_said(table, capsys):
    assert main(["calibrate", str(table), "--truth", "none"]) == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert "fitted to the innovations alone" in printed
    assert "bias_x │ a shift of all poses looks like another origin: record the truth" in printed


@pytest.mark.parametrize(("name", "other"), [RECORDED, RECORDED[::-1]])
def test_a_calibrated_filter_knows_its_error_on_another_recorded_drive(name, other):
    # 20 seeds: `benchmarks/calibration_recorded.json`
    if not all((DATA / each).is_file() for each in RECORDED):
        pytest.skip(f"NOT TESTED ON REAL DATA: the recorded drives in {DATA} are missing")
    drive = read(DATA / other)
    found = calibrate(measured_log(read(DATA / name), seed=1000, rate=np.inf))
    assert found.segment > 0.0
    told, before = (judge(drive, noise, range(2)) for noise in (found.noise, None))
    assert told.nees.mean() <= 4.0 < before.nees.mean()
    assert told.position.mean() <= 0.026

"""The lab's commands: what they print, the same as a result in Python, and what they refuse in one line."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from turtlebot_gym_agents.commands.cli import main
from turtlebot_gym_agents.front.satellites import replay


@pytest.fixture
def drive(tmp_path) -> Path:
    """A recorded drive straight on, whose wheels overstate the way by 2 %."""
    time = np.linspace(0.0, 20.0, 1001)
    rows = np.stack([time, np.full_like(time, 0.204), 0.0 * time, 0.2 * time, 0.0 * time, 0.0 * time], axis=1)
    np.savetxt(tmp_path / "straight.csv", rows, delimiter=",", header="t,vx,gyro,px,py,theta", comments="")
    return tmp_path / "straight.csv"


def test_replay_prints_the_errors_of_each_file(tmp_path, drive, capsys):
    other = tmp_path / "other.csv"
    other.write_text(drive.read_text())
    paths = tmp_path / "result.json", tmp_path / "drive.png"
    files = [str(drive), str(other)]
    assert main(["replay", *files, "--seeds", "3", "--json", str(paths[0]), "--plot", str(paths[1])]) == 0
    out = capsys.readouterr().out
    assert out.index("straight.csv") < out.index("other.csv")
    assert "0.020" in out  # per metre
    content = json.loads(paths[0].read_text())
    assert content["config"]["seeds"] == 3
    assert [Path(run["file"]).name for run in content["runs"]] == ["straight.csv", "other.csv"]
    for run in content["runs"]:
        assert run["wheels_per_metre"]["position"] == pytest.approx(0.02, rel=0.02)
        assert run["mean"]["filter"]["position_mean"] < run["mean"]["raw"]["position_mean"]
        assert len(run["seeds"]["filter"]["position_mean"]) == 3
    assert sorted(path.name for path in tmp_path.glob("*.png")) == ["drive-other.png", "drive-straight.png"]


def test_a_result_has_the_numbers_of_the_command_and_is_written_and_drawn(tmp_path, drive, capsys):
    (tmp_path / "second.csv").write_text(drive.read_text())
    recordings = drive, tmp_path / "second.csv"
    assert main(["replay", *map(str, recordings), "--seeds", "2", "--json", str(tmp_path / "command.json")]) == 0
    printed = " ".join(capsys.readouterr().out.split())
    result = replay(*recordings, seeds=2)
    assert result.verdict().splitlines()[0] in printed
    assert "measured poses generated from the truth, noise documented." in str(result)
    result.to_json(tmp_path / "result.json")
    files = [json.loads((tmp_path / f"{name}.json").read_text()) for name in ("command", "result")]
    assert files[0]["runs"] == files[1]["runs"]
    assert result["nees"].tolist() == pytest.approx([run["nees"] for run in files[0]["runs"]])
    result.to_csv(tmp_path / "result.csv")
    with (tmp_path / "result.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["recording"] for row in rows] == ["straight.csv", "second.csv"]
    np.testing.assert_array_equal([float(row["filter_position_mean"]) for row in rows], result["filter_position_mean"])
    axes = Figure().subplots()
    assert result.plot(axes) is axes
    assert axes.has_data()


REFUSED = [
    (["replay"], "At least one FILE"),
    (["calibrate", "none.csv"], "none.csv"),
    (["calibrate", "straight.csv", "--truth", "none.csv"], "truth must be auto, none, or a file where"),
    (["calibrate", "straight.csv", "--columns", "speed=v"], "columns must name time, v, omega"),
    (["calibrate", "straight.csv", "--odometry", "laser"], "straight.csv: kind must be one of 'pose', 'wheel', got 'laser'"),
    (["replay", "no/such/file.csv"], "no/such/file.csv"),
    (["replay", "straight.csv", "--seed", "-1"], "seed must be a whole number from 0 to "),
]


@pytest.mark.parametrize(
    ("arguments", "message"), REFUSED, ids=lambda value: " ".join(value) if isinstance(value, list) else ""
)
def test_invalid_arguments_are_refused_in_one_line_and_leave_nothing(arguments, message, capsys, tmp_path, monkeypatch, drive):
    monkeypatch.chdir(tmp_path)
    assert main(arguments) == 2
    printed = capsys.readouterr()
    assert not printed.out
    assert printed.err.startswith("turtlebot-gym: ")
    assert message in printed.err
    assert printed.err.count("\n") == 1
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == [drive]


@pytest.mark.parametrize("words", ["calibrate mine.json --json mine.json", "calibrate bag --out bag/metadata.yaml"])
def test_no_input_is_overwritten_even_with_force(words, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.json").write_text("{}")
    (tmp_path / "bag").mkdir()
    (tmp_path / "bag" / "metadata.yaml").write_text("x: 1\n")
    assert main([*words.split(), "--force"]) == 2
    assert "it is an input of the same command" in capsys.readouterr().err

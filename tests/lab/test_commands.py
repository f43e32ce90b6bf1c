"""The lab's commands: what they print, and what they refuse in one line."""

import json
from pathlib import Path

import pytest

from turtlebot_gym_agents.commands.cli import main
from turtlebot_gym_lab.commands.replay import pictures_of


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


REFUSED = [
    (["replay"], "At least one FILE"),
    (["calibrate", "none.csv"], "none.csv"),
    (
        ["calibrate", "straight.csv", "--truth", "none.csv"],
        "truth must be auto, none, or a file where",
    ),
    (["calibrate", "straight.csv", "--columns", "speed=v"], "columns must name time, v, omega"),
    (["calibrate", "straight.csv", "--odometry", "laser"], "straight.csv: kind must be one of 'pose', 'wheel', got 'laser'"),
    (["replay", "no/such/file.csv"], "no/such/file.csv"),
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


@pytest.mark.parametrize("seed", ["-1", str(2**63), str(2**80)])
def test_an_invalid_seed_is_refused_by_name(seed, drive, capsys):
    assert main(["replay", str(drive), "--seed", seed]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("turtlebot-gym: seed must be a whole number from 0 to ")


@pytest.mark.parametrize("words", ["calibrate mine.json --json mine.json", "calibrate bag --out bag/metadata.yaml"])
def test_no_input_is_overwritten_even_with_force(words, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.json").write_text("{}")
    (tmp_path / "bag").mkdir()
    (tmp_path / "bag" / "metadata.yaml").write_text("x: 1\n")
    assert main([*words.split(), "--force"]) == 2
    assert "it is an input of the same command" in capsys.readouterr().err


def test_several_drives_have_a_picture_each(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "more").mkdir()
    (tmp_path / "drive.csv").write_text("x")
    (tmp_path / "more" / "drive.csv").write_text("x")
    files = (Path("drive.csv"), Path("more/drive.csv"), Path("other.csv"))
    names = [path.name for path in pictures_of(Path("a.png"), files)]
    assert names == ["a-drive-0.png", "a-drive-1.png", "a-other.png"]
    (tmp_path / "a-other.png").write_text("dear")
    assert main(["replay", *map(str, files), "--plot", "a.png"]) == 2
    assert "a-other.png: it exists" in capsys.readouterr().err

"""Replay in Python: what the command prints, as a result."""

import csv
import json

import numpy as np
import pytest
from matplotlib.figure import Figure

from turtlebot_gym_agents.commands.cli import main
from turtlebot_gym_agents.front.satellites import replay


@pytest.fixture
def recordings(tmp_path):
    """Two drives of 3 s straight ahead."""
    rows = [f"{0.1 * k:.1f},0.2,0.0,{0.02 * k:.2f},0.0,0.0" for k in range(31)]
    paths = tmp_path / "first.csv", tmp_path / "second.csv"
    for path in paths:
        path.write_text("\n".join(["t,vx,gyro,px,py,theta", *rows]))
    return paths


def test_a_result_has_the_numbers_of_the_command(recordings, tmp_path, capsys):
    assert main(["replay", *map(str, recordings), "--seeds", "2", "--json", str(tmp_path / "command.json")]) == 0
    printed = " ".join(capsys.readouterr().out.split())
    result = replay(*recordings, seeds=2)
    assert result.verdict().splitlines()[0] in printed
    result.to_json(tmp_path / "result.json")
    files = [json.loads((tmp_path / f"{name}.json").read_text()) for name in ("command", "result")]
    assert files[0]["runs"] == files[1]["runs"]
    assert result["nees"].tolist() == pytest.approx([run["nees"] for run in files[0]["runs"]])


def test_a_result_prints_plots_and_is_written(recordings, tmp_path):
    result = replay(*recordings, seeds=1)
    assert "first.csv" in str(result)
    assert "measured poses generated from the truth, noise documented." in str(result)
    result.to_csv(tmp_path / "result.csv")
    with (tmp_path / "result.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["recording"] for row in rows] == ["first.csv", "second.csv"]
    np.testing.assert_array_equal([float(row["filter_position_mean"]) for row in rows], result["filter_position_mean"])
    axes = Figure().subplots()
    assert result.plot(axes) is axes
    assert axes.has_data()

"""``watch``: what it refuses in one line."""

import pytest

from turtlebot_gym_agents import watch
from turtlebot_gym_agents.commands.cli import main


@pytest.mark.parametrize("option", ["--policy", "--env", "--drive", "--noise"])
def test_an_unknown_name_is_refused_in_one_line_and_nothing_is_written(option, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["watch", option, "nothing", "--html", "a.html"]) == 2
    printed = capsys.readouterr()
    assert not printed.out
    assert printed.err.startswith("turtlebot-gym: ")
    assert printed.err.count("\n") == 1
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("seed", ["-1", str(2**63), str(2**80)])
def test_an_invalid_seed_is_refused_by_name(seed, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["watch", "--html", "a.html", "--seed", seed]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("turtlebot-gym: seed must be a whole number from 0 to ")


def test_more_drives_than_there_are_colours_are_refused(capsys, tmp_path, monkeypatch):
    monkeypatch.setattr("turtlebot_gym_agents.evaluation.recording.record_episode", lambda *_, **__: pytest.fail("driven"))
    assert main(["watch", "--policy", *["bearing"] * 7, "--html", str(tmp_path / "a.html")]) == 2
    assert capsys.readouterr().err == "turtlebot-gym: a view shows 1 to 6 drives, got 7.\n"


def test_the_page_of_policies_is_an_object_for_notebooks():
    pytest.importorskip("bokeh")
    page = watch("bearing", "proportional", seed=3)
    assert [drive.around.label for drive in page.drives] == ["bearing", "proportional"]
    assert page._repr_html_().startswith("<iframe ")

"""``watch``: installed as an entry point, and what it refuses in one line."""

import pytest

from turtlebot_gym_agents.commands.cli import commands, main


def test_the_command_is_installed_as_an_entry_point():
    assert "watch" in commands(), "install the checkout anew: its entry points have changed"


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

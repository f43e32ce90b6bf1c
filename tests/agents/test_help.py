"""The help of commands: a first screen of at most 25 lines, and all flags by groups."""

import pytest

from turtlebot_gym_agents.commands.cli import COMMANDS, commands, main
from turtlebot_gym_agents.commands.fields import flags_of
from turtlebot_gym_agents.commands.help import GROUPS


def printed(capsys, *words):
    """Return the lines that a command prints."""
    with pytest.raises(SystemExit) as stop:
        main(list(words))
    assert stop.value.code == 0
    return capsys.readouterr().out.rstrip("\n").split("\n")


@pytest.fixture(autouse=True)
def width(monkeypatch):
    monkeypatch.setenv("COLUMNS", "100")


@pytest.mark.parametrize("name", [name for name in ("train", "evaluate", "watch", "tune") if name in commands()])
def test_the_first_screen_has_at_most_25_lines_and_says_how_to_see_all(name, capsys):
    lines = printed(capsys, name, "--help")
    assert len(lines) <= 25
    assert lines[0].startswith(f"usage: turtlebot-gym {name} [KEY=VALUE ...]")
    assert lines[-1].startswith("All flags: --help-all; those of a group: --help task|robot|")
    shown = [line.split()[0] for line in lines if line.startswith("  --")]
    assert {"--env", "--noise", "--filter"} < set(shown) < {flag.word for flag in flags_of(commands()[name])}


@pytest.mark.parametrize("name", commands())
def test_the_whole_help_shows_every_flag_with_its_text_in_its_group(name, capsys):
    lines = printed(capsys, name, "--help-all")
    assert max(map(len, lines)) <= 100
    group, groups = "", {}
    for line in lines:
        if line and not line.startswith(" ") and line.endswith(":"):
            group = line.removesuffix(":").replace("options", "")
        elif line.startswith("  ") and not line.startswith("   "):
            groups[line.split()[0].replace("--no-", "--")] = group
    flags = {flag.word.split()[0]: flag.group for flag in flags_of(commands()[name])}
    assert {**groups} == {word.replace("--no-", "--"): title for word, title in flags.items()}
    assert set(groups.values()) <= set(GROUPS)
    text = " ".join(" ".join(lines).split())
    assert all(flag.text in text for flag in flags_of(commands()[name]))


def test_a_group_and_the_keys_have_a_help_of_their_own(capsys):
    robot = printed(capsys, "train", "--help", "robot")
    assert robot[0] == "robot and noise:"
    assert any(line.startswith("  --noise NAME") for line in robot)
    assert not any("--algo" in line for line in robot)
    keys = "\n".join(printed(capsys, "evaluate", "--help", "keys"))
    for key in ("noise.odometry.spike", "filter.kind.gate", "task.radius", "robot.max_linear", "lidar.range_max"):
        assert f"\n  {key} " in keys
    assert "Size of a heading spike, rad." in keys
    assert "learning_rate" not in keys
    pytest.importorskip("stable_baselines3", reason="needs the extra [agents]")
    assert "policy_kwargs.net_arch" in "\n".join(printed(capsys, "train", "--help", "keys"))


def test_the_programs_help_names_every_command(capsys):
    lines = printed(capsys, "--help")
    assert lines[0] == "usage: turtlebot-gym COMMAND [--help] ..."
    assert {line.split()[0] for line in lines if line.startswith("  ") and not line.startswith("   ")} == set(commands())


@pytest.mark.parametrize(("words", "message"), [("train --help rob", "Did you mean 'robot'?"), ("card --help keys", "no keys")])
def test_an_unknown_group_is_refused_in_one_line(words, message, capsys):
    assert main(words.split()) == 2
    assert message in capsys.readouterr().err


@pytest.mark.parametrize("columns", ["40", "80", "300"])
def test_lines_fit_the_terminal(columns, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", columns)
    for name in COMMANDS:
        for line in printed(capsys, name, "--help-all"):
            assert len(line) <= max(50, min(100, int(columns))) or " " not in line.strip() or line.startswith(("usage", "  --"))

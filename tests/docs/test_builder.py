"""The page that builds commands: its choices are those of the package, and each command that it makes is a valid one."""

import itertools
import random
import re
import shlex
import sys
from pathlib import Path

import gymnasium as gym
import pytest
import tyro

pytest.importorskip("stable_baselines3", reason="needs the extra [agents]")

from turtlebot_gym_agents.commands.cli import COMMANDS
from turtlebot_gym_agents.commands.flags import REGISTRY

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def choices():
    sys.path.insert(0, str(ROOT / "docs" / "generate"))
    try:
        from builder import choices
    finally:
        sys.path.pop(0)
    return choices()


def made(choices):
    """Return all commands by task, form and what is chosen."""
    for env, task in choices["task"].items():
        parts = (choices["noise"], choices["filter"], task["policy"], task["world"] or [""])
        for noise, filter, policy, world in itertools.product(*parts):
            chosen = {"noise": noise, "filter": filter, "policy": policy, "world": world}
            for name, form in task["forms"].items():
                if form:
                    yield name, chosen | {"env": env}, form.format(**chosen).replace("\\\n", "")


def parsed(words):
    """Return the command that the parser makes of words."""
    return tyro.extras.subcommand_cli_from_dict(dict(COMMANDS), prog="turtlebot-gym", args=words, registry=REGISTRY)


def test_each_choice_is_there_and_a_sample_of_commands_is_what_was_chosen(choices):
    commands = list(made(choices))
    assert len(commands) > 10_000
    for name, chosen, line in random.Random(0).sample([command for command in commands if command[0] != "bringup"], 60):
        program, *words = shlex.split(line)
        assert program == "turtlebot-gym"
        command = parsed(words)
        given = {key: getattr(command, key) for key in chosen if chosen[key] and hasattr(command, key)}
        wanted = {key: chosen[key] for key in given}
        several = {key: (value,) if isinstance(given[key], tuple) else value for key, value in wanted.items()}
        assert given == several, line
        assert {"env", "noise", "filter"} <= {*given}, line
        assert name == words[0]


def test_the_parser_of_the_graph_takes_a_sample(choices):
    bringup = pytest.importorskip("turtlebot_gym_ros.graph.bringup", reason="needs the extra [ros]")
    lines = [(chosen, line) for name, chosen, line in made(choices) if name == "bringup"]
    for chosen, line in random.Random(0).sample(lines, 60):
        options = bringup.parser().parse_args(shlex.split(line.partition(" bringup ")[2]))
        assert (options.noise, options.filter, options.policy) == (chosen["noise"], chosen["filter"], chosen["policy"])
        assert (options.world or "") == chosen["world"]


def test_environments_take_a_sample_of_choices(choices):
    lines = [chosen for name, chosen, _ in made(choices) if name == "evaluate"]
    for chosen in random.Random(1).sample(lines, 20):
        options = {key: value for key, value in chosen.items() if value and key not in ("env", "policy")}
        gym.make(chosen["env"], **options).close()
    assert {"bearing", "ppo-nav"} <= {*choices["task"]["turtlebot_gym/TurtleBotNav-v0"]["policy"]}
    assert "vfh" not in choices["task"]["turtlebot_gym/TurtleBotNav-v0"]["policy"]


def test_the_page_shows_the_forms_as_they_are_without_a_script(choices):
    page = (ROOT / "docs" / "builder.md").read_text()
    blocks = dict(re.findall(r'```console title="(\w+)"\n(.*?)\n```', page, re.DOTALL))
    assert {*blocks} == {*choices["task"]["turtlebot_gym/TurtleBotNav-v0"]["forms"]}
    chosen = {"noise": "tutorial", "filter": "matched", "policy": "bearing"}
    forms = choices["task"]["turtlebot_gym/TurtleBotNav-v0"]["forms"] | {
        "bringup": choices["task"]["turtlebot_gym/TurtleBotSquare-v0"]["forms"]["bringup"]
    }
    assert blocks == {name: form.format(**chosen) for name, form in forms.items()}

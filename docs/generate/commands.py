"""The command line's reference: the whole help of each command."""

import os
from contextlib import redirect_stdout, suppress
from io import StringIO
from textwrap import fill
from unittest.mock import patch

import mkdocs_gen_files

from turtlebot_gym_agents.commands.cli import commands
from turtlebot_gym_agents.commands.cli import main as turtlebot_gym
from turtlebot_gym_ros.__main__ import main as turtlebot_gym_ros

WIDTH = 100
"""Columns that fit beside both side bars at 1400 pixels."""


def help_of(main, *words):
    """Return what a command prints when it is asked for help."""
    columns = patch.dict(os.environ, COLUMNS=str(WIDTH))
    with columns, redirect_stdout(StringIO()) as printed, suppress(SystemExit):
        main([*words, "--help"])
    lines = printed.getvalue().strip().splitlines()
    return "\n".join(fill(line, WIDTH) if len(line) > WIDTH else line for line in lines)  # descriptions come unwrapped


with mkdocs_gen_files.open("reference/commands.md", "w") as page:
    print("# Command line\n\nWhat the commands print with `--help`.\n", file=page)
    for name in commands():
        print(f"## turtlebot-gym {name}\n\n```text\n{help_of(turtlebot_gym, name)}\n```\n", file=page)

with mkdocs_gen_files.open("reference/commands_ros.md", "w") as page:
    print("# Command line, ROS\n\nWhat the nodes and the graph print with `--help`.\n", file=page)
    print(f"## python -m turtlebot_gym_ros\n\n```text\n{help_of(turtlebot_gym_ros)}\n```\n", file=page)
    for name in ("bringup", "status"):
        text = help_of(turtlebot_gym_ros, name)
        print(f"## python -m turtlebot_gym_ros {name}\n\n```text\n{text}\n```\n", file=page)

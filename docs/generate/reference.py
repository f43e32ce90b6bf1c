"""The reference: environments and API from docstrings, the commands' own help, and the release notes."""

import ast
import os
from contextlib import redirect_stdout, suppress
from io import StringIO
from pathlib import Path
from textwrap import fill
from unittest.mock import patch

import gymnasium as gym
import mkdocs_gen_files

from turtlebot_gym_agents.commands.cli import commands
from turtlebot_gym_agents.commands.cli import main as turtlebot_gym
from turtlebot_gym_ros.__main__ import main as turtlebot_gym_ros

ROOTS = {
    "turtlebot_gym": ".",
    "turtlebot_gym_agents": "agents",
    "turtlebot_gym_ros": "bridges/turtlebot_gym_ros",
    "turtlebot_gym_lab": "lab",
    "turtlebot_gym_view": "lab",
}
"""The folder that holds each package."""
ELSEWHERE = ("turtlebot_gym.envs.navigation", "turtlebot_gym.envs.navigation_vector", "turtlebot_gym.systems.options")
"""Modules that the page of the environments describes."""
SEARCHED = "---\nsearch:\n  boost: 0.3\n---\n\n"
"""A search names these pages after those that explain."""
COLUMNS = 100
"""Columns that fit beside both side bars at 1400 pixels."""


def modules_of(package):
    """Yield the name of each public module of a package with the first sentence of its docstring."""
    root = Path(ROOTS[package])
    for path in sorted((root / package).rglob("*.py")):
        name = ".".join(path.relative_to(root).with_suffix("").parts).removesuffix(".__init__")
        if name != package and not any(part.startswith("_") for part in name.split(".")):
            said = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
            yield name, said.partition("\n\n")[0].replace("\n", " ")


def help_of(main, *words):
    """Return what a command prints when it is asked for help."""
    with patch.dict(os.environ, COLUMNS=str(COLUMNS)), redirect_stdout(StringIO()) as printed, suppress(SystemExit):
        main([*words])
    lines = printed.getvalue().strip().splitlines()
    text = "\n".join(fill(line, COLUMNS) if len(line) > COLUMNS else line for line in lines)  # descriptions come unwrapped
    return f"```text\n{text}\n```\n"


for package in ROOTS:
    modules = [each for each in modules_of(package) if each[0] not in ELSEWHERE]
    with mkdocs_gen_files.open(f"reference/{package}.md", "w") as page:
        print(f"{SEARCHED}# API: {package}\n\n::: {package}\n    options:\n      members: []\n", file=page)
        print(
            "| module | |\n|---|---|", *(f"| [`{name}`]({name}.md) | {said} |" for name, said in modules), sep="\n", file=page
        )
    for name, _ in modules:
        with mkdocs_gen_files.open(f"reference/{name}.md", "w") as page:
            page.write(f"{SEARCHED}::: {name}\n    options:\n      heading_level: 1\n")

with mkdocs_gen_files.open("reference/environments.md", "w") as page:
    print("# Environments\n\n| id | steps at most |\n|---|---|", file=page)
    for spec in gym.registry.values():
        if spec.namespace == "turtlebot_gym":
            print(f"| `{spec.id}` | {spec.max_episode_steps} |", file=page)
    print("\nWith `gym.make` each is a scalar environment:\n\n::: turtlebot_gym.envs.navigation.NavigationEnv\n", file=page)
    print("::: turtlebot_gym.systems.options.Options\n\n# Vector environments\n", file=page)
    print("The same ids through `gym.make_vec(ID, num_envs=N)`, compiled and with N rows.\n", file=page)
    print("::: turtlebot_gym.envs.navigation_vector.NavigationVectorEnv\n", file=page)
    print("::: turtlebot_gym.envs.navigation_device.NavigationDeviceEnv\n", file=page)

with mkdocs_gen_files.open("reference/commands.md", "w") as page:
    print("# Command line\n\nWhat the commands print when they are asked for help.\n", file=page)
    for name in commands():
        print(f"## turtlebot-gym {name}\n\n{help_of(turtlebot_gym, name, '--help')}", file=page)
    for words in ((), ("bringup",), ("status",)):
        title = " ".join(("python -m turtlebot_gym_ros", *words))
        print(f"## {title}\n\n{help_of(turtlebot_gym_ros, *words, '--help')}", file=page)

with mkdocs_gen_files.open("releases.md", "w") as page:
    text = Path("CHANGELOG.md").read_text(encoding="utf-8")
    page.write(text.replace("# Changelog", "# Release notes", 1).replace("](docs/", "]("))

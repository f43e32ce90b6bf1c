"""A page for each environment, in the form of Gymnasium's own; its tables are made from the environment."""

import sys
from dataclasses import fields
from pathlib import Path
from typing import Any

import griffe
import gymnasium as gym
import mkdocs_gen_files
from gymnasium.envs.registration import EnvSpec

import turtlebot_gym  # noqa: F401  # registers the ids
from turtlebot_gym.systems import Options
from turtlebot_gym_agents.ids import SHORT

sys.path.insert(0, str(Path("docs/generate").resolve()))
from environment_texts import ACTION, COLUMNS, REWARDS, ROOM_REWARD, TEXTS, TIME_LIMIT


def picture_of(spec: EnvSpec) -> str:
    """Return the name of the picture that `environments.py` made of an environment."""
    made = mkdocs_gen_files.FilesEditor.current().files
    (picture,) = (Path(file.src_uri) for file in made if Path(file.src_uri).stem == spec.name and file.src_uri[-3:] != ".md")
    return picture.name


def of_options() -> dict[str, str]:
    """Return what each option means, from its docstring, on one line."""
    options = griffe.load("turtlebot_gym.systems.options")["Options"]
    return {field.name: " ".join(options[field.name].docstring.value.split()) for field in fields(Options)}


def table(*columns: str) -> str:
    """Return the head of a table."""
    return f"\n| {' | '.join(columns)} |\n{'|---' * len(columns)}|"


def observed(env: Any) -> list[str]:
    """Return the rows of an observation's table."""
    low, high = env.observation_space.low, env.observation_space.high
    rows, at = [], 0
    for term in env.observation_terms:
        for count, unit, words in COLUMNS[term.name]:
            number = str(at) if count == 1 else f"{at}, {at + 1}" if count == 2 else f"{at} to {at + count - 1}"
            rows.append(f"| `{term.name}` | {number} | {words} | {unit} | {low[at]:.4g} | {high[at]:.4g} |")
            at += count
    if at != len(low):
        raise ValueError(f"{at} of the observation's {len(low)} numbers are described.")
    return rows


def page_of(spec: EnvSpec) -> str:
    """Return the page of an environment."""
    env: Any = gym.make(spec).unwrapped
    texts, said = TEXTS[spec.name], of_options()
    (short,) = [short for short, name in SHORT.items() if name == spec.id]
    size, weights = len(env.observation_space.low), env.parameters.reward
    lines = [
        f"# {spec.name.removeprefix('TurtleBot')}\n",
        f"![{spec.id} at work: robot, estimate, odometry and goal]({picture_of(spec)})",
        table("", ""),
        f'| Make | `gym.make("{spec.id}")`, `gym.make_vec("{spec.id}", num_envs=4096)`; in commands `--env {short}` |',
        "| Action space | `Box(-1, 1, (2,), float32)` |",
        f"| Observation space | `Box(({size},), float32)` |",
        f"\n## Description\n\n{texts.description}",
        f"\n## Action Space\n\n{ACTION}",
        f"\n## Observation Space\n\nNamed terms, {size} numbers. [`observation`](#arguments) changes them.",
        table("term", "#", "number", "unit", "min", "max"),
        *observed(env),
        "\n## Rewards\n\nThe sum of these terms, each times its weight; [`reward`](#arguments) sets them. Distances are true.",
        ROOM_REWARD if "collision" in env.reward_terms else "",
        table("term", "weight", "value at a step"),
        *(f"| `{name}` | {getattr(weights, name):g} | {REWARDS[name]} |" for name in env.reward_terms),
        f"\n## Starting State\n\n{texts.start}",
        f"\n## Episode End\n\n{texts.end}\n\n{TIME_LIMIT.format(steps=spec.max_episode_steps)}",
        "\n## Arguments\n\nThose that matter most here; [all of them](environments.md#turtlebot_gym.systems.options.Options).",
        table("argument", "meaning"),
        *(f"| `{name}` | {said[name]} |" for name in texts.arguments),
        "\n## Version History\n\n* v0: first version.",
    ]
    env.close()
    return "\n".join(lines) + "\n"


for spec in gym.registry.values():
    if spec.namespace == "turtlebot_gym":
        with mkdocs_gen_files.open(f"reference/{spec.name}.md", "w") as page:
            page.write(page_of(spec))

"""The environments' pages: an overview, and for each environment a page in the form of Gymnasium's own."""

import io
import sys
from dataclasses import fields
from pathlib import Path
from typing import Any, NamedTuple

import griffe
import gymnasium as gym
import mkdocs_gen_files
import numpy as np
from gymnasium.envs.registration import EnvSpec
from matplotlib.image import imsave

import turtlebot_gym  # noqa: F401  # registers the ids
from turtlebot_gym.systems import Options
from turtlebot_gym_agents.ids import SHORT
from turtlebot_gym_agents.policies import PolicyWithMemory, make_policy

sys.path.insert(0, str(Path("docs/generate").resolve()))
from environment_texts import ACTION, COLUMNS, REWARDS, ROOM_REWARD, TEXTS, TIME_LIMIT


class Shown(NamedTuple):
    """What a picture shows."""

    policy: str
    steps: int
    seed: int
    goal: str


SHOWN = {
    "TurtleBotNav": Shown("bearing", 60, 0, "a point: within 0.15 m, whatever the heading"),
    "TurtleBotPose": Shown("rotate-drive-rotate", 80, 2, "a pose: within 0.15 m and 0.2 rad, the sector, and not spinning"),
    "TurtleBotSquare": Shown("corner", 250, 0, "the corners of a square in turn, each within 0.3 m"),
    "TurtleBotRooms": Shown("vfh", 140, 1, "a point in a room, by the beams of a LiDAR"),
    "TurtleBotMissions": Shown("vfh", 300, 1, "points in a room in turn, for ten minutes"),
}


def picture_of(spec: EnvSpec, shown: Shown) -> bytes:
    """Return a picture of an environment at work, PNG."""
    env, policy, png = gym.make(spec, render_mode="rgb_array"), make_policy(shown.policy), io.BytesIO()
    observation, _ = env.reset(seed=shown.seed)
    if isinstance(policy, PolicyWithMemory):
        policy.reset(np.ones(1, np.bool_))
    picture: Any = env.render()
    for _ in range(shown.steps):
        (action,) = policy(observation[None])
        observation, _, terminated, *_ = env.step(action)
        picture = env.render()  # each one lengthens the trails
        if terminated:
            break
    env.close()
    imsave(png, picture)
    return png.getvalue()


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
    texts, shown, said = TEXTS[spec.name], SHOWN[spec.name], of_options()
    (short,) = [short for short, name in SHORT.items() if name == spec.id]
    size, weights = len(env.observation_space.low), env.parameters.reward
    words = f"{spec.id} driven by {shown.policy}: robot, estimate, odometry and goal"
    lines = [
        f"# {spec.name.removeprefix('TurtleBot')}\n",
        f'![{words}]({spec.name}.png "policy {shown.policy}, seed {shown.seed}")',
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


specs = [spec for spec in gym.registry.values() if spec.namespace == "turtlebot_gym"]
with mkdocs_gen_files.open("reference/environments.md", "w") as page:
    print("# Environments", table("id", "goal", "steps at most"), sep="\n", file=page)
    for spec in specs:
        print(f"| [`{spec.id}`]({spec.name}.md) | {SHOWN[spec.name].goal} | {spec.max_episode_steps} |", file=page)
    print('\n<div class="pictures" markdown>\n', file=page)
    for spec in specs:
        shown = SHOWN[spec.name]
        with mkdocs_gen_files.open(f"reference/{spec.name}.png", "wb") as file:
            file.write(picture_of(spec, shown))
        words = f"{spec.id} driven by {shown.policy}: robot, estimate, odometry and goal"
        print(f'![{words}]({spec.name}.png "{spec.name}-v0, policy {shown.policy}, seed {shown.seed}")\n', file=page)
    print("</div>\n\nWith `gym.make` each is a scalar environment:\n", file=page)
    print("::: turtlebot_gym.envs.navigation.NavigationEnv\n", file=page)
    print("::: turtlebot_gym.systems.options.Options\n", file=page)
for spec in specs:
    with mkdocs_gen_files.open(f"reference/{spec.name}.md", "w") as page:
        page.write(page_of(spec))
with mkdocs_gen_files.open("reference/vector_environments.md", "w") as page:
    print(
        "# Vector environments\n\nThe same ids through `gym.make_vec(ID, num_envs=N)`, compiled and with N rows.\n", file=page
    )
    print("::: turtlebot_gym.envs.navigation_vector.NavigationVectorEnv\n", file=page)

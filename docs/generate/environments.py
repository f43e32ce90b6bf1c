"""The environments' pages: what is registered, a picture of each, and the environments' own docstrings."""

import io
from typing import Any, NamedTuple

import gymnasium as gym
import mkdocs_gen_files
import numpy as np
from gymnasium.envs.registration import EnvSpec
from matplotlib.image import imsave

import turtlebot_gym  # noqa: F401  # registers the ids
from turtlebot_gym_agents.policies import PolicyWithMemory, make_policy


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


specs = [spec for spec in gym.registry.values() if spec.namespace == "turtlebot_gym"]
with mkdocs_gen_files.open("reference/environments.md", "w") as page:
    print("# Environments\n\n| id | goal | steps at most |\n|---|---|---|", file=page)
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
with mkdocs_gen_files.open("reference/vector_environments.md", "w") as page:
    print(
        "# Vector environments\n\nThe same ids through `gym.make_vec(ID, num_envs=N)`, compiled and with N rows.\n", file=page
    )
    print("::: turtlebot_gym.envs.navigation_vector.NavigationVectorEnv\n", file=page)

"""The environments' page: what is registered, a picture of each, and the environments' own docstrings."""

import io
from typing import Any

import gymnasium as gym
import mkdocs_gen_files
from gymnasium.envs.registration import EnvSpec
from matplotlib.image import imsave

import turtlebot_gym  # noqa: F401  # registers the ids
from turtlebot_gym_agents.policies import BearingPolicy

STEPS = 60
"""Steps driven before the picture is taken."""


def picture_of(spec: EnvSpec) -> bytes:
    """Return a picture of an environment at work, PNG."""
    env, policy, png = gym.make(spec, render_mode="rgb_array"), BearingPolicy(), io.BytesIO()
    observation, _ = env.reset(seed=0)
    picture: Any = env.render()
    for _ in range(STEPS):
        observation, _, terminated, *_ = env.step(policy(observation))
        picture = env.render()  # each one lengthens the trails
        if terminated:
            break
    env.close()
    imsave(png, picture)
    return png.getvalue()


specs = [spec for spec in gym.registry.values() if spec.namespace == "turtlebot_gym"]
with mkdocs_gen_files.open("reference/environments.md", "w") as page:
    print("# Environments\n\n| id | steps at most |\n|---|---|", file=page)
    for spec in specs:
        print(f"| `{spec.id}` | {spec.max_episode_steps} |", file=page)
    print(f"\nAfter {STEPS} steps of the policy `bearing`, which drives straight on, seed 0:\n", file=page)
    for spec in specs:
        name = f"{spec.name}.png"
        with mkdocs_gen_files.open(f"reference/{name}", "wb") as file:
            file.write(picture_of(spec))
        print(f"![{spec.id} after {STEPS} steps: robot, estimate, odometry and waypoint]({name}){{ width=24% }}", file=page)
    print("\n::: turtlebot_gym.envs.navigation.NavigationEnv\n", file=page)
    print("::: turtlebot_gym.envs.navigation_vector.NavigationVectorEnv\n", file=page)
    print("::: turtlebot_gym.envs.rooms.RoomsEnv\n", file=page)
    print("::: turtlebot_gym.envs.rooms_vector.RoomsVectorEnv\n", file=page)

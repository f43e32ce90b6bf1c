"""The environments' pages: what is registered, a moving picture of each, and the environments' own docstrings."""

import io
from typing import NamedTuple

import gymnasium as gym
import mkdocs_gen_files
from driving import drawn_with, driven, save_gif, spread
from gymnasium.envs.registration import EnvSpec
from PIL import Image

from turtlebot_gym.envs.colours import LIGHT

PAGES, RATE, WIDTH = 42, 8, 512
"""Number of pictures, pictures per second, and width of each, pixels."""


class Shown(NamedTuple):
    """What a moving picture shows."""

    policy: str
    steps: int
    seed: int
    goal: str


SHOWN = {
    "TurtleBotNav": Shown("bearing", 300, 0, "a point: within 0.15 m, whatever the heading"),
    "TurtleBotPose": Shown("ppo-pose", 300, 2, "a pose: within 0.15 m and 0.2 rad, the sector, and not spinning"),
    "TurtleBotSquare": Shown("corner", 600, 0, "the corners of a square in turn, each within 0.3 m"),
    "TurtleBotRooms": Shown("vfh", 600, 1, "a point in a room, by the beams of a LiDAR"),
    "TurtleBotMissions": Shown("vfh", 400, 1, "points in a room in turn, for ten minutes"),
}


def picture_of(spec: EnvSpec, shown: Shown) -> bytes:
    """Return a moving picture of an environment at work, GIF."""
    pages = spread(driven(spec.id, shown.policy, shown.seed, steps=shown.steps), PAGES, hold=RATE)
    smaller = [page.resize((WIDTH, WIDTH * page.height // page.width), Image.Resampling.LANCZOS) for page in pages]
    gif = io.BytesIO()
    save_gif(gif, smaller, {LIGHT.paper: drawn_with(LIGHT)}, rate=RATE)
    return gif.getvalue()


specs = [spec for spec in gym.registry.values() if spec.namespace == "turtlebot_gym"]
with mkdocs_gen_files.open("reference/environments.md", "w") as page:
    print("# Environments\n\n| id | goal | steps at most |\n|---|---|---|", file=page)
    for spec in specs:
        print(f"| [`{spec.id}`]({spec.name}.md) | {SHOWN[spec.name].goal} | {spec.max_episode_steps} |", file=page)
    print('\n<div class="pictures" markdown>\n', file=page)
    for spec in specs:
        shown = SHOWN[spec.name]
        with mkdocs_gen_files.open(f"reference/{spec.name}.gif", "wb") as file:
            file.write(picture_of(spec, shown))
        words = f"{spec.id} driven by {shown.policy}: robot, estimate, odometry and goal"
        print(f'![{words}]({spec.name}.gif "{spec.name}-v0, policy {shown.policy}, seed {shown.seed}")\n', file=page)
    print("</div>\n\nWith `gym.make` each is a scalar environment:\n", file=page)
    print("::: turtlebot_gym.envs.navigation.NavigationEnv\n", file=page)
    print("::: turtlebot_gym.systems.options.Options\n", file=page)
with mkdocs_gen_files.open("reference/vector_environments.md", "w") as page:
    print(
        "# Vector environments\n\nThe same ids through `gym.make_vec(ID, num_envs=N)`, compiled and with N rows.\n", file=page
    )
    print("::: turtlebot_gym.envs.navigation_vector.NavigationVectorEnv\n", file=page)
    print("::: turtlebot_gym.envs.navigation_device.NavigationDeviceEnv\n", file=page)

"""Pictures of a drive, one a step, as an environment draws them, and files of moving pictures."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import IO, Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageColor

import turtlebot_gym  # noqa: F401  # registers the ids
from turtlebot_gym.envs.colours import Colours
from turtlebot_gym.plotting import PURPLE, SKY_BLUE
from turtlebot_gym_agents.evaluation.evaluate import driver_of
from turtlebot_gym_agents.policies import PolicyWithMemory

BLENDS = 4
"""Mixtures of each colour with the paper, which smooth its edges."""
SAME = 12.0
"""Least difference of a colour from the paper, of 255: what hardly differs would replace the paper."""


def driven(
    id: str, policy: str, seed: int, *, steps: int = 10_000, dark: bool = False, **options: Any
) -> list[NDArray[np.uint8]]:
    """Return the pictures of an episode's first steps, shape (704, 640, 3) each.

    Args:
        id: Id of an environment of this package.
        policy: Name of a policy.
        seed: Seed of the episode.
        steps: Most steps.
        dark: Whether the paper is dark.
        **options: Arguments of the environment.
    """
    env = gym.make(id, render_mode="rgb_array", **options)
    bare: Any = env.unwrapped
    bare.dark = dark
    driver = driver_of(policy, env)
    observation, _ = env.reset(seed=seed)
    if isinstance(driver, PolicyWithMemory):
        driver.reset(np.ones(1, np.bool_))
    pictures: list[Any] = [env.render()]
    for _ in range(steps):
        observation, _, terminated, truncated, _ = env.step(driver(observation[None])[0])
        pictures.append(env.render())
        if terminated or truncated:
            break
    env.close()
    return pictures


def spread(pictures: list[NDArray[np.uint8]], number: int, *, hold: int) -> list[Image.Image]:
    """Return a number of pictures, evenly spread over all of them; the last one stands for ``hold`` pictures."""
    chosen = np.linspace(0, len(pictures) - 1, number - hold).round().astype(int).tolist()
    return [Image.fromarray(pictures[at]) for at in chosen + chosen[-1:] * hold]


def drawn_with(colours: Colours) -> tuple[str, ...]:
    """Return the colours of an environment's pictures."""
    return (*colours, SKY_BLUE, PURPLE)


def save_gif(file: Path | IO[bytes], pages: list[Image.Image], inks: Mapping[str, Iterable[str]], *, rate: int) -> None:
    """Write a moving picture that repeats, with one palette for all its pages.

    Args:
        file: File to write.
        pages: Its pictures.
        inks: Colours that are drawn on each paper.
        rate: Pictures per second.
    """
    papers = {paper: np.array(ImageColor.getrgb(paper)) for paper in inks}
    shares = np.linspace(1.0, 0.0, BLENDS, endpoint=False)
    mixed = [
        share * np.array(ImageColor.getrgb(ink)) + (1.0 - share) * papers[paper]
        for paper, drawn in inks.items()
        for ink in drawn
        for share in shares
    ]
    apart = [one for one in mixed if min(np.abs(one - paper).max() for paper in papers.values()) > SAME]
    palette = Image.new("P", (1, 1))
    palette.putpalette(np.round([*apart, *papers.values()]).astype(int).ravel().tolist())
    first, *rest = [page.quantize(palette=palette, dither=Image.Dither.NONE) for page in pages]
    first.save(file, format="GIF", save_all=True, append_images=rest, duration=1000 // rate, loop=0, optimize=True, disposal=1)

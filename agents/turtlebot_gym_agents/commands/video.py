"""Video of an episode: a GIF, or an MP4 for longer ones."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from turtlebot_gym.envs.rendering import HEADER, SIDE
from turtlebot_gym.files import replacing
from turtlebot_gym.validation import POSITIVE, choose, whole
from turtlebot_gym_agents.evaluation.evaluate import NAV, driver_of, require_known
from turtlebot_gym_agents.outputs import require_file
from turtlebot_gym_agents.policies import Policy, PolicyWithMemory
from turtlebot_gym_agents.policies.fit import parameters_of

MIN_WIDTH = 160
"""Least width of a frame, pixels: narrower legends are illegible."""
HOLD = 1.5
"""Time for which the last frame stays, s."""


class _Video(NamedTuple):
    size: tuple[int, int]
    """Width and height, pixels."""
    duration: float
    """Playing time, s."""
    time: float
    """Length of the episode, s."""
    success: bool
    """Whether the episode ended in success."""


def record(
    policy: str | Policy,
    path: str | Path,
    *,
    env: str = NAV,
    seed: int = 0,
    speed: float = 4.0,
    fps: int = 20,
    width: int = SIDE,
    dark: bool = False,
    progress: Callable[[int, int], None] = lambda steps, limit: None,
    allow_mismatch: bool = False,
    **options: Any,
) -> _Video:
    """Drive an episode and write it as a video: the first episode of `evaluate` with the same arguments.

    Args:
        policy: A name for `turtlebot_gym_agents.make_policy`, or a policy.
        path: The file, ``*.gif`` or ``*.mp4``.
        env: The id of an environment of this package.
        seed: Seed of the episode.
        speed: Playback speed, as a multiple of real time.
        fps: Frames per second.
        width: Width of the frames, pixels.
        dark: Whether the paper is dark.
        progress: Called with the number of steps so far and the largest possible number.
        allow_mismatch: Whether a policy made for another task, observation, robot or rate may drive.
        **options: The environment's, see `turtlebot_gym.Options`.

    Raises:
        ValueError: If an argument is unknown or out of its range.
        ImportError: If the file is an MP4 and imageio-ffmpeg is missing.
    """
    path = Path(path)
    write = choose(f"The suffix of {path}", path.suffix.lower(), {".gif": _write_gif, ".mp4": _write_mp4})
    require_known(env, seed)
    require_file(path)
    POSITIVE.check("speed", speed)
    whole("fps", fps, 1)
    if not (isinstance(width, int) and MIN_WIDTH <= width <= SIDE and width % 2 == 0):
        raise ValueError(f"width must be an even whole number from {MIN_WIDTH} to {SIDE}, got {width!r}.")

    world = gym.make(env, render_mode="rgb_array", disable_env_checker=True, **options)
    assert world.spec is not None
    world.unwrapped.dark = dark  # pyright: ignore[reportAttributeAccessIssue]
    limit, dt = world.spec.max_episode_steps or 0, parameters_of(world).dt
    driver = driver_of(policy, world, allow_mismatch=allow_mismatch)
    size = width, 2 * round(0.5 * width * (HEADER + SIDE) / SIDE)  # even, which an MP4 needs
    frames, steps, success = 0, 0, False

    def play() -> Iterator[Image.Image]:
        """Yield the picture of each frame."""
        nonlocal frames, steps, success
        for steps, (picture, info, ended) in enumerate(_drive(world, driver, seed)):
            progress(steps, limit)
            success = bool(info["is_success"])
            image = Image.fromarray(picture).resize(size)
            until = (steps + 1) * dt + (HOLD * speed if ended else 0.0)
            while frames * speed / fps < until - 1e-9:
                frames += 1
                yield image

    try:
        with replacing(path) as beside:
            write(beside, play(), fps)
    finally:
        world.close()
    return _Video(size=size, duration=frames / fps, time=steps * dt, success=success)


def _drive(env: gym.Env, policy: Policy, seed: int) -> Iterator[tuple[NDArray[np.uint8], dict[str, Any], bool]]:
    """Yield picture, info and whether the episode has ended, at the start and after each step.

    All steps are drawn, even those not shown, since trails consist of drawn steps.
    """
    observation, info = env.reset(seed=seed)
    if isinstance(policy, PolicyWithMemory):
        policy.reset(np.ones(1, np.bool_))
    ended = False
    while True:
        picture: Any = env.render()
        yield picture, info, ended
        if ended:
            return
        (action,) = policy(observation[None])  # a batch of one, as in an evaluation
        observation, _, terminated, truncated, info = env.step(action)
        ended = terminated or truncated


def _write_gif(path: Path, frames: Iterator[Image.Image], fps: int) -> None:
    """Write frames with the first one's palette: its legend holds all colours."""
    if fps > 50 or 100 % fps != 0:
        raise ValueError(f"fps of a GIF must be one of 1, 2, 4, 5, 10, 20, 25, 50 (frames last whole 1/100 s), got {fps}.")
    first = next(frames)
    palette = _palette(first)
    drawn = (frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in itertools.chain([first], frames))
    next(drawn).save(path, "GIF", save_all=True, append_images=drawn, duration=1000 // fps, loop=0, optimize=True)


def _palette(picture: Image.Image) -> Image.Image:
    """Return the colours of a picture, most frequent first, without those that look like an earlier one.

    Pillow finds the nearest colour on a grid of 4 levels, so colours this far apart are preserved.
    """
    colors: list[tuple[int, int, int]] = []
    counted: Any = picture.getcolors(picture.width * picture.height)
    for _, color in sorted(counted, reverse=True):
        if all(max(abs(a - b) for a, b in zip(color, other, strict=True)) > 8 for other in colors):
            colors.append(color)
    palette = Image.new("P", (1, 1))
    palette.putpalette(list(itertools.chain(*colors[:255])))  # one of the 256 is for unchanged pixels
    return palette


def _write_mp4(path: Path, frames: Iterator[Image.Image], fps: int) -> None:
    """Write frames as H.264, which every browser plays."""
    try:
        import imageio_ffmpeg
    except ImportError as error:
        raise ImportError("An MP4 needs imageio-ffmpeg: pip install imageio-ffmpeg. A GIF does not.") from error
    first = next(frames)
    writer = imageio_ffmpeg.write_frames(
        str(path),
        first.size,
        fps=fps,
        codec="libx264",
        quality=6,
        macro_block_size=2,
        output_params=["-movflags", "+faststart", "-f", "mp4"],
    )
    writer.send(None)
    try:
        for frame in itertools.chain([first], frames):
            writer.send(frame.tobytes())
    finally:
        writer.close()

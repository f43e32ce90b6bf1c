"""Pictures of a batch's first rows, for both environments."""

from __future__ import annotations

from typing import TYPE_CHECKING

import gymnasium as gym
import numpy as np
from gymnasium.error import ResetNeeded
from numpy.typing import NDArray

from turtlebot_gym.compiled.batch import Batch

if TYPE_CHECKING:
    from turtlebot_gym.envs.rendering import Renderer


class Pictures:
    """Draws the first environments of a batch, each with the trails of its episode and its room if it has one.

    Args:
        batch: The environments; their parameters must not change while they are drawn.
        mode: "human" for windows, "rgb_array" for arrays, which need no display; None for no pictures.
        rows: Number of environments to draw.
        fps: Pictures per second.
    """

    def __init__(self, batch: Batch, mode: str | None, *, rows: int, fps: float) -> None:
        self._batch, self._mode, self._rows, self._fps = batch, mode, rows, fps
        self._renderers: list[Renderer] = []

    def begin(self, mask: NDArray[np.bool_]) -> None:
        """Clear the trails where the mask, shape (N,), is true, because an episode begins there."""
        for row, renderer in enumerate(self._renderers):
            if mask[row]:
                renderer.reset()

    def render(self, is_begun: bool) -> tuple[NDArray[np.uint8], ...] | None:
        """Return pictures as arrays, None where windows show them; warn where neither was asked for."""
        if self._mode is None:
            gym.logger.warn("render() needs a render_mode: make the environment with render_mode='rgb_array'.")
            return None
        if not is_begun:
            raise ResetNeeded("Call reset() before render().")
        return self.draw() if self._mode == "rgb_array" else None

    def draw(self) -> tuple[NDArray[np.uint8], ...]:
        """Return a picture of each environment, (height, width, 3); an empty tuple if windows show them.

        Raises:
            DependencyNotInstalled: If pygame is missing.
        """
        if not self._renderers:
            from turtlebot_gym.envs.rendering import Renderer  # pygame is slow to import, and most runs draw nothing

            windows = self._mode == "human"
            self._renderers = [Renderer(self._batch, row, windows=windows, fps=self._fps) for row in range(self._rows)]
        pictures = [renderer.draw(self._batch.world(row)) for row, renderer in enumerate(self._renderers)]
        return tuple(picture for picture in pictures if picture is not None)

    def close(self) -> None:
        for renderer in self._renderers:
            renderer.close()
        self._renderers = []

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
        mode: "rgb_array", or None for no pictures.
        rows: Number of environments to draw.
    """

    def __init__(self, batch: Batch, mode: str | None, rows: int) -> None:
        self._batch, self._mode, self._rows = batch, mode, rows
        self._renderers: list[Renderer] = []

    def begin(self, mask: NDArray[np.bool_]) -> None:
        """Clear the trails where the mask, shape (N,), is true, because an episode begins there."""
        for renderer, begins in zip(self._renderers, mask, strict=False):
            if begins:
                renderer.reset()

    def render(self, is_begun: bool) -> tuple[NDArray[np.uint8], ...] | None:
        """Return a picture of each environment, (height, width, 3); None, with a warning, where none was asked for."""
        if self._mode is None:
            gym.logger.warn("render() needs a render_mode: make the environment with render_mode='rgb_array'.")
            return None
        if not is_begun:
            raise ResetNeeded("Call reset() before render().")
        if not self._renderers:
            from turtlebot_gym.envs.rendering import Renderer  # matplotlib is slow to import, and most runs draw nothing

            self._renderers = [Renderer(self._batch, row) for row in range(self._rows)]
        return tuple(renderer.draw(self._batch.world(row)) for row, renderer in enumerate(self._renderers))

    def forget(self) -> None:
        """Look for robots and rooms anew at the next picture."""
        self._renderers = []

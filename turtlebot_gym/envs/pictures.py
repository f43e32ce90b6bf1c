"""Pictures of a batch's first rows, for both environments."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy as np
from gymnasium.error import ResetNeeded
from numpy.typing import NDArray

from turtlebot_gym.compiled.batch import Batch
from turtlebot_gym.rooms.scene import scene_at
from turtlebot_gym.systems.scans import TrackedScene
from turtlebot_gym.values import Pose

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

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_renderers": []}  # a window cannot be pickled

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
            self._renderers = [self._make_renderer(row) for row in range(self._rows)]
        pictures = [renderer.draw(self._batch.world(row)) for row, renderer in enumerate(self._renderers)]
        return tuple(picture for picture in pictures if picture is not None)

    def _make_renderer(self, row: int) -> Renderer:
        from turtlebot_gym.envs.rendering import Renderer  # pygame is slow to import, and most runs draw nothing

        batch, p = self._batch, self._batch.parameters_of(row)
        scenes: Any = batch.scenes
        return Renderer(
            p,
            windows=self._mode == "human",
            waypoints=() if p.task.random else [Pose(*pose) for pose in batch.waypoints[row].tolist()],
            scene=scene_at(scenes, row) if p.room else None,
            tracks=scenes.tracker.seen[row] if isinstance(scenes, TrackedScene) else None,
            fps=self._fps,
        )

    def close(self) -> None:
        for renderer in self._renderers:
            renderer.close()
        self._renderers = []

"""Pictures of a batch's first rows, for both environments."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.compiled.batch import Batch
from turtlebot_gym.rooms.scene import scene_at
from turtlebot_gym.systems.tracking import TrackedScene
from turtlebot_gym.values import Pose

if TYPE_CHECKING:
    from turtlebot_gym.envs.rendering import Renderer

_LARGE = 4
"""Most pictures at full size; if there are more, each has half the height and width."""


class Pictures:
    """Draws the first environments of a batch, each with the trails of its episode and its room if it has one.

    Args:
        batch: The environments; their parameters must not change while they are drawn.
        rows: Number of environments to draw.
        fps: Pictures per second.
        windows: Whether windows show them; if false, no display is needed.
    """

    def __init__(self, batch: Batch, *, rows: int, fps: float, windows: bool = False) -> None:
        self._batch, self._rows, self._fps = batch, rows, fps
        self._mode: Literal["human", "rgb_array"] = "human" if windows else "rgb_array"
        self._renderers: list[Renderer] = []

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_renderers": []}  # a window cannot be pickled

    def begin(self, mask: NDArray[np.bool_]) -> None:
        """Clear the trails where the mask, shape (N,), is true, because an episode begins there."""
        for renderer, begins in zip(self._renderers, mask.tolist() if self._renderers else (), strict=False):
            if begins:
                renderer.reset()

    def draw(self, *, dark: bool) -> tuple[NDArray[np.uint8], ...]:
        """Return a picture of each environment, (height, width, 3), on light paper or, from the first picture on, on dark.

        If windows show them, the tuple is empty.

        Raises:
            DependencyNotInstalled: If pygame is missing.
        """
        if not self._renderers:
            self._renderers = [self._make_renderer(row, dark) for row in range(self._rows)]
        pictures = [renderer.draw(self._batch.world(row)) for row, renderer in enumerate(self._renderers)]
        return tuple(self._sized(picture) for picture in pictures if picture is not None)

    def _make_renderer(self, row: int, dark: bool) -> Renderer:
        batch, p = self._batch, self._batch.parameters_of(row)
        waypoints = None if p.task.random else [Pose(*pose) for pose in batch.waypoints[row].tolist()]
        options = {"robot": p.robot, "task": p.task, "waypoints": waypoints, "dt": p.dt, "fps": self._fps, "dark": dark}
        if p.room:  # pygame is slow to import, and most runs draw nothing
            from turtlebot_gym.envs.rendering_rooms import RoomRenderer

            scene, scenes = scene_at(batch.scenes, row), batch.scenes
            tracks = scenes.tracker.seen[row] if isinstance(scenes, TrackedScene) else None
            return RoomRenderer(self._mode, scene=scene, lidar=p.room.lidar, tracks=tracks, **options)
        from turtlebot_gym.envs.rendering import Renderer

        return Renderer(self._mode, **options)

    def _sized(self, picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Return a picture, averaged over 2 x 2 pixels if there are many."""
        if self._rows <= _LARGE:
            return picture
        height, width, colours = picture.shape
        return picture.reshape(height // 2, 2, width // 2, 2, colours).mean(axis=(1, 3)).round().astype(np.uint8)

    def close(self) -> None:
        for renderer in self._renderers:
            renderer.close()
        self._renderers = []

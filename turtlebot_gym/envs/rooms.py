"""The scalar environment of rooms under a name of its own."""

from __future__ import annotations

from typing import Any

from turtlebot_gym.envs.navigation import NavigationEnv


class RoomsEnv(NavigationEnv):
    """`NavigationEnv` in rooms, as ``gym.make("turtlebot_gym/TurtleBotRooms-v0")`` makes it.

    Args:
        **options: See `NavigationEnv`.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__(**{"task": "room", **options})

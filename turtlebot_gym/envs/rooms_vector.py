"""The vector environment of rooms under a name of its own."""

from __future__ import annotations

from typing import Any

from turtlebot_gym.envs.navigation_vector import NavigationVectorEnv


class RoomsVectorEnv(NavigationVectorEnv):
    """`NavigationVectorEnv` in rooms, as ``gym.make_vec("turtlebot_gym/TurtleBotRooms-v0")`` makes it.

    Args:
        num_envs: Number of environments.
        **options: See `NavigationVectorEnv`.
    """

    def __init__(self, num_envs: int = 1, **options: Any) -> None:
        super().__init__(num_envs, **{"task": "room", **options})

"""Short names of the package's environments, such as ``nav``; importing this module needs only Python."""

from __future__ import annotations

SHORT = {name.lower(): f"turtlebot_gym/TurtleBot{name}-v0" for name in ("Nav", "Pose", "Square", "Rooms", "Missions")}
"""Ids of the package's environments by their short names."""


def environment_id(name: str) -> str:
    """Return the id that a short name stands for, in any case: ``nav`` and ``Nav`` are ``turtlebot_gym/TurtleBotNav-v0``.

    Every other text is returned as it is; whether an environment is registered under that id is not checked here.
    """
    return SHORT.get(name.lower(), name) if isinstance(name, str) else name

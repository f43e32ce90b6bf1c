"""Ids of environments by short names, such as ``nav``, and their arguments; importing this module needs only Python."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

SHORT = {name.lower(): f"turtlebot_gym/TurtleBot{name}-v0" for name in ("Nav", "Pose", "Square", "Rooms", "Missions")}
"""Ids of the package's environments by their short names."""


def environment_id(name: str | None, options: Mapping[str, Any] = {}) -> str:
    """Return the id that a short name stands for, in any case: ``nav`` and ``Nav`` are ``turtlebot_gym/TurtleBotNav-v0``.

    None stands for rooms where options name a world or a LiDAR, otherwise for nav. Every other text is returned as it is;
    whether an environment is registered under that id is not checked here.
    """
    if name is None:
        name = "nav" if options.get("world") is None and options.get("lidar") is None else "rooms"
    return SHORT.get(name.lower(), name) if isinstance(name, str) else name


def arguments_of(options: Mapping[str, Any]) -> dict[str, Any]:
    """Return options as keyword arguments of `gymnasium.make_vec`; no task is the id's, and one may set the limit of steps."""
    task = options.get("task")
    given = {name: value for name, value in options.items() if name != "task" or task is not None}
    if isinstance(task, Mapping) and "max_steps" in task and "max_episode_steps" not in options:
        return {**given, "max_episode_steps": task["max_steps"]}
    return given


def brought_by(env: str) -> dict[str, Any]:
    """Return the options that an id brings, those that it was registered with: they count where none are given."""
    from gymnasium.envs.registration import registry

    import turtlebot_gym  # noqa: F401  # registers the package's own

    return dict(registry[env].kwargs) if env in registry else {}

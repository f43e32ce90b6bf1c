"""Checks that a policy fits the robot, rate, task and observation it is used with."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

from turtlebot_gym import ROBOTS, Robot, make_robot
from turtlebot_gym.config import build, short_repr
from turtlebot_gym.files import is_file
from turtlebot_gym.observations import SCAN
from turtlebot_gym.systems import Parameters
from turtlebot_gym_agents.policies.policy import terms_of
from turtlebot_gym_agents.provenance import plain

ROOMS, MISSIONS = "turtlebot_gym/TurtleBotRooms-v0", "turtlebot_gym/TurtleBotMissions-v0"
"""A mission is the task of rooms, goal after goal."""
OPEN = tuple(f"turtlebot_gym/TurtleBot{task}-v0" for task in ("Nav", "Pose", "Square"))
"""Environments without obstacles."""
ANYWAY = "--allow-mismatch (allow_mismatch=True) drives it anyway."


class Mismatch(ValueError):
    """A policy was made for another robot, rate, task or observation."""


def describe_robot(robot: str | Robot) -> dict[str, Any]:
    """Return the description of a robot in a policy's file; one that equals a preset has its name."""
    made = make_robot(robot)
    preset = next((name for name, limits in ROBOTS.items() if limits == made), "custom")
    name = Path(robot).stem if is_file(robot) else robot if isinstance(robot, str) else preset
    limits = {item.name: getattr(made, item.name) for item in fields(made) if item.metadata.get("number", True)}
    return plain({"name": name, **limits})


def robot_of(described: Mapping[str, Any]) -> Robot:
    """Return the robot of a description by `describe_robot`."""
    limits = {name: math.inf if limit is None else limit for name, limit in described.items() if name != "name"}
    return build(Robot, limits, "robot")


def parameters_of(envs: Any) -> Parameters:
    """Return the parameters of an environment or a vector environment; those of the first one if they differ."""
    parameters = envs.unwrapped.parameters
    return parameters if isinstance(parameters, Parameters) else parameters[0]


def require_task(policy: object, name: str, env: str, observation: str) -> None:
    """Refuse a policy, of a name in the message, whose card names another task, or another pose that the robot observes."""
    card: Any = getattr(policy, "card", None)
    same = {MISSIONS: ROOMS}
    if card is not None and (same.get(card.env, card.env), card.observation) != (same.get(env, env), observation):
        raise Mismatch(
            f"{name}: made for {card.env} and observation {card.observation!r}, asked for {env} and {observation!r}; {ANYWAY}"
        )


def require_terms(policy: object, name: str, env: str) -> None:
    """Refuse a policy, of a name in the message, that cannot read the observations of an environment of this package."""
    names, card = {term.name for term in terms_of(policy) or ()}, getattr(policy, "card", None)
    if SCAN.name in names and env in OPEN:
        raise ValueError(f"{name}: it steers by a LiDAR, which {env} does not have: choose --env {ROOMS}.")
    if card is not None and card.env in OPEN and env in (ROOMS, MISSIONS):
        raise ValueError(f"{name}: it was trained without a LiDAR's beams, which {env} shows: choose --env {card.env}.")


def require_fit(
    path: str | Path, made_for: Mapping[str, Any], made_dt: float, robot: str | Robot | None, dt: float | None
) -> None:
    """Refuse a policy that was made for another robot, by its description, or another rate; None skips a comparison."""
    wanted = made_for if robot is None else describe_robot(robot)
    others = [name for name, limit in wanted.items() if name not in ("name", "radius") and limit != made_for.get(name)]
    period = made_dt if dt is None else dt
    if others or abs(period - made_dt) > 1e-9:
        details = "; ".join(f"{name} {_shown(made_for.get(name))} there, {_shown(wanted[name])} here" for name in others)
        raise Mismatch(
            f"{path}: made for {1.0 / made_dt:g} Hz {_shown(made_for.get('name'))}, asked for {1.0 / period:g} Hz "
            f"{wanted.get('name')}{f' ({details})' if others else ''}."
        )


def _shown(value: Any) -> str:
    """Return a value of a card for a message: text without quotes, on one line."""
    return " ".join(value.split())[:100] if isinstance(value, str) else short_repr(value)

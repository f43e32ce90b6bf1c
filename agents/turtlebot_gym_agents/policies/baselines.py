"""Baselines by name, and JSON files of baselines with tuned numbers, which hold no code."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from turtlebot_gym import OBSERVATION_LAYOUT, Robot
from turtlebot_gym.files import load
from turtlebot_gym.validation import choose
from turtlebot_gym_agents.policies.fit import require_fit, robot_of
from turtlebot_gym_agents.policies.geometric import (
    Baseline,
    BearingPolicy,
    CornerPolicy,
    PolarPolicy,
    ProportionalPolicy,
    RotateDriveRotatePolicy,
)
from turtlebot_gym_agents.policies.planner import PlannerPolicy
from turtlebot_gym_agents.policies.policy import Policy, layout_of
from turtlebot_gym_agents.policies.reactive import DynamicWindowPolicy, FollowTheGapPolicy, VectorFieldHistogramPolicy

FORMAT = "turtlebot-gym-baseline/1"

POLICIES: dict[str, type[Baseline]] = {
    "proportional": ProportionalPolicy,
    "bearing": BearingPolicy,
    "corner": CornerPolicy,
    "polar": PolarPolicy,
    "rotate-drive-rotate": RotateDriveRotatePolicy,
    "vfh": VectorFieldHistogramPolicy,
    "gap": FollowTheGapPolicy,
    "dwa": DynamicWindowPolicy,
    "planner": PlannerPolicy,
}
"""Baselines by name; the last four are for rooms."""


def layout_of_baseline(name: str) -> int:
    """Return the observation layout of a baseline; baselines for open ground also drive in rooms."""
    return layout_of(choose("policy", name, POLICIES)) or OBSERVATION_LAYOUT


def default_numbers(name: str) -> dict[str, float]:
    """Return the default values of a baseline's tunable numbers."""
    kind = choose("policy", name, POLICIES)
    return {number: kind.__dataclass_fields__[number].default for number in kind.ranges()}


def load_baseline(path: str | Path, *, robot: str | Robot | None = None, dt: float | None = None) -> Policy:
    """Load a baseline from a file written by `turtlebot-gym tune-baseline`.

    Args:
        path: The file.
        robot: The robot to drive; None skips the comparison.
        dt: The control interval, s; None skips the comparison.

    Raises:
        ValueError: If the file is not a tuned baseline, or was tuned for another robot, rate or observation layout.
    """
    try:
        content: Any = load(path)
        made_as = {"format": content["format"], "layout": content["layout"]}
        made_for, made_dt, name, numbers = dict(content["robot"]), content["dt"], content["policy"], dict(content["numbers"])
        kind = choose("policy", name, POLICIES)
        unknown = sorted(set(numbers) - set(kind.ranges()))
        if unknown:
            raise ValueError(f"{name} has no numbers {', '.join(unknown)}")
        policy = kind(robot_of(made_for), made_dt, **numbers)
    except (ValueError, KeyError, TypeError, AttributeError) as error:  # also if the file is not JSON or not text
        raise ValueError(f"{path} is not a tuned baseline: {type(error).__name__}: {str(error).rstrip('.')}.") from error
    ours = {"format": FORMAT, "layout": layout_of_baseline(name)}
    if made_as != ours:
        raise ValueError(f"{path}: made as {made_as}, but this version reads {ours}.")
    require_fit(path, made_for, made_dt, robot, dt)
    return policy

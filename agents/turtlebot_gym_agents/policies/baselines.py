"""Baselines by name, and JSON files of baselines with tuned numbers, which hold no code."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from turtlebot_gym import Robot
from turtlebot_gym.files import load
from turtlebot_gym.validation import choose, short_repr
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
from turtlebot_gym_agents.policies.policy import Policy
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


def default_numbers(name: str) -> dict[str, float]:
    """Return the default values of a baseline's tunable numbers."""
    kind = choose("policy", name, POLICIES)
    return {number: kind.__dataclass_fields__[number].default for number in kind.ranges()}


def load_baseline(path: str | Path, *, robot: str | Robot | None = None, dt: float | None = None) -> Policy:
    """Load a baseline from a file written by `benchmarks/tune_baseline.py`.

    Args:
        path: The file.
        robot: The robot to drive; None skips the comparison.
        dt: The control interval, s; None skips the comparison.

    Raises:
        ValueError: If the file is not a tuned baseline, or was tuned for another robot or rate.
    """
    try:
        content: Any = load(path)
        form = content["format"]
        made_for, made_dt, name, numbers = dict(content["robot"]), content["dt"], content["policy"], dict(content["numbers"])
        kind = choose("policy", name, POLICIES)
        unknown = sorted(set(numbers) - set(kind.ranges()))
        if unknown:
            raise ValueError(f"{name} has no numbers {', '.join(unknown)}")
        policy = kind(robot_of(made_for), made_dt, **numbers)
    except (ValueError, KeyError, TypeError, AttributeError) as error:  # also if the file is not JSON or not text
        raise ValueError(f"{path} is not a tuned baseline: {type(error).__name__}: {str(error).rstrip('.')}.") from error
    if form != FORMAT:
        raise ValueError(f"{path}: made as {short_repr(form)}, but this version reads {FORMAT!r}.")
    require_fit(path, made_for, made_dt, robot, dt)
    return policy

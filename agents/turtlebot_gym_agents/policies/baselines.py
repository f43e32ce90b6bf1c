"""Baselines by name, and files of baselines with other numbers, which hold no code.

A file written by hand is YAML with the baseline's name and some of its fields; others keep their defaults::

    policy: proportional
    kv: 0.8
    komega: 2.0
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from turtlebot_gym import Robot, files
from turtlebot_gym.config import build, choose, short_repr
from turtlebot_gym.files import load
from turtlebot_gym.parameters import REFERENCE_PERIOD
from turtlebot_gym_agents.policies.fit import require_fit, robot_of
from turtlebot_gym_agents.policies.geometric import (
    Baseline,
    BearingPolicy,
    CornerPolicy,
    ProportionalPolicy,
)
from turtlebot_gym_agents.policies.planner import PlannerPolicy
from turtlebot_gym_agents.policies.policy import Policy
from turtlebot_gym_agents.policies.reactive import VectorFieldHistogramPolicy

SUFFIXES = (".json", *files.SUFFIXES)
"""Ends of the names of files of baselines."""
FORMAT = "turtlebot-gym-baseline/1"

POLICIES: dict[str, type[Baseline]] = {
    "proportional": ProportionalPolicy,
    "bearing": BearingPolicy,
    "corner": CornerPolicy,
    "vfh": VectorFieldHistogramPolicy,
    "planner": PlannerPolicy,
}
"""Baselines by name; the last two are for rooms."""


def default_numbers(name: str) -> dict[str, float]:
    """Return the default values of a baseline's tunable numbers."""
    kind = choose("policy", name, POLICIES)
    return {number: kind.__dataclass_fields__[number].default for number in kind.ranges()}


def load_baseline(path: str | Path, *, robot: str | Robot | None = None, dt: float | None = None) -> Policy:
    """Load a baseline from a file: YAML of one's own, or JSON that `benchmarks/tune_baseline.py` wrote.

    Args:
        path: The file.
        robot: The robot to drive; None skips the comparison with the one of a tuned baseline.
        dt: The control interval, s; None skips the comparison.

    Raises:
        ValueError: If the file is no baseline, or was tuned for another robot or rate.
    """
    if str(path).endswith(files.SUFFIXES):
        return _read(path, "burger" if robot is None else robot, REFERENCE_PERIOD if dt is None else dt)
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


def _read(path: str | Path, robot: str | Robot, dt: float) -> Policy:
    """Return the baseline of a file of one's own."""
    try:
        content: Any = load(path)
    except OSError as error:
        raise ValueError(f"There is no policy file {str(path)!r}, or it cannot be read: {error.strerror}.") from error
    try:
        if not isinstance(content, dict) or "policy" not in content:
            raise ValueError("it must have the policy's name, such as policy: proportional, and fields of it, such as kv: 0.8.")
        numbers = dict(content)
        kind = choose("policy", numbers.pop("policy"), POLICIES)
        for field in {"robot", "dt"} & numbers.keys():
            raise ValueError(f"{field} must be left out: it is that of the environment or of the node.")
        return build(kind, {"robot": robot, "dt": dt, **numbers}, "policy")
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error

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
from turtlebot_gym.config import build, choose
from turtlebot_gym.files import load
from turtlebot_gym.parameters import REFERENCE_PERIOD
from turtlebot_gym_agents.policies.fit import Mismatch, require_fit, robot_of
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
    """Load a baseline from a file of tuned numbers.

    Args:
        path: The file.
        robot: The robot to drive; None skips the comparison with the one of a tuned baseline.
        dt: The control interval, s; None skips the comparison.

    Raises:
        ValueError: If the file is no baseline, or was tuned for another robot or rate.
    """
    try:
        content: Any = load(path)
        if not isinstance(content, dict) or "policy" not in content:
            raise ValueError("it must have the policy's name, such as policy: proportional, and fields of it, such as kv: 0.8.")
        kind = choose("policy", content["policy"], POLICIES)
        if content.get("format") == FORMAT:
            given = {"robot": robot_of(dict(content["robot"])), "dt": content["dt"]}
            policy = build(kind, {**given, **content["numbers"]}, "policy")
            require_fit(path, content["robot"], content["dt"], robot, dt)
            return policy
        for field in {"robot", "dt"} & content.keys():
            raise ValueError(f"{field} must be left out: it is that of the environment or of the node.")
        numbers = {name: number for name, number in content.items() if name != "policy"}
        given = {"robot": "burger" if robot is None else robot, "dt": REFERENCE_PERIOD if dt is None else dt}
        return build(kind, {**given, **numbers}, "policy")
    except Mismatch:
        raise
    except (ValueError, KeyError, TypeError, OSError) as error:
        raise ValueError(f"{path} is not a baseline: {' '.join(str(error).split())}") from error

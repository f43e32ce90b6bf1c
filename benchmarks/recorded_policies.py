"""Drive policies on the wheel odometry of recordings, beside other noises, with each filter.

The preset `recorded` says what recordings of real robots show, and `wheel` what one of them drifts. The ratio is the filter's
mean position error over that of the raw odometry. Nothing is trained here.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from rich.table import Table

from harness.study import Study, each, run
from turtlebot_gym_agents.evaluation.evaluate import evaluate

NAV, SQUARE = "turtlebot_gym/TurtleBotNav-v0", "turtlebot_gym/TurtleBotSquare-v0"
DRIVES: dict[str, dict[str, Any]] = {
    "bearing": {"env": NAV},
    "ppo-nav": {"env": NAV},
    "proportional": {"env": SQUARE, "robot": "tutorial", "switch": "time"},
    "ppo-square": {"env": SQUARE},
}
"""Policies, and where they drive."""
NOISES = ("tutorial", "documented", "wheel", "recorded")
KNOWING: dict[str, dict[str, Any]] = {
    **{name: {"filter": name} for name in ("gated", "calibrated")},
    "gyro": {"filter": "gyro", "imu": "calibrated"},
    "matched, fix localization": {"fix": "localization"},
}
"""Filters beside `matched`, and a sensor of the pose, all under `recorded`."""
FIGURES = ("success", "false_arrival", "estimate_position_mean", "odometry_position_mean", "estimate_heading_mean")


@dataclass(frozen=True, kw_only=True)
class Config(Study):
    """Drive policies on recorded wheels."""

    episodes: int = 400
    """Number of episodes of each case."""
    seed: int = 5_000_000
    """First seed."""


def cases() -> list[tuple[str, str, str, dict[str, Any]]]:
    """Return policy, noise, filter and options of each case."""
    found = [(policy, noise, "matched", {"noise": noise, **drive}) for policy, drive in DRIVES.items() for noise in NOISES]
    for name, options in KNOWING.items():
        found += [(policy, "recorded", name, {"noise": "recorded", "env": NAV, **options}) for policy in ("bearing", "ppo-nav")]
    return found


def measure(config: Config) -> tuple[dict[str, Any], list[Table]]:
    """Return the figures of each case, and their table."""
    table = Table("policy", "noise", "filter", "reached, %", "falsely, %", "filter, m", "odometry, m", "ratio")
    rows: list[dict[str, Any]] = []
    for policy, noise, filter, options in each(cases(), "cases"):
        summary = evaluate(policy, allow_mismatch=True, episodes=config.episodes, seed=config.seed, **options).summary()
        ratio = summary["estimate_position_mean"].value / summary["odometry_position_mean"].value
        figures = {name: summary[name] for name in FIGURES}
        rows.append({"policy": policy, "noise": noise, "filter": filter, **figures, "ratio": ratio})
        shares = (f"{100.0 * summary[name].value:.0f}" for name in FIGURES[:2])
        errors = (f"{summary[name].value:.3f}" for name in FIGURES[2:4])
        table.add_row(policy, noise, filter, *shares, *errors, f"{ratio:.2f}")
    return {"cases": rows}, [table]


if __name__ == "__main__":
    run(Config, measure, beside=__file__)

"""Drive missions on wheels, localized, and on the truth: ten minutes of goals in turn, in rooms of held-out seeds.

A goal counts as reached if the robot believes that it is there, and is.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from rich.table import Table

from harness.study import Study, each, run
from turtlebot_gym_agents.evaluation.evaluate import evaluate
from turtlebot_gym_agents.policies.fit import MISSIONS

BELIEFS: dict[str, dict[str, Any]] = {
    "wheels": {},
    "localizer": {"localizer": "match"},
    "truth": {"observation": "truth"},
}
"""What the policy knows of its pose."""
FIGURES = ("goals", "false_goals", "goals_an_hour", "lost", "collision")


@dataclass(frozen=True, kw_only=True)
class Config(Study):
    """Drive missions on several beliefs."""

    policy: tuple[str, ...] = ("vfh", "ppo-rooms")
    """As for `turtlebot-gym evaluate`."""
    world: tuple[str, ...] = ("office", "dense")
    """Worlds."""
    missions: int = 100
    """Number of missions of each policy, world and belief."""
    seed: int = 3_000_000
    """First seed of the rooms."""


def measure(config: Config) -> tuple[dict[str, Any], list[Table]]:
    """Return the results of each policy on each belief, and their table."""
    table = Table("world", "policy", "belief", "truly reached, %", "falsely, %", "an hour", "lost, %", "collided, %")
    rows: list[dict[str, Any]] = []
    cases = [(world, policy, belief) for world in config.world for policy in config.policy for belief in BELIEFS]
    for world, policy, belief in each(cases, "missions"):
        options = {"env": MISSIONS, "episodes": config.missions, "seed": config.seed, "world": world, "noise": "wheel"}
        summary = evaluate(policy, allow_mismatch=True, **options, **BELIEFS[belief]).summary()
        rows.append({"world": world, "policy": policy, "belief": belief, **{name: summary[name] for name in FIGURES}})
        goals, falsely, hourly, lost, collided = (summary[name] for name in FIGURES)
        shares = (f"{100.0 * share.value:.0f}" for share in (lost, collided))
        table.add_row(world, policy, belief, f"{goals:.0%}", f"{100.0 * falsely.value:.0f}", f"{hourly.value:.0f}", *shares)
    return {"missions": rows}, [table]


if __name__ == "__main__":
    run(Config, measure, beside=__file__)

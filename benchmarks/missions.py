"""Drive missions on wheels, localized, and on the truth: ten minutes of goals in turn, in rooms of held-out seeds.

A goal counts as reached if the robot believes that it is there, and is. `make bench-missions` runs it and writes
`missions.json`.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tyro
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from turtlebot_gym_agents.commands.console import print_tables
from turtlebot_gym_agents.evaluation.evaluate import Evaluation, evaluate
from turtlebot_gym_agents.policies.fit import MISSIONS
from turtlebot_gym_agents.provenance import settings_of, write_json

RESULTS = Path(__file__).with_suffix(".json")
BELIEFS: dict[str, dict[str, Any]] = {
    "wheels": {},
    "localizer": {"localizer": "match"},
    "truth": {"observation": "truth"},
}
"""What the policy knows of its pose."""
FIGURES = ("goals", "false_goals", "goals_an_hour", "lost", "collision")


@dataclass(frozen=True, kw_only=True)
class Config:
    """Drive missions on several beliefs."""

    policy: tuple[str, ...] = ("vfh", "ppo-rooms")
    """As for `turtlebot-gym evaluate`."""
    world: tuple[str, ...] = ("office", "dense")
    """Worlds."""
    missions: int = 100
    """Number of missions of each policy, world and belief."""
    seed: int = 3_000_000
    """First seed of the rooms."""
    json: Path | None = RESULTS
    """File for the results."""


def drive(policy: str, world: str, belief: str, config: Config) -> Evaluation:
    """Drive missions of a policy on a belief."""
    options = {"env": MISSIONS, "episodes": config.missions, "seed": config.seed, "world": world, "noise": "wheel"}
    return evaluate(policy, allow_mismatch=True, **options, **BELIEFS[belief])


def main() -> None:
    """Drive, print a table, and write the results."""
    config = tyro.cli(Config, description=__doc__)
    table = Table("world", "policy", "belief", "truly reached, %", "falsely, %", "an hour", "lost, %", "collided, %")
    rows: list[dict[str, Any]] = []
    cases = [(world, policy, belief) for world in config.world for policy in config.policy for belief in BELIEFS]
    with Progress(console=Console(stderr=True)) as progress:
        for world, policy, belief in progress.track(cases, description="missions"):
            summary = drive(policy, world, belief, config).summary()
            rows.append({"world": world, "policy": policy, "belief": belief, **{name: summary[name] for name in FIGURES}})
            goals, falsely, hourly, lost, collided = (summary[name] for name in FIGURES)
            shares = (f"{100.0 * share.value:.0f}" for share in (lost, collided))
            table.add_row(world, policy, belief, f"{goals:.0%}", f"{100.0 * falsely.value:.0f}", f"{hourly.value:.0f}", *shares)
    print_tables(table)
    if config.json is not None:
        write_json(config.json, {"missions": rows}, config=settings_of(config))


if __name__ == "__main__":
    main()

"""Drive missions on wheels, localized, and on the truth: ten minutes of goals in turn, in rooms of held-out seeds.

A goal counts as reached if the robot believes that it is there, and is.
"""

from __future__ import annotations

from itertools import product
from pathlib import Path
from typing import Any

import tyro

from harness.study import each, publish
from turtlebot_gym_agents.evaluation.evaluate import evaluate
from turtlebot_gym_agents.policies.fit import MISSIONS

BELIEFS: dict[str, dict[str, Any]] = {"wheels": {}, "localizer": {"localizer": "match"}, "truth": {"observation": "truth"}}
"""What the policy knows of its pose."""


def main(
    *,
    policy: tuple[str, ...] = ("vfh", "ppo-rooms"),
    world: tuple[str, ...] = ("office", "dense"),
    missions: int = 100,
    seed: int = 3_000_000,
    json: Path = Path("benchmarks/missions.json"),
) -> None:
    """Drive a number of missions for each policy, world and belief, from the first seed of the rooms on; print and write."""
    options, rows = {**locals()}, []
    for place, driver, belief in each([*product(world, policy, BELIEFS)], "missions"):
        given = {"env": MISSIONS, "episodes": missions, "seed": seed, "world": place, "noise": "wheel", **BELIEFS[belief]}
        summary = evaluate(driver, allow_mismatch=True, **given).summary()
        figures = {name: summary[name] for name in ("goals", "false_goals", "goals_an_hour", "lost")}
        rows.append({"world": place, "policy": driver, "belief": belief, **figures})
    publish(json, {"missions": rows}, options)


if __name__ == "__main__":
    tyro.cli(main, description=__doc__)

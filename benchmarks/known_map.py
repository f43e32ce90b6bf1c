"""Drive offices with the planner that finds its way by what it sees, and with one that begins with the localizer's map.

Both drive within the safety layer, in the same held-out rooms, on what the same localizer believes; the robot begins at a known
pose. `make bench-known-map` runs it and writes `known_map.json`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray
from rich.table import Table

from harness.study import Study, run
from turtlebot_gym_agents.evaluation import metrics
from turtlebot_gym_agents.evaluation.evaluate import drive
from turtlebot_gym_agents.policies.fit import ROOMS
from turtlebot_gym_agents.policies.planner import PlannerPolicy
from turtlebot_gym_agents.policies.protection import SafetyLayer


@dataclass(frozen=True, kw_only=True)
class Config(Study):
    """Drive with and without a map."""

    world: tuple[str, ...] = ("office", "cellular")
    """The rooms."""
    episodes: int = 300
    """Number of rooms of each world."""
    seed: int = 1_000_000
    """Their first seed."""


class Mapped:
    """The planner within the safety layer, which is given the localizer's map where an episode begins.

    Args:
        envs: The environments, with a localizer.
    """

    def __init__(self, envs: Any) -> None:
        self._envs, p = envs.unwrapped, envs.unwrapped.parameters
        self._planner = PlannerPolicy(p.robot, p.dt)
        self._layer = SafetyLayer(self._planner, p.robot, p.dt, noise=p.noise)
        self.keep = self._layer.keep

    def __call__(self, observations: NDArray[np.float32]) -> NDArray[np.float32]:
        return self._layer(observations)

    def reset(self, mask: NDArray[np.bool_]) -> None:
        self._layer.reset(mask)
        scenes, states, _ = self._envs.truth()
        for n in np.flatnonzero(mask):
            field, (x, y, cosine, sine, side) = scenes.memory.field[n], scenes.memory.field_frame[n]
            rows, columns = np.indices(field.shape)
            places = x + 1j * y + side * (columns + 0.5 + 1j * (rows + 0.5)) * (cosine + 1j * sine)
            seen = (places - states[n, 0] - 1j * states[n, 1]) * np.exp(-1j * states[n, 2])
            self._planner.know(n, seen[field < 0.0], seen[field >= 0.0])


def measure(config: Config) -> tuple[dict[str, Any], list[Table]]:
    """Return the results without and with the map in each world, and their table."""
    table, rows = Table("world", "planner+safety", "goals, %", "collisions", "time, s", "where both arrive, s"), []
    for world in config.world:
        by_map = {}
        for known in (False, True):
            envs = gym.make_vec(ROOMS, num_envs=config.episodes, world=world, info="full", localizer="match", noise="wheel")
            by_map[known], _, p = drive(envs, Mapped(envs) if known else "planner+safety", config.seed)
            envs.close()
            e, other, limit = by_map[known], by_map[False], p.task.max_steps * p.dt
            both = e.success & other.success
            row = {
                "success": metrics.share(e.success),
                "collision": metrics.share(e.collision),
                "time": metrics.mean(np.where(e.success, e.time, limit)),
                "sooner": metrics.mean((other.time - e.time)[both]),
            }
            rows.append({"world": world, "map": known, **row})
            words = (f"{row['success']:.1%}", str(e.collision.sum()))
            sooner = f"{row['sooner']:+.2f}" if known else ""
            table.add_row(world, "with the map" if known else "without", *words, f"{row['time'].value:.2f}", sooner)
    return {"rows": rows}, [table]


if __name__ == "__main__":
    run(Config, measure, beside=__file__)

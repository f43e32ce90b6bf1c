"""Compare rules for when a robot should believe that it has arrived, on the same drives to a goal.

The bearing law drives on to the goal's centre; each rule is evaluated at every step, and the first step in which it holds
counts. Its arrival is false if the true pose is outside of the radius then. `make bench-arrival` runs it and writes
`arrival.json`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray
from rich.table import Table
from scipy.special import i0e

from harness.study import Study, each, run
from turtlebot_gym.tasks import NAV
from turtlebot_gym_agents.evaluation import metrics
from turtlebot_gym_agents.policies import BearingPolicy

NOISES = ("tutorial", "documented", "rough", "wheel")
RADIUS, DT = NAV.radius, 0.1
"""Radius of the navigation task, m; and the control interval, s."""


class Belief(NamedTuple):
    """The belief in n drives at a step."""

    believed: NDArray[np.float64]
    """Believed distance to the goal, shape (n,), m."""
    deviation: NDArray[np.float64]
    """Stated standard deviation of the position, root mean square over the two axes, shape (n,), m."""


Rule = Callable[[list[Belief]], NDArray[np.bool_]]


def within(radius: float, times: int = 1) -> Rule:
    """Return the rule that the belief is within a radius a number of times in a row."""
    return lambda history: np.all([belief.believed < radius for belief in history[-times:]], axis=0) & (len(history) >= times)


def likely(probability: float) -> Rule:
    """Return the rule that the position is within the radius with a probability, by the filter's covariance."""
    return lambda history: inside(history[-1].believed, history[-1].deviation) >= probability


def inside(distance: NDArray[np.float64], deviation: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the probability that an isotropic Gaussian around a point is within the radius, by Rice's distribution."""
    middle = (np.arange(60) + 0.5) * (RADIUS / 60.0)
    s, d = np.maximum(deviation, 1e-4)[:, None], distance[:, None]
    density = middle / s**2 * np.exp(-((middle - d) ** 2) / (2.0 * s**2)) * i0e(middle * d / s**2)
    return density.sum(axis=1) * (RADIUS / 60.0)


RULES: dict[str, Rule] = {
    "within 0.15 m": within(RADIUS),
    "within 0.12 m": within(0.12),
    "within 0.10 m: the margin": within(RADIUS - NAV.margin),
    "within 0.08 m": within(0.08),
    "0.15 m, three in a row": within(RADIUS, times=3),
    "inside by 95 %": likely(0.95),
    "inside by 99 %": likely(0.99),
}


@dataclass(frozen=True, kw_only=True)
class Config(Study):
    """Compare rules of arrival."""

    drives: int = 4000
    """Number of drives under each noise."""
    seed: int = 0
    """Seed of the first drive."""
    steps: int = 400
    """Length of a drive."""


def compare(noise: str, config: Config) -> dict[str, Any]:
    """Return how often each rule's arrival is false, how much later than the first rule it occurs, and how often never."""
    n, endless = config.drives, 1e-9  # a radius this small is never reached, and the robot drives on
    task = replace(NAV, radius=endless, max_steps=np.inf)
    envs = gym.make_vec(
        "turtlebot_gym/TurtleBotNav-v0", num_envs=n, task=task, noise=noise, info="full", max_episode_steps=config.steps + 1
    )
    policy, history = BearingPolicy(), []
    when = {name: np.full(n, np.nan) for name in RULES}
    missed = {name: np.full(n, np.nan) for name in RULES}
    observations, _ = envs.reset(seed=config.seed)
    for step in range(config.steps):
        observations, _, _, _, info = envs.step(policy(observations))
        goal, P = info["reference"][:, :2], info["covariance"]
        believed = np.hypot(*(info["estimate"][:, :2] - goal).T)
        history = [*history[-2:], Belief(believed, np.sqrt(0.5 * (P[:, 0, 0] + P[:, 1, 1])))]
        away = np.hypot(*(info["true_state"][:, :2] - goal).T)
        for name, rule in RULES.items():
            now = rule(history) & np.isnan(when[name])
            when[name][now], missed[name][now] = step * DT, away[now]
    envs.close()
    first = when[next(iter(RULES))]
    return {
        name: {
            "false": metrics.share(missed[name][~np.isnan(when[name])] > RADIUS),
            "later": metrics.mean((when[name] - first)[~np.isnan(when[name] - first)]),
            "never": float(np.isnan(when[name]).mean()),
        }
        for name in RULES
    }


def table(noise: str, rules: dict[str, Any]) -> Table:
    """Return a table of the results under a noise."""
    drawn = Table("rule", "false, %", "later, s", "never, %", title=noise)
    for name, row in rules.items():
        false, later = row["false"], row["later"]
        drawn.add_row(name, f"{false:.1%}", f"{later.value:.2f}", f"{100.0 * row['never']:.1f}")
    return drawn


def measure(config: Config) -> tuple[dict[str, Any], list[Table]]:
    """Return the results of all rules under each noise, and their tables."""
    results = {noise: compare(noise, config) for noise in each(NOISES, "noises")}
    return {"radius": RADIUS, "rules": results}, [table(noise, rules) for noise, rules in results.items()]


if __name__ == "__main__":
    run(Config, measure, beside=__file__)

"""Compare each filter with the posterior Cramer-Rao bound, under each noise preset, on 20,000 drives.

`make bench-estimation` runs it and writes `estimation.json`; `turtlebot-gym estimate` does the same for one setting.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any

from rich.table import Table

from harness.study import Study, each, run
from turtlebot_gym import FilterTuning, Noise, make_filter
from turtlebot_gym.parameters import DeadReckoning
from turtlebot_gym_agents.commands.report import estimation_table
from turtlebot_gym_agents.evaluation.estimation import estimate, in_force

EXACT = " without floors"
"""Suffix of a filter that assumes exactly the true noise."""
SETTINGS: dict[str, tuple[tuple[str, ...], dict[str, Any]]] = {
    "tutorial": (("matched", "matched without floors", "gated", "mixture", "tutorial"), {"noise": "tutorial"}),
    "documented without its bias": (
        ("matched", "gated", "mixture", "mixture without floors"),
        {"noise": "documented", "bias": False},
    ),
    "documented": (("matched", "mixture"), {"noise": "documented"}),
    "wheel": (("matched", "matched without floors"), {"noise": "wheel"}),
    "rough without slip": (("matched", "gated", "mixture", "mixture without floors"), {"noise": "rough", "slip": False}),
    "rough": (("matched", "gated", "mixture", "slip"), {"noise": "rough"}),
}
"""Filters and noise of each setting."""


@dataclass(frozen=True, kw_only=True)
class Config(Study):
    """Compare filters with the bound."""

    runs: int = 20_000
    """Number of drives in each setting."""
    seed: int = 0
    """Seed of the first drive."""


def tuning(name: str, noise: Noise) -> FilterTuning:
    """Return a filter's tuning by its name here."""
    chosen = make_filter(name.removesuffix(EXACT), noise)
    exact = (
        noise.odometry.R if isinstance(chosen.kind, DeadReckoning) else chosen.R
    )  # otherwise it includes spikes and quantization
    return replace(chosen, Q=(0.0,) * 5, R=exact) if name.endswith(EXACT) else chosen


def measure(config: Config) -> tuple[dict[str, Any], list[Table]]:
    """Return the results of the filters in each setting, and their tables."""
    settings, tables = {}, []
    for name, (filters, options) in each(SETTINGS.items(), "settings"):
        model = in_force(**options)
        tunings = {filter: tuning(filter, model) for filter in filters}
        result = estimate(tunings, runs=config.runs, seed=config.seed, **options)
        tables.append(estimation_table(result))
        tables[-1].title = name
        content = asdict(result)
        settings[name] = {"bound": result.bound[-1], "band": result.band, "config": result.config} | {
            "filters": {
                filter: {key: value for key, value in figures.items() if key != "rmse"}
                for filter, figures in content["filters"].items()
            }
        }
    return {"settings": settings}, tables


if __name__ == "__main__":
    run(Config, measure, beside=__file__)

"""Compare each filter with the posterior Cramer-Rao bound, under each noise preset, on 20,000 drives.

`make bench-estimation` runs it and writes `estimation.json`; `turtlebot-gym estimate` does the same for one setting.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import tyro

from turtlebot_gym import FilterTuning, Noise, make_filter
from turtlebot_gym.parameters import DeadReckoning
from turtlebot_gym_agents.commands.console import print_tables, progress
from turtlebot_gym_agents.commands.report import estimation_table
from turtlebot_gym_agents.evaluation.estimation import estimate, in_force
from turtlebot_gym_agents.provenance import settings_of, write_json

RESULTS = Path(__file__).with_suffix(".json")
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
class Config:
    """Compare filters with the bound."""

    runs: int = 20_000
    """Number of drives in each setting."""
    seed: int = 0
    """Seed of the first drive."""
    json: Path | None = RESULTS
    """File for the results."""


def tuning(name: str, noise: Noise) -> FilterTuning:
    """Return a filter's tuning by its name here."""
    chosen = make_filter(name.removesuffix(EXACT), noise)
    exact = (
        noise.odometry.R if isinstance(chosen.kind, DeadReckoning) else chosen.R
    )  # otherwise it includes spikes and quantization
    return replace(chosen, Q=(0.0,) * 5, R=exact) if name.endswith(EXACT) else chosen


def main() -> None:
    """Drive, print tables, and write the results."""
    config = tyro.cli(Config, description=__doc__)
    settings = {}
    for name, (filters, options) in SETTINGS.items():
        model = in_force(**options)
        tunings = {filter: tuning(filter, model) for filter in filters}
        with progress(config.runs) as advance_to:
            result = estimate(tunings, runs=config.runs, seed=config.seed, progress=advance_to, **options)
        table = estimation_table(result)
        table.title = name
        print_tables(table)
        content = asdict(result)
        settings[name] = {"bound": result.bound[-1], "band": result.band, "config": result.config} | {
            "filters": {
                filter: {key: value for key, value in figures.items() if key != "rmse"}
                for filter, figures in content["filters"].items()
            }
        }
    if config.json is not None:
        write_json(config.json, {"settings": settings}, config=settings_of(config))


if __name__ == "__main__":
    main()

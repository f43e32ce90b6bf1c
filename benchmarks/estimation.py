"""Compare each filter with the posterior Cramer-Rao bound, under noise presets."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from rich.table import Table

from harness.study import Study, each, run
from turtlebot_gym import FilterTuning, Noise, make_filter
from turtlebot_gym.parameters import DeadReckoning
from turtlebot_gym_lab.evaluation.estimation import estimate, in_force

EXACT = " without floors"
"""Stands behind the name of a filter that assumes the true noise, and no more."""
SETTINGS: dict[str, tuple[tuple[str, ...], dict[str, Any]]] = {
    "tutorial": (("matched", "matched without floors", "gated", "tutorial"), {"noise": "tutorial"}),
    "documented without its bias": (("matched", "gated"), {"noise": "documented", "bias": False}),
    "documented": (("matched",), {"noise": "documented"}),
    "wheel": (("matched", "matched without floors"), {"noise": "wheel"}),
    "rough without slip": (("matched", "gated"), {"noise": "rough", "slip": False}),
    "rough": (("matched", "gated"), {"noise": "rough"}),
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
    """Return a filter's tuning by its name in `SETTINGS`."""
    found = make_filter(name.removesuffix(EXACT), noise)
    exact = noise.odometry.R if isinstance(found.kind, DeadReckoning) else found.R  # spikes and quantization belong to it
    return replace(found, Q=(0.0,) * 5, R=exact) if name.endswith(EXACT) else found


def measure(config: Config) -> tuple[dict[str, Any], list[Table]]:
    """Return ratios to the bound after three seconds, and NEES, and their table."""
    table, settings = Table("noise", "filter", "x", "y", "heading", "NEES"), {}
    for name in each(SETTINGS, "settings"):
        filters, options = SETTINGS[name]
        model = in_force(**options)
        tunings = {which: tuning(which, model) for which in filters}
        result = estimate(tunings, runs=config.runs, seed=config.seed, **options)
        found = {which: {"ratio": list(one.ratio), "nees": one.nees} for which, one in result.filters.items()}
        settings[name] = {"bound": result.bound[-1].tolist(), "band": list(result.band), "filters": found}
        for which, one in result.filters.items():
            table.add_row(name, which, *(f"{ratio.value:.3f}" for ratio in one.ratio), f"{one.nees.value:.2f}")
    return {"settings": settings}, [table]


if __name__ == "__main__":
    run(Config, measure, beside=__file__)

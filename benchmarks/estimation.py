"""Compare each filter with the posterior Cramer-Rao bound, under noise presets."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import tyro

from harness.study import each, publish
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


def tuning(name: str, noise: Noise) -> FilterTuning:
    """Return a filter's tuning by its name in `SETTINGS`."""
    found = make_filter(name.removesuffix(EXACT), noise)
    exact = noise.odometry.R if isinstance(found.kind, DeadReckoning) else found.R  # spikes and quantization belong to it
    return replace(found, Q=(0.0,) * 5, R=exact) if name.endswith(EXACT) else found


def main(*, runs: int = 20_000, seed: int = 0, json: Path = Path("benchmarks/estimation.json")) -> None:
    """Estimate, print and write ratios to the bound after three seconds, and NEES.

    Args:
        runs: Number of drives in each setting.
        seed: Seed of the first drive.
        json: File for the results.
    """
    options, settings = {**locals()}, {}
    for name in each(SETTINGS, "settings"):
        filters, given = SETTINGS[name]
        model = in_force(**given)
        result = estimate({which: tuning(which, model) for which in filters}, runs=runs, seed=seed, **given)
        found = {which: {"ratio": list(one.ratio), "nees": one.nees} for which, one in result.filters.items()}
        settings[name] = {"filters": found}
    publish(json, {"settings": settings}, options)


if __name__ == "__main__":
    tyro.cli(main, description=__doc__)

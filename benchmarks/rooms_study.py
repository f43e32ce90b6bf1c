"""Who finds the way through rooms: policies, worlds, LiDARs, and what the robot believes of its pose.

Every policy drives the same 1000 held-out rooms of each setting, on seeds that neither trainings nor tunings use. The
baselines have their defaults, which were tuned for `dense`. Several trainings of one kind are one row, with intervals that hold
the training's variance.

    python benchmarks/rooms_study.py --out out/rooms
    python benchmarks/rooms_study.py --learned run/seed-*/policy.onnx
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from rich.table import Table
from scenarios import run_all

from turtlebot_gym.rooms.rules import ROOMS as WORLDS
from turtlebot_gym_agents.commands.console import ROOMS, print_tables
from turtlebot_gym_agents.evaluation import comparison, metrics
from turtlebot_gym_agents.evaluation.evaluate import Evaluation, evaluate
from turtlebot_gym_agents.evaluation.metrics import Interval
from turtlebot_gym_agents.provenance import write_json

SETTINGS: dict[str, dict[str, str]] = {
    **{world: {"world": world} for world in WORLDS},
    **{f"dense, {lidar}": {"world": "dense", "lidar": lidar} for lidar in ("lds02", "a1", "ideal")},
    **{
        f"dense, {observation}, noise {noise}": {"world": "dense", "observation": observation, "noise": noise}
        for noise in ("documented", "rough")
        for observation in ("truth", "ekf", "odometry")
    },
}
"""What is driven: the arguments of the environment that are not its defaults, by name."""
COMPARED_WITH = "vfh"
"""The baseline that the others' success is compared with, in pairs."""
LEARNED = "ppo"


@dataclass(frozen=True, kw_only=True)
class Config:
    """Drive them all."""

    policy: tuple[str, ...] = ("bearing", "bearing+safety", "gap", "dwa", "vfh", "vfh+safety", "oracle")
    """As for `turtlebot-gym evaluate`."""
    learned: tuple[Path, ...] = ()
    """Bundles of several trainings of one kind."""
    only: tuple[str, ...] = ()
    """Settings by name; all where it is empty."""
    episodes: int = 1000
    """Rooms of each setting."""
    first_seed: int = 1_000_000
    """Of the rooms: they are these seeds' first episodes, for whoever wants to compare."""
    processes: int = 2
    """Processes at once, each on one core."""
    out: Path = Path("out/rooms")
    """Where rooms_study.json goes."""


def row(name: str, policies: Sequence[str], config: Config) -> dict[str, Any]:
    """Return the figures of one policy, or of all trainings of one kind, in a setting."""
    common: dict[str, Any] = {"env": ROOMS, "episodes": config.episodes, "seed": config.first_seed, **SETTINGS[name]}
    driven = [evaluate(policy, **common) for policy in policies]
    reference = evaluate(COMPARED_WITH, **common)
    told = {"setting": name, "policy": policies[0] if len(policies) == 1 else LEARNED, **figures(driven)}
    difference = metrics.paired_share_difference(driven[0].episodes.success, reference.episodes.success)
    if len(driven) > 1:
        difference = metrics.share_difference(told["success"], metrics.share(reference.episodes.success))
    return {**told, "success_difference": difference}


def figures(driven: Sequence[Evaluation]) -> dict[str, Interval]:
    """Return what is told of a policy; of several trainings, with their variance in the intervals."""
    if len(driven) == 1:
        summary = driven[0].summary()
        return {key: summary[key] for key in ("success", "collision", "timeout", "spl", "barn", "clearance_5th", "time")}
    e = [one.episodes for one in driven]
    success, collision = (np.array([getattr(one, key) for one in e]) for key in ("success", "collision"))
    spl = np.array([one.success * one.shortest / np.maximum(one.path, one.shortest) for one in e])
    return {
        "success": comparison.share(success),
        "collision": comparison.share(collision),
        "timeout": comparison.share(~success & ~collision),
        "spl": comparison.spread(spl).interval(),
        "clearance_5th": metrics.mean([metrics.quantile(one.clearance, 0.05).value for one in e]),
        "time": comparison.spread([one.times() for one in driven]).interval(),
    }


def main() -> None:
    """Run the study, print a table, and write its results."""
    config = tyro.cli(Config, description=__doc__)
    names = config.only or tuple(SETTINGS)
    kinds = [(policy,) for policy in config.policy]
    kinds += [tuple(map(str, config.learned))] if config.learned else []
    jobs = [(row, (name, policies, config)) for name in names for policies in kinds]
    rows = run_all(jobs, "settings and policies", config.processes)
    shown = Table("", "policy", "success, %", f"minus {COMPARED_WITH}, points", "collision, %", "time-out, %", "SPL", "time, s")
    for name in names:
        shown.add_section()
        for told in (one for one in rows if one["setting"] == name):
            cells = [_percent(told[key]) for key in ("success", "success_difference", "collision", "timeout")]
            shown.add_row(name, told["policy"], *cells, f"{told['spl'].value:.3f}", f"{told['time'].value:.2f}")
    print_tables(shown)
    config.out.mkdir(parents=True, exist_ok=True)
    write_json(config.out / "rooms_study.json", {"rows": rows}, config=asdict(config))


def _percent(interval: Interval) -> str:
    value, low, high = (100.0 * number for number in interval)
    return f"{value:.1f} ({low:.1f}, {high:.1f})"


if __name__ == "__main__":
    main()

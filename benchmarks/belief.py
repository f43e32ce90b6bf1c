"""Train the same policy on the true pose, on wheel odometry and on a localizer's belief, and drive all on that belief.

Each training begins with VFH+, and mixes three settings: a right map; slip and a wrong map; an unknown start in halls with one
pillar, which look nearly the same turned by 180 degrees. All policies drive missions in the same held-out rooms. Intervals
include the choice of rooms and of trainings. `make bench-belief` runs it and writes `belief.json`.
"""

from __future__ import annotations

import json
import time
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from rich.table import Table

from harness.study import Study, run
from turtlebot_gym.observations import Observation
from turtlebot_gym.presets import WHEEL
from turtlebot_gym.rooms.rules import ROOMS, RoomRules
from turtlebot_gym.systems import Options
from turtlebot_gym.tasks import MISSION
from turtlebot_gym_agents.evaluation import comparison, metrics
from turtlebot_gym_agents.evaluation.evaluate import evaluate
from turtlebot_gym_agents.evaluation.metrics import Interval
from turtlebot_gym_agents.policies import Policy, fit, make_policy
from turtlebot_gym_agents.policies.policy import terms_of
from turtlebot_gym_agents.provenance import replace_json
from turtlebot_gym_agents.training.config import TrainingConfig
from turtlebot_gym_agents.training.export import export
from turtlebot_gym_agents.training.hyperparameters import load
from turtlebot_gym_agents.training.train import learn

SLIP = replace(WHEEL, process=replace(WHEEL.process, slip=0.5, slip_start=0.01, slip_end=0.2))
HALL = RoomRules(half_length=5.0, half_width=3.5, circles=(1.0, 1.0), boxes=(0.0, 0.0))
SETTINGS: dict[str, dict[str, Any]] = {
    "right map": {"world": "office", "noise": WHEEL},
    "slip and wrong map": {"world": replace(ROOMS["dense"], unmapped=0.5, vanished=0.25, map_error=0.05), "noise": SLIP},
    "unknown start": {"world": HALL, "noise": WHEEL, "start": "unknown"},
}
"""Options of the environments, by setting."""
LOCALIZER: dict[str, Any] = {"localizer": "match"}
EVIDENCE, TURNS, TURN = "localizer, evidence", ", turns in doubt", np.array([0.0, 0.5], np.float32)
TRAINED: dict[str, dict[str, Any]] = {
    "truth": {"observation": "truth"},
    "wheels": {},
    "localizer": LOCALIZER,
    EVIDENCE: LOCALIZER | {"observation": "located"},
}
"""What a policy observes of its pose in training."""
FIGURES = ("an_hour", "goals", "false_goals", "lost", "collision")
"""Figures: goals truly reached per hour, where none are after a contact; shares of the goals given; share of
the time with a belief more than 0.5 m off; share of the missions that end by a contact."""
HIDDEN = {"truth": ("std_position", "std_heading", "nis"), "wheels": ("nis",)}
"""Observations that are 0 throughout a training, and where its policies drive too: what their networks make of other numbers
is chance."""
SHOWN = ", nothing hidden"
"""What is added to the name of a training whose policies see these numbers where they drive."""
SMALLER = {"n_envs": 256, "n_steps": 64}
"""Differences from the hyper-parameters for rooms: what precedes the learning costs half of the time."""
AT_FIRST, IN_DOUBT = 200, 0.5
"""Steps of a mission in which the speed in doubt is measured, and standard deviation of a position in doubt, m."""


@dataclass(frozen=True, kw_only=True)
class Config(Study):
    """Train and drive."""

    trained: tuple[str, ...] = tuple(TRAINED)
    """What is observed in training, of `TRAINED`."""
    seeds: int = 5
    """Number of trainings each, at least 2."""
    steps: int = 1_000_000
    """Steps of each."""
    policy: tuple[str, ...] = ("vfh", f"vfh{TURNS}", "planner", "ppo-rooms")
    """Further policies."""
    missions: int = 100
    """Number of missions of each policy in each setting."""
    seconds: float = 200.0
    """Their length, s; those of trainings are half as long."""
    seed: int = 7_000_000
    """First seed of the rooms."""
    kept: Path = Path("out/belief")
    """Folder for policies and drives; what is there is not repeated."""
    only: tuple[int, ...] = ()
    """Train these seeds only, and write no results."""


class Watched:
    """A policy whose speed is noted while the place is in doubt, early in missions.

    Args:
        policy: The policy.
        turns: Whether the robot turns on the spot instead while the place is in doubt.
        hidden: Names of observations that the policy sees as 0.
    """

    def __init__(self, policy: Policy, *, turns: bool = False, hidden: Sequence[str] = ()) -> None:
        self._policy, self._turns = policy, turns
        self._hidden = [Observation._fields.index(name) for name in hidden]
        self._steps = 0
        self.ways, self.doubts = 0.0, 0

    def reset(self, mask: NDArray[np.bool_]) -> None:
        getattr(self._policy, "reset", lambda mask: None)(mask)

    def __call__(self, observations: NDArray[np.float32]) -> NDArray[np.float32]:
        shown = observations.copy()
        shown[:, self._hidden] = 0.0
        actions = self._policy(shown)
        in_doubt = observations[:, Observation._fields.index("std_position")] > IN_DOUBT
        if self._turns:
            actions = np.where(in_doubt[:, None], TURN, actions)
        if self._steps < AT_FIRST:
            self.ways += float(np.abs(np.clip(actions[in_doubt, 0], -1.0, 1.0)).sum())
            self.doubts += int(in_doubt.sum())
        self._steps += 1
        return actions

    def speed(self) -> float:
        """Return the mean speed in doubt, as a share of the limit; NaN if there was no doubt."""
        return self.ways / self.doubts if self.doubts else np.nan


def options(setting: str, trained: Mapping[str, Any]) -> dict[str, Any]:
    """Return the options of a setting with what is observed of the pose; only a localizer can begin anywhere."""
    return {name: value for name, value in SETTINGS[setting].items() if name != "start" or "localizer" in trained} | {**trained}


def train(name: str, seed: int, config: Config) -> Path:
    """Return the file of a policy that was trained on a mix of the settings."""
    path = config.kept / f"{name.replace(', ', '-')}-{seed}.onnx"
    if path.exists():
        return path
    path.parent.mkdir(parents=True, exist_ok=True)
    task = replace(MISSION, max_steps=5.0 * config.seconds)
    rows = [Options.of({"task": task, **options(setting, TRAINED[name])}).setup().parameters for setting in SETTINGS]
    about: dict[str, Any] = {"noise": "wheel", "from_policy": "vfh", "steps": config.steps, "seed": seed}
    chosen = TrainingConfig(env=fit.MISSIONS, config=load("ppo", fit.ROOMS) | SMALLER, **about, **TRAINED[name])
    begin = time.process_time()
    with closing(chosen.make_training()) as envs:
        envs.unwrapped.set_parameters([rows[i % len(rows)] for i in range(envs.num_envs)])  # pyright: ignore[reportAttributeAccessIssue]
        model = learn(chosen, envs, [])
    export(model, path, chosen.card(rows[0], about | {"cpu_s": time.process_time() - begin}))
    return path


def driven(policy: str | Path, setting: str, config: Config, hidden: Sequence[str] = ()) -> dict[str, Any]:
    """Return what a policy reaches in each mission of a setting on the localizer's belief, and its speed in doubt."""
    kept = config.kept / f"{Path(policy).stem}{' as trained' if hidden else ''} {setting}.json"
    if not kept.exists():
        own = make_policy(str(policy).removesuffix(TURNS), allow_mismatch=True)
        driver = Watched(own, turns=str(policy).endswith(TURNS), hidden=hidden)
        shown = EVIDENCE if any(term.name == "evidence" for term in terms_of(own) or ()) else "localizer"
        limit = {"max_episode_steps": round(10.0 * config.seconds), "episodes": config.missions, "seed": config.seed}
        e = evaluate(driver, env=fit.MISSIONS, **limit, **options(setting, TRAINED[shown])).episodes
        counts = {"arrivals": e.arrivals, "false": e.false_arrivals, "given": e.given, "collision": e.collision}
        times = {"time": e.time, "astray": e.astray * e.time}
        kept.parent.mkdir(parents=True, exist_ok=True)
        replace_json(kept, {name: part.tolist() for name, part in (counts | times).items()} | {"speed": driver.speed()})
    return json.loads(kept.read_text())


def ratios(parts: ArrayLike, wholes: ArrayLike) -> NDArray[np.float64]:
    """Return a ratio of sums, linearized: a table of trainings and missions whose mean it is, and whose spread is its own."""
    part, whole = np.array(parts, np.float64), np.array(wholes, np.float64)
    ratio = part.mean() / whole.mean()
    return ratio + (part - ratio * whole) / whole.mean()


def tables(drives: list[dict[str, Any]], seconds: float) -> dict[str, NDArray[np.float64]]:
    """Return each figure of some trainings, or of one policy, as a table of trainings and missions."""
    column = {name: [drive[name] for drive in drives] for name in drives[0]}
    once = np.ones_like(column["given"])
    table = {
        "an_hour": ratios(column["arrivals"], once * seconds / 3600.0),
        "goals": ratios(column["arrivals"], column["given"]),
        "false_goals": ratios(column["false"], column["given"]),
        "lost": ratios(column["astray"], column["time"]),
        "collision": ratios(column["collision"], once),
    }
    return {name: table[name] for name in FIGURES}


def interval(table: NDArray[np.float64]) -> Interval:
    """Return the mean of a table with its interval; a single row is a policy that was not trained here."""
    return comparison.spread(table).interval() if len(table) > 1 else metrics.mean(table[0])


def compared(setting: str, by_policy: Mapping[str, list[dict[str, Any]]], config: Config) -> list[dict[str, Any]]:
    """Return the rows of a setting: figures of each policy, and of trainings their differences in the same missions."""
    results, rows = {name: tables(drives, config.seconds) for name, drives in by_policy.items()}, []
    for name, figures in results.items():
        row: dict[str, Any] = {"setting": setting, "policy": name, **{key: interval(part) for key, part in figures.items()}}
        row["speed_in_doubt"] = float(np.mean([drive["speed"] for drive in by_policy[name]]))
        for other in ("truth", *config.policy) if name.removesuffix(SHOWN) in TRAINED else ():
            if other != name and other in results:
                minus = {key: part - results[other][key] for key, part in figures.items()}
                row[f"minus_{other}"] = {key: interval(part) for key, part in minus.items()}
                row[f"p_{other}"] = comparison.spread(minus["an_hour"]).p_value()
        rows.append(row)
    return rows


def measure(config: Config) -> tuple[dict[str, Any] | None, list[Table]]:
    """Return the results in all settings, and their table; none where some seeds are trained alone."""
    drivers: dict[str, list[str | Path]] = {name: [name] for name in config.policy} if not config.only else {}
    for name in config.trained:
        drivers[name] = [train(name, seed, config) for seed in config.only or range(config.seeds)]
        drivers |= {f"{name}{SHOWN}": drivers[name]} if name in HIDDEN else {}
    titles = (
        "an hour",
        "reached, %",
        "falsely, %",
        "lost, %",
        "contacts, %",
        "more an hour than truth",
        "than vfh",
        "speed in doubt",
    )
    rows, table = [], Table("setting", "policy, or trained on", *titles)
    for setting in SETTINGS:
        by_policy = {
            name: [driven(policy, setting, config, HIDDEN.get(name, ())) for policy in some] for name, some in drivers.items()
        }
        if config.only:
            continue
        rows += compared(setting, by_policy, config)
    for row in rows:
        cells = [format(row[key], ".1f" if key == "an_hour" else ".1%") for key in FIGURES]
        more = [f"{row[f'minus_{other}']['an_hour']:.1f}" if f"minus_{other}" in row else "" for other in ("truth", "vfh")]
        table.add_row(row["setting"], row["policy"], *cells, *more, f"{row['speed_in_doubt']:.2f}")
    return {"rows": rows} if rows else None, [table]


if __name__ == "__main__":
    run(Config, measure, beside=__file__)

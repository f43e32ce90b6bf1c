"""A benchmark protocol: fixed worlds, noises, seeds and metrics, so that policies, filters and localizers share a table.

An entry is a JSON file that `run` makes. Other versions of the settings have another `FORMAT`, and their entries are refused.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from turtlebot_gym.files import load
from turtlebot_gym.observations import SCAN
from turtlebot_gym.validation import shown
from turtlebot_gym_agents.evaluation.evaluate import NAV, evaluate
from turtlebot_gym_agents.policies import make_policy, terms_of
from turtlebot_gym_agents.policies.fit import MISSIONS, ROOMS
from turtlebot_gym_agents.provenance import plain

FORMAT = "turtlebot-gym-protocol/1"
SEED = 20_260_000
"""Seed of the first episode; nothing of this package was trained or tuned on these seeds."""


class Setting(NamedTuple):
    """A row of an entry: an environment with its options."""

    env: str
    options: dict[str, Any]
    episodes: int


SETTINGS = {
    **{f"nav, {noise}": Setting(NAV, {"noise": noise}, 1000) for noise in ("tutorial", "documented", "rough")},
    **{
        f"rooms, {world}": Setting(ROOMS, {"noise": "tutorial", "world": world, "lidar": "lds01"}, 500)
        for world in ("dense", "corridor", "office")
    },
    "missions, office": Setting(MISSIONS, {"noise": "wheel", "world": "office", "lidar": "lds01"}, 50),
}
"""The settings by name. All are of the robot "burger" at 10 Hz."""
METRICS = ("success", "time", "collision", "goals", "false_goals", "lost", "estimate_position_mean", "false_arrival")
"""Metrics of an entry in each setting that has them, with 95 % intervals; see `Evaluation.summary`."""


def settings_for(policy: str, localizer: str | None = None) -> dict[str, Setting]:
    """Return the settings that a policy can enter: a bundle those of its task, a baseline all that it can read.

    A localizer moves with wheel odometry, so it enters the settings of that noise only.
    """
    made = make_policy(policy)
    envs = {NAV, ROOMS, MISSIONS}
    if SCAN.name in {term.name for term in terms_of(made) or ()}:
        envs = {ROOMS, MISSIONS}
    elif hasattr(made, "card"):
        card: Any = getattr(made, "card")  # noqa: B009  # a policy need not have one
        envs = {card.env}
    entered = {name: setting for name, setting in SETTINGS.items() if setting.env in envs}
    chosen = {name: setting for name, setting in entered.items() if localizer is None or setting.options["noise"] == "wheel"}
    if not chosen:
        reason = f", and with localizer {localizer!r} those on wheel odometry only" if localizer and entered else ""
        raise ValueError(f"{policy}: the protocol has no setting of its task, {', '.join(envs)}{reason}.")
    return chosen


def run(
    policy: str,
    *,
    filter: str = "matched",
    localizer: str | None = None,
    progress: Callable[[int], None] = lambda ended: None,
) -> dict[str, Any]:
    """Drive a policy in all settings that it can enter, and return the entry.

    Args:
        policy: A name for `turtlebot_gym_agents.make_policy`.
        filter: A filter's name, or one of your own (MODULE:NAME).
        localizer: A localizer for missions; None for wheels and filter alone.
        progress: Called with the number of episodes that have ended.
    """
    rows, ended = {}, 0
    for name, setting in settings_for(policy, localizer).items():
        placed = {"localizer": localizer} if localizer else {}
        options = {**setting.options, "filter": filter, **placed}
        before = ended
        evaluation = evaluate(
            policy,
            env=setting.env,
            episodes=setting.episodes,
            seed=SEED,
            progress=lambda done, before=before: progress(before + done),
            **options,
        )
        ended += setting.episodes
        summary = evaluation.summary()
        rows[name] = {metric: plain(summary[metric]) for metric in METRICS if metric in summary}
    entry = {"policy": policy, "filter": filter, "localizer": localizer, "sha256": getattr(make_policy(policy), "sha256", None)}
    return {"format": FORMAT, "entry": entry, "rows": rows}


def read_entry(path: Path) -> dict[str, Any]:
    """Read an entry.

    Raises:
        ValueError: If the file is not an entry of this version of the protocol.
    """
    content = load(path)
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        actual = content.get("format") if isinstance(content, dict) else content
        raise ValueError(f"{path}: it must be an entry of {FORMAT}, got {shown(actual)}.")
    return content

"""Search for the numbers with which a baseline is fastest in a scenario, so that learned policies are compared with its best.

Every try drives the same episodes, on seeds that neither trainings nor evaluations use. The first try has the baseline's
defaults. The others are random: half of them anywhere in the baseline's ranges, the other half around the best so far, closer
and closer to it. A try depends only on the search's seed and length and on the tries before it, so a stopped search resumes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro

from turtlebot_gym.config import Range, as_int, choose
from turtlebot_gym.files import load
from turtlebot_gym.parameters import REFERENCE_PERIOD
from turtlebot_gym.presets import make_robot
from turtlebot_gym_agents.evaluation.evaluate import evaluate, require_known
from turtlebot_gym_agents.flags import EnvironmentOptions
from turtlebot_gym_agents.ids import environment_id
from turtlebot_gym_agents.policies.baselines import FORMAT, POLICIES, default_numbers
from turtlebot_gym_agents.policies.fit import describe_robot
from turtlebot_gym_agents.provenance import plain, provenance, replace_json

TUNING_SEED = 2**39
"""First seed of the tries' episodes, separate from typical user seeds and those of trainings."""
_SEEDS = 2**20  # per seed of a search
_FIRST_WIDTH, _LAST_WIDTH = 0.2, 0.03  # of the draws around the best, as shares of the ranges


@dataclass(frozen=True, slots=True, kw_only=True)
class Try:
    """A baseline's numbers, and its results with them."""

    numbers: Mapping[str, float]
    """Tunable numbers by name."""
    time: float
    """Mean time of an episode, s, which the search minimizes; a failure counts as the limit."""
    success: float
    """Share of successful episodes."""


def tune_baseline(
    policy: str,
    path: Path,
    *,
    env: str = "nav",
    tries: int = 40,
    episodes: int = 2000,
    seed: int = 0,
    progress: Callable[[int], None] = lambda ended: None,
    **options: Any,
) -> list[Try]:
    """Tune a baseline for a scenario, and write the best to a file for `make_policy`.

    Args:
        policy: The baseline's name.
        path: The file, ``*.json``, replaced after each try. An existing search in it is resumed.
        env: The id of an environment of this package.
        tries: Total number of tries, earlier ones included.
        episodes: Paired episodes per try; for a fair comparison, as many as in the policy's evaluation.
        seed: Seed of the search.
        progress: Called with the number of finished tries.
        **options: The environment's, see `turtlebot_gym.Options`.

    Returns:
        All tries, in order.

    Raises:
        ValueError: If an argument is unknown or out of its range, or the file holds something else.
    """
    kind = choose("policy", policy, POLICIES)
    for name, number in (("tries", tries), ("episodes", episodes)):
        as_int(name, number, 1)
    require_known(env, seed)
    if path.suffix != ".json":
        raise ValueError(f"out must be a file *.json, got {str(path)!r}.")
    robot, dt = options.get("robot", "burger"), options.get("dt", REFERENCE_PERIOD)
    ranges = {name: (span.low, span.high, span.log) for name, span in kind.ranges().items()}
    config = plain({"env": env, "episodes": episodes, "seed": seed, "ranges": ranges, **options})
    made = {"format": FORMAT, "policy": policy, "robot": describe_robot(robot), "dt": dt}
    done = _read(path, {**made, "config": config})
    while len(done) < tries:
        progress(len(done))
        numbers = _propose(policy, done, tries, seed)
        driver = kind(make_robot(robot), dt, **numbers)
        first = TUNING_SEED + seed * _SEEDS
        driven = evaluate(driver, env=env, episodes=episodes, seed=first, **options)
        done.append(Try(numbers=numbers, time=float(driven.times().mean()), success=float(driven.episodes.success.mean())))
        content = {**made, "numbers": best_of(done).numbers, "config": config, **provenance()}
        tried = [{"numbers": attempt.numbers, "time": attempt.time, "success": attempt.success} for attempt in done]
        replace_json(path, plain({**content, "tries": tried}))
    progress(len(done))
    return done


def best_of(tries: list[Try]) -> Try:
    """Return the fastest try, or the first of equal ones."""
    return min(tries, key=lambda attempt: attempt.time)


def _read(path: Path, wanted: Mapping[str, Any]) -> list[Try]:
    """Return the tries that a file holds; none if there is no file.

    Raises:
        ValueError: If it holds another search, or anything else.
    """
    if not path.exists():
        return []
    try:
        content = load(path)
        same = all(content[name] == value for name, value in wanted.items())
        tries = [Try(**attempt) for attempt in content["tries"]]
    except (ValueError, KeyError, TypeError) as error:
        raise ValueError(f"{path} exists and is not a tuned baseline: choose another file.") from error
    if not same:
        raise ValueError(f"{path} holds a search of another configuration: choose another file.")
    return tries


def _propose(policy: str, done: list[Try], tries: int, seed: int) -> dict[str, float]:
    """Return the numbers of the next try, rounded to 4 digits."""
    if not done:
        return default_numbers(policy)
    ranges = POLICIES[policy].ranges()
    random = np.random.default_rng((seed, len(done)))
    shares = random.uniform(size=len(ranges))
    # The second half of the tries closes in on the best.
    if 2 * len(done) >= tries:
        progress = 2.0 * len(done) / tries - 1.0
        width = _FIRST_WIDTH * (_LAST_WIDTH / _FIRST_WIDTH) ** progress
        around = np.array([_share(ranges[name], number) for name, number in best_of(done).numbers.items()])
        shares = np.clip(around + width * random.normal(size=len(ranges)), 0.0, 1.0)
    drawn = {name: _at(span, float(share)) for (name, span), share in zip(ranges.items(), shares, strict=True)}
    return {name: float(f"{value:.4g}") for name, value in drawn.items()}


def _at(span: Range, share: float) -> float:
    return span.low * (span.high / span.low) ** share if span.log else span.low + share * (span.high - span.low)


def _share(span: Range, value: float) -> float:
    if span.log:
        return math.log(value / span.low) / math.log(span.high / span.low)
    return (value - span.low) / (span.high - span.low)


@dataclass(frozen=True, kw_only=True)
class Config:
    """Tune a baseline for a scenario, and write the best numbers to a file for ``turtlebot-gym evaluate --policy``."""

    env: str = "nav"
    """Environment: nav, pose, square, rooms, missions, or the id of another one."""
    seed: int = 0
    """The first seed."""
    options: Annotated[EnvironmentOptions, tyro.conf.OmitArgPrefixes] = field(default_factory=dict)
    """Options of the environment."""

    policy: str = "bearing"
    """The baseline's name."""
    tries: int = 40
    """Total number of tries, earlier ones included; the first one has the baseline's defaults."""
    episodes: int = 2000
    """Episodes per try."""
    out: Path = Path("baseline.json")
    """File for the tuned baseline, with all tries; an existing search in it is resumed."""


def main() -> None:
    """Tune, and print the fastest try."""
    config = tyro.cli(Config, description=__doc__)
    budget = {"tries": config.tries, "episodes": config.episodes, "seed": config.seed}
    tries = tune_baseline(config.policy, config.out, env=environment_id(config.env), **budget, **config.options, progress=print)
    print(f"{config.out}: {best_of(tries)}, with defaults {tries[0].time:.3f} s")


if __name__ == "__main__":
    main()

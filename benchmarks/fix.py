"""Measure the value of fixes for a robot with wheel odometry, and the cost of late ones: applied at their stamp, or as current.

The drives are long, most with random commands, the same for all cases. `make bench-fix` runs it and writes `fix.json`.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from rich.table import Table

from harness.beliefs import begun, errors_of
from harness.study import Study, each, run
from turtlebot_gym import FixNoise, make_parameters
from turtlebot_gym.kernel import kernel
from turtlebot_gym.presets import FIXES
from turtlebot_gym.systems import Parameters, System, system_of
from turtlebot_gym.systems.fixes import TrackedFix
from turtlebot_gym.systems.sensors import Sensor
from turtlebot_gym.tasks import SQUARE, SQUARE_WAYPOINTS
from turtlebot_gym_agents.evaluation import metrics
from turtlebot_gym_agents.policies import BearingPolicy

DT, HOLD = 0.1, 10
"""Control interval, s, and steps for which a command is held."""
FORWARD, TURN = (0.0, 1.0), (-0.3, 0.3)
"""Ranges of the random actions, shares of the robot's limits: without a fix they lead to an error of 0.8 m in five minutes."""
LATE_POSE = FixNoise(R=(0.1**2, 0.1**2, 0.05**2), period=0.5, delay=0.3, dropout_probability=0.3)


class Case(NamedTuple):
    """The pose sensor, and how the robot drives."""

    fix: FixNoise | None
    is_naive: bool = False
    """Whether the age of a fix is ignored."""
    on_square: bool = False
    """Whether the bearing law drives around the square instead of random commands."""


CASES = {
    "none": Case(None),
    "2 Hz (x, y) of 0.1 m": Case(FIXES["beacons"]),
    "0.3 s late, 30 % lost": Case(FIXES["late"]),
    "the same, taken for one of now": Case(FIXES["late"], is_naive=True),
    "with heading of 0.05 rad, 0.3 s late, 30 % lost": Case(LATE_POSE),
    "with heading, taken for one of now": Case(LATE_POSE, is_naive=True),
    "1 Hz (x, y) of 0.1 m": Case(replace(FIXES["beacons"], period=1.0)),
    "round the square: 2 Hz (x, y) of 0.1 m": Case(FIXES["beacons"], on_square=True),
    "round the square: 0.3 s late, 30 % lost": Case(FIXES["late"], on_square=True),
}


@dataclass(frozen=True, kw_only=True)
class Config(Study):
    """Drive with wheel odometry and fixes."""

    runs: int = 150
    """Number of drives in each case."""
    seconds: float = 300.0
    """Length of a drive, s."""
    seed: int = 0
    """Seed of the first drive."""


def naive(system: System) -> System:
    """Return a system that treats each fix as measured in the step in which it arrives."""
    name, first, sense, noise = system.sensors[-1]

    @kernel
    def sense_now(body, before, key, at, p):
        late = sense(body, before, key, at, p)
        return TrackedFix(late.pose, late.R, 0.0, late.arrived, late.cross, late.passed)

    return system.with_sensor(Sensor(name, first, sense_now, noise))


def drive(p: Parameters, system: System, on_square: bool, config: Config) -> dict[str, Any]:
    """Return errors and consistency, each a mean over a drive, and the cost of a step."""
    n, steps = config.runs, round(config.seconds / DT)
    batch, observations = begun(n, config.seed, p, SQUARE_WAYPOINTS, system=system)
    policy, random = BearingPolicy(), np.random.default_rng(config.seed)
    actions, errors, cpu = np.zeros((n, 2), np.float32), [], 0.0
    for step in range(steps):
        if on_square:
            actions = np.asarray(policy(observations), np.float32)
        elif step % HOLD == 0:
            actions = np.stack([random.uniform(*FORWARD, n), random.uniform(*TURN, n)], axis=1).astype(np.float32)
        began = time.process_time()
        observations, _ = batch.step(actions)
        cpu += time.process_time() - began if step else 0.0  # the first one compiles
        errors.append(errors_of(batch))
    position, heading, consistent = map(np.array, zip(*errors, strict=True))
    return {
        "position": metrics.mean(position.mean(axis=0)),
        "position_rms": metrics.mean(np.sqrt((position**2).mean(axis=0))),
        "position_at_end": metrics.mean(position[-1]),
        "heading": metrics.mean(heading.mean(axis=0)),
        "nees": metrics.mean(consistent.mean(axis=0)),
        "cpu_microseconds": 1e6 * cpu / (n * (steps - 1)),
    }


def shown(interval: Any, digits: int) -> str:
    """Return an interval for the table."""
    return f"{interval.value:.{digits}f} ± {0.5 * (interval.high - interval.low):.{digits}f}"


def measure(config: Config) -> tuple[dict[str, Any], list[Table]]:
    """Return the results of all cases, and their table."""
    task, results = replace(SQUARE, laps=1_000_000, max_steps=1e9), {}
    table = Table(
        "fix", "position, m", "rms, m", "at the end, m", "heading, rad", "NEES of the pose", "µs a step",
        title=f"wheel odometry, {config.runs} drives of {config.seconds:g} s, means and 95 % intervals",
    )  # fmt: skip
    for name, (fix, is_naive, on_square) in each(CASES.items(), "fixes"):
        p = make_parameters(task, noise="wheel", fix=fix)
        system = naive(system_of(p)) if is_naive else system_of(p)
        row = results[name] = drive(p, system, on_square, config)
        numbers = [shown(row[key], 4) for key in ("position", "position_rms", "position_at_end", "heading")]
        table.add_row(name, *numbers, shown(row["nees"], 2), f"{row['cpu_microseconds']:.2f}")
    return {"cases": results}, [table]


if __name__ == "__main__":
    run(Config, measure, beside=__file__)

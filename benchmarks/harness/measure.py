"""Measure the speed of environments as ratios within one run, or check them against a file: ``python -m harness.measure``."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tyro

from harness import check, environments, report
from harness.machine import busy, cores, machine
from harness.turns import Contender, take_turns
from turtlebot_gym_agents.commands.console import print_tables, progress
from turtlebot_gym_agents.provenance import plain, settings_of, write_json


@dataclass(frozen=True, kw_only=True)
class Benchmark:
    """Measure the speed of environments as ratios within one run, by wall time and CPU seconds."""

    num_envs: tuple[int, ...] = (4096, 65536)
    """Sizes of the vector environments."""
    rounds: int = 7
    """Number of turns of each contender."""
    seconds: float = 0.5
    """Length of a turn, s."""
    busy: int = 0
    """Measure the most important rows again beside this many busy processes."""
    check: Path | None = None
    """Instead, compare this package's ratios with those in this file from --json; the exit status is 1 if one got worse."""
    tolerance: float | None = None
    """Largest accepted loss with --check, as a share: by default 0.25."""
    json: Path | None = None
    """Write the results here; an existing file is replaced."""


def run(config: Benchmark) -> None:
    """Measure, print tables, and write the requested files.

    Raises:
        SystemExit: With status 1 if a speed is compared and has got worse.
    """
    if config.check is not None:
        _check(config, config.check)
        return
    result = plain(_measure(config))
    print_tables(*report.tables(result))
    if config.json is not None:
        write_json(config.json, result, config=settings_of(config))


def _measure(config: Benchmark) -> dict[str, Any]:
    """Return the results of all sittings."""
    result: dict[str, Any] = {"machine": machine()}
    with ExitStack() as stack:
        contenders = environments.contenders(config.num_envs)
        key = {name: contender for name, contender in contenders.items() if contender.key}
        first = len(contenders) * config.rounds
        advance_to = stack.enter_context(progress(first + len(key) * config.rounds * bool(config.busy)))
        turns = {"rounds": config.rounds, "seconds": config.seconds}
        result |= take_turns(contenders, **turns, progress=advance_to)._asdict()
        if config.busy:
            with busy(config.busy):
                beside = take_turns(key, **turns, progress=lambda done: advance_to(first + done))
            result["busy"] = {"processes": config.busy, **beside._asdict()}
    return result


def _check(config: Benchmark, path: Path) -> None:
    """Print a verdict on each ratio, after measuring worse ones a second time."""
    before = check.read(path)
    rows = before["environments"]
    sizes = [row["size"] for name, row in rows.items() if name == row["base"] and row["size"] > 1]
    contenders = {name: contender for name, contender in environments.contenders(sizes).items() if name in rows}
    tolerance = check.TOLERANCE if config.tolerance is None else config.tolerance

    def judged(names: Mapping[str, Contender], rounds: int) -> list[check.Verdict]:
        with progress(len(names) * rounds) as advance_to:
            sitting = take_turns(names, rounds=rounds, seconds=config.seconds, progress=advance_to)
        quiet = check.free(sitting.used_by_others, cores())
        return check.judge(rows, sitting.environments, quiet=quiet, tolerance=tolerance)

    verdicts = judged(contenders, config.rounds)
    if again := {*check.lost(verdicts)} & {*contenders}:
        wanted = again | {contenders[name].base for name in again}
        second = {verdict.name: verdict for verdict in judged({name: contenders[name] for name in wanted}, 2 * config.rounds)}
        verdicts = [second[verdict.name] if verdict.name in again else verdict for verdict in verdicts]
    for verdict in verdicts:
        print(verdict)
    if note := check.elsewhere(before["machine"], machine()):
        print(note, file=sys.stderr)
    if lost := check.lost(verdicts):
        print(f"{len(lost)} of {len(verdicts)} ratios have lost more than {tolerance:.0%}.", file=sys.stderr)
        raise SystemExit(1)


if __name__ == "__main__":
    run(tyro.cli(Benchmark))

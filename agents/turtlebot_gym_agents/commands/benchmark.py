"""The command ``benchmark``: the speed of environments, adapter and training, and a guard against losses."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from turtlebot_gym_agents.commands.console import (
    FigureFile,
    File,
    JsonFile,
    Writing,
    print_tables,
    progress,
    require_installed,
    save_figure,
)
from turtlebot_gym_agents.outputs import FOLDER
from turtlebot_gym_agents.provenance import plain, settings_of, write_json

if TYPE_CHECKING:
    from turtlebot_gym_agents.speed.check import Verdict
    from turtlebot_gym_agents.speed.turns import Contender, Sitting

TRAININGS = 3
"""Most rounds of training in each sitting."""


@dataclass(frozen=True, kw_only=True)
class Benchmark(Writing):
    """Measure the speed of environments, adapter and training, as ratios within one run, by wall time and CPU seconds."""

    num_envs: tuple[int, ...] = (4096, 65536)
    """Sizes of the vector environments."""
    rounds: int = 7
    """Number of turns of each contender."""
    seconds: float = 0.5
    """Length of a turn, s."""
    training: bool = True
    """Whether to measure training too; it needs the extra [agents]."""
    busy: int = 0
    """Measure the most important rows again beside this many busy processes."""
    peers: Annotated[Path | None, tyro.conf.arg(metavar="FOLDER"), FOLDER] = None
    """Measure other libraries too: gymnax and EnvPool, which are installed into virtual environments in this folder."""
    check: File = None
    """Instead, compare this package's ratios with those in this file from --json; the exit status is 1 if one got worse."""
    tolerance: float = 0.25
    """With --check: largest accepted loss of a ratio, as a share of it."""
    json: JsonFile = None
    """Write the results here."""
    plot: FigureFile = None
    """Draw the rates here."""

    def _refuse_what_cannot_be(self) -> None:
        if not self.num_envs or min(self.num_envs) < 2 or len({*self.num_envs}) < len(self.num_envs):
            raise ValueError(f"num_envs must be different numbers from 2 on, got {self.num_envs}.")
        if self.rounds < 1:
            raise ValueError(f"rounds must be positive, got {self.rounds}.")
        if not 0.0 < self.seconds < 60.0:
            raise ValueError(f"seconds must be positive and below 60, got {self.seconds}.")
        if self.busy < 0:
            raise ValueError(f"busy must not be negative, got {self.busy}.")

    def run(self) -> None:
        """Measure, print tables, and write the requested files."""
        self._refuse_what_cannot_be()
        if self.check is not None:
            self._check(self.check)
            return
        if self.training:
            require_installed("torch", "stable_baselines3", extra="agents", without="--no-training")
        from turtlebot_gym_agents.speed import report

        result = plain(self._measure())
        print_tables(*report.tables(result))
        if self.json is not None:
            write_json(self.json, result, config=settings_of(self))
        if self.plot is not None:
            save_figure(report.figure(result), self.plot)

    def _measure(self) -> dict[str, Any]:
        """Return the results of all sittings."""
        from turtlebot_gym_agents.speed import environments
        from turtlebot_gym_agents.speed.machine import busy, machine
        from turtlebot_gym_agents.speed.peers import peers
        from turtlebot_gym_agents.speed.turns import grouped

        result: dict[str, Any] = {"machine": machine()}
        with ExitStack() as stack:
            contenders = environments.contenders(self.num_envs)
            if self.peers is not None:
                present = stack.enter_context(peers(self.peers, self.num_envs))
                contenders = grouped(contenders | present.contenders)
                result["peers"] = present.versions
            key = {name: one for name, one in contenders.items() if one.key}
            trainings = min(TRAININGS, self.rounds) * self.training
            sittings = [len(contenders) * self.rounds + trainings]
            if self.busy:
                sittings.append(len(key) * self.rounds + trainings)
            advance_to = stack.enter_context(progress(sum(sittings)))
            result |= self._sitting(contenders, advance_to, usual=True)
            if self.busy:
                with busy(self.busy):
                    beside = self._sitting(key, lambda done: advance_to(sittings[0] + done), usual=False)
                result["busy"] = {"processes": self.busy, **beside}
        return result

    def _sitting(
        self, contenders: Mapping[str, Contender], advance_to: Callable[[int], None], *, usual: bool
    ) -> dict[str, Any]:
        """Return the results of one sitting, optionally with the usual route of training."""
        from turtlebot_gym_agents.speed.turns import take_turns

        sat = take_turns(contenders, rounds=self.rounds, seconds=self.seconds, progress=advance_to)
        result: dict[str, Any] = sat._asdict()
        if self.training:
            from turtlebot_gym_agents.speed import learning

            done = len(contenders) * self.rounds
            if usual:
                result["adapter_ns"] = learning.adapter(rounds=self.rounds)
            result["training"] = learning.training(
                rounds=min(TRAININGS, self.rounds), usual=usual, progress=lambda trained: advance_to(done + trained)
            )
        return result

    def _check(self, path: Path) -> None:
        """Print a verdict on each ratio, after measuring worse ones a second time."""
        from turtlebot_gym_agents.speed import check, environments, machine, turns

        before = check.read(path)
        rows = before["environments"]
        sizes = [row["size"] for name, row in rows.items() if name == row["base"] and row["size"] > 1]
        contenders = environments.contenders(sizes)
        contenders = {name: one for name, one in contenders.items() if name in rows}

        def judged(names: Mapping[str, Contender], rounds: int) -> list[Verdict]:
            with progress(len(names) * rounds) as advance_to:
                sat: Sitting = turns.take_turns(names, rounds=rounds, seconds=self.seconds, progress=advance_to)
            quiet = check.free(sat.used_by_others, machine.cores())
            return check.judge(rows, sat.environments, quiet=quiet, tolerance=self.tolerance)

        verdicts = judged(contenders, self.rounds)
        if again := {*check.lost(verdicts)} & {*contenders}:
            wanted = again | {contenders[name].base for name in again}
            second = {one.name: one for one in judged({name: contenders[name] for name in wanted}, 2 * self.rounds)}
            verdicts = [second[one.name] if one.name in again else one for one in verdicts]
        for verdict in verdicts:
            print(verdict)
        if note := check.elsewhere(before["machine"], machine.machine()):
            print(note, file=sys.stderr)
        if lost := check.lost(verdicts):
            print(f"{len(lost)} of {len(verdicts)} ratios have lost more than {self.tolerance:.0%}.", file=sys.stderr)
            raise SystemExit(1)

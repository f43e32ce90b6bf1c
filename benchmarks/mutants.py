"""Change the code at random places, one change at a time, and count how many changes the tests notice.

The table of modules, with the tests of each and its number of mutants, is `mutants.toml`; mutants that no test could notice are
in `equivalent_mutants.toml`, each with the reason, and do not count. Mutants live in copies of the project in a temporary
folder: an interrupted run leaves nothing behind.

    python benchmarks/mutants.py
    python benchmarks/mutants.py --only presets parameters --quota 100
"""

from __future__ import annotations

import os
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from queue import SimpleQueue
from typing import Annotated, Any, NamedTuple

import tomllib
import tyro
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from mutation import Mutant, draw
from turtlebot_gym_agents.commands.console import print_tables
from turtlebot_gym_agents.provenance import write_json

HERE = Path(__file__).parent
ROOT = HERE.parent
PACKAGES = (".", "agents", "bridges/turtlebot_gym_ros")
"""Folders from which the packages are imported."""
MEMORY = 8 * 2**20
"""Largest address space of a test process, KiB, since a mutant may fill any memory."""


@dataclass(frozen=True, kw_only=True)
class Config:
    """Measure how many mutants the tests notice."""

    only: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME ...")] = ()
    """Modules whose path ends like this; by default all."""
    quota: int | None = None
    """Number of mutants of each module, instead of the table's."""
    seed: int = 9
    """Seed of the draw."""
    jobs: int = 2
    """Number of mutants tested in parallel."""
    json: Path | None = None
    """File for the result."""


class Module(NamedTuple):
    """A row of the table."""

    path: str
    tests: list[str]
    quota: int
    compiled: bool = False
    """Whether its tests need the compiled loop; if not, numba is off, and a changed kernel costs no compilation."""
    without: tuple[str, ...] = ()
    """Tests to leave out: without a compiler, they take long."""


class Result(NamedTuple):
    """Result of a mutant."""

    mutant: Mutant
    outcome: str
    """killed, timeout, survived or equivalent."""
    seconds: float
    why: str = ""
    """The reason why it is equivalent."""


def table(config: Config) -> list[Module]:
    """Return the requested modules."""
    text = tomllib.loads((HERE / "mutants.toml").read_text(encoding="utf-8"))
    rows = [Module(**{"quota": text["quota"], **row}) for row in text["module"]]
    rows = [
        row._replace(quota=config.quota or row.quota, without=() if row.compiled else tuple(text["without"])) for row in rows
    ]
    chosen = [row for row in rows if not config.only or any(row.path.removesuffix(".py").endswith(end) for end in config.only)]
    if not chosen:
        raise SystemExit(f"--only must name modules of benchmarks/mutants.toml, got {' '.join(config.only)}.")
    return chosen


def equivalents() -> dict[tuple[str, str, str, str], str]:
    """Return the reasons why mutants are equivalent, by module, function, and lines before and after."""
    rows = tomllib.loads((HERE / "equivalent_mutants.toml").read_text(encoding="utf-8"))["mutant"]
    return {(row["path"], row["function"], row["was"], row["now"]): row["why"] for row in rows}


class Copy:
    """A copy of the project in which one module at a time is changed and tested."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder / "project"
        self._temporary = folder / "tmp"
        self._temporary.mkdir(parents=True)
        listed = ["git", "-C", str(ROOT), "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
        for name in filter(None, subprocess.run(listed, capture_output=True, text=True, check=True).stdout.split("\0")):
            if (ROOT / name).is_file():
                (self.folder / name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(ROOT / name, self.folder / name)
        self._process: subprocess.Popen[str] | None = None

    def test(self, module: Module, limit: float) -> tuple[str, float, str]:
        """Run the tests of a module; return "passed", "failed" or "timeout", the seconds and the output."""
        command = [sys.executable, "-m", "pytest", "-x", "-q", "-m", "not slow", "-p", "no:cacheprovider", *module.tests]
        command += [f"--deselect={name}" for name in module.without]
        paths = [str(self.folder / package) for package in PACKAGES]
        kept = {name: value for name, value in os.environ.items() if not name.startswith(("PYTEST", "NUMBA", "PYTHON"))}
        # Without bytecode files no stale one can hide a mutant with the size and modification second of its original.
        env = kept | {"PYTHONPATH": os.pathsep.join(paths), "PYTHONDONTWRITEBYTECODE": "1", "TMPDIR": str(self._temporary)}
        env |= {"OMP_NUM_THREADS": "1"} | ({} if module.compiled else {"NUMBA_DISABLE_JIT": "1"})
        start = time.monotonic()
        limited = ["sh", "-c", f'ulimit -v {MEMORY}; exec "$@"', "sh", *command]
        # The output goes to a file: a grandchild that outlived the tests would keep a pipe open.
        with (self._temporary / "output").open("w+") as output:
            self._process = subprocess.Popen(
                limited, cwd=self.folder, env=env, stdout=output, stderr=subprocess.STDOUT, start_new_session=True
            )
            try:
                outcome = "failed" if self._process.wait(limit) else "passed"
            except subprocess.TimeoutExpired:
                outcome = "timeout"
            finally:
                self.stop()
            output.seek(0)
            return outcome, time.monotonic() - start, output.read()

    def judge(self, mutant: Mutant, module: Module, limit: float) -> Result:
        """Change the module, test it, and change it back."""
        file = self.folder / mutant.path
        original = file.read_text(encoding="utf-8")
        try:
            file.write_text(mutant.code, encoding="utf-8")
            outcome, seconds, _ = self.test(module, limit)
        finally:
            file.write_text(original, encoding="utf-8")
        return Result(mutant, {"passed": "survived", "failed": "killed"}.get(outcome, outcome), seconds)

    def baseline(self, modules: list[Module]) -> Iterator[tuple[str, float]]:
        """Run each module's tests on the unchanged code, and yield their duration.

        Raises:
            SystemExit: If they fail.
        """
        for module in modules:
            outcome, seconds, output = self.test(module, 600.0)
            if outcome != "passed":
                raise SystemExit(f"The tests of {module.path} fail without any mutant:\n{output[-5000:]}")
            self._see_that_the_copy_is_tested(module)
            yield module.path, seconds

    def _see_that_the_copy_is_tested(self, module: Module) -> None:
        file = self.folder / module.path
        original = file.read_text(encoding="utf-8")
        file.write_text("raise RuntimeError('planted')\n", encoding="utf-8")
        try:
            if self.test(module, 600.0)[0] == "passed":
                raise SystemExit(f"The tests {' '.join(module.tests)} never import {module.path}.")
        finally:
            file.write_text(original, encoding="utf-8")

    def stop(self) -> None:
        """End running tests, with all processes that they have started."""
        if self._process is not None:
            with suppress(ProcessLookupError):
                os.killpg(self._process.pid, signal.SIGKILL)
            self._process.wait()
            self._process = None


@contextmanager
def copies(count: int) -> Iterator[list[Copy]]:
    """Make copies of the project; afterwards, end their processes and remove them."""
    with ExitStack() as stack:
        folders = [stack.enter_context(tempfile.TemporaryDirectory(ignore_cleanup_errors=True)) for _ in range(count)]
        made = [Copy(Path(folder)) for folder in folders]
        try:
            yield made
        finally:
            for copy in made:
                copy.stop()


def judge_all(modules: list[Module], config: Config) -> list[Result]:
    """Draw the mutants of each module, and test those not known to be equivalent."""
    known, results, waiting = equivalents(), [], []
    for module in modules:
        for mutant in draw(module.path, (ROOT / module.path).read_text(encoding="utf-8"), module.quota, seed=config.seed):
            why = known.get((mutant.path, mutant.function, mutant.was, mutant.now))
            if why is None:
                waiting.append((module, mutant))
            else:
                results.append(Result(mutant, "equivalent", 0.0, why))
    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.completed} of {task.total}"))
    bars = Progress(*columns, TimeRemainingColumn(), console=Console(stderr=True), transient=True)
    with copies(config.jobs) as made, bars, ThreadPoolExecutor(config.jobs) as pool:
        bar = bars.add_task("without mutants", total=len(modules) * len(made))

        def measured(copy: Copy) -> dict[str, float]:
            told = {}
            for path, seconds in copy.baseline(modules):
                told[path] = seconds
                bars.advance(bar)
            return told

        free: SimpleQueue[Copy] = SimpleQueue()
        try:
            usual = list(pool.map(measured, made))
            for copy in made:
                free.put(copy)

            def one(module: Module, mutant: Mutant) -> Result:
                copy = free.get()
                try:
                    return copy.judge(mutant, module, 20.0 + 4.0 * max(times[module.path] for times in usual))
                finally:
                    free.put(copy)

            bar = bars.add_task("mutants", total=len(waiting))
            for count, done in enumerate(as_completed([pool.submit(one, *pair) for pair in waiting]), 1):
                results.append(done.result())
                bars.advance(bar)
                if not bars.console.is_terminal and count % 20 == 0:
                    print(f"{count} of {len(waiting)}", file=sys.stderr, flush=True)
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            for copy in made:
                copy.stop()
            raise
    return results


def summary(modules: list[Module], results: list[Result]) -> dict[str, dict[str, Any]]:
    """Return the score of each module, and of all together."""
    rows = {}
    for name in (*(module.path for module in modules), "all"):
        outcomes = [result.outcome for result in results if name in (result.mutant.path, "all")]
        counts = {outcome: outcomes.count(outcome) for outcome in ("killed", "timeout", "survived", "equivalent")}
        noticed = counts["killed"] + counts["timeout"]
        counted = noticed + counts["survived"]
        rows[name] = {"mutants": counted, **counts, "score": noticed / counted if counted else None}
    return rows


def main() -> None:
    """Draw, test, print, and write the results."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit("ended from outside"))  # as Ctrl-C does, so that copies are removed
    config = tyro.cli(Config, description=__doc__)
    modules, start = table(config), time.monotonic()
    results = sorted(judge_all(modules, config), key=lambda result: (result.mutant.path, result.mutant.line, result.mutant.now))
    scores, minutes = summary(modules, results), (time.monotonic() - start) / 60.0
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    busy = (used.ru_utime + used.ru_stime) / 60.0
    shown = Table("module", "mutants", "killed", "timeout", "survived", "equivalent", "score")
    for name, row in scores.items():
        score = "" if row["score"] is None else f"{100 * row['score']:.0f} %"
        shown.add_row(name, *(str(row[key]) for key in ("mutants", "killed", "timeout", "survived", "equivalent")), score)
    told = {"survived": [], "equivalent": []}
    for result in results:
        m = result.mutant
        if result.outcome in told:
            entry = {"path": m.path, "line": m.line, "function": m.function, "operator": m.operator, "was": m.was, "now": m.now}
            told[result.outcome].append(entry | ({"why": result.why} if result.why else {}))
        if result.outcome == "survived":
            print(f"{m.path}:{m.line} {m.function} {m.operator}\n- {m.was}\n+ {m.now}\n")
    print_tables(shown)
    print(f"{minutes:.0f} minutes, {busy:.0f} of processor time; seed {config.seed}")
    if config.json:
        settings = {"seed": config.seed, "quota": {module.path: module.quota for module in modules}, "jobs": config.jobs}
        write_json(config.json, {"minutes": minutes, "processor_minutes": busy, "modules": scores, **told}, config=settings)


if __name__ == "__main__":
    main()

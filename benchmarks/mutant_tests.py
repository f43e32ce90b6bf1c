"""Test mutants in copies of the project, several at a time; the project itself stays as it is."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from queue import SimpleQueue
from typing import Any, NamedTuple

import tomllib

from harness.pairs import PACKAGES
from harness.study import each
from mutation import Mutant

HERE = Path(__file__).parent
ROOT = HERE.parent
MEMORY = 8 * 2**20
"""Largest address space of a test process, KiB, since a mutant may fill any memory."""


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
        command = [sys.executable, "-m", "pytest", "-x", "-q", "-m", "not slow and not nightly", "-p", "no:cacheprovider"]
        command += [*module.tests, *(f"--deselect={name}" for name in module.without)]
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

    def baseline(self, module: Module) -> float:
        """Run a module's tests on the unchanged code, and return their duration, s.

        Raises:
            SystemExit: If they fail.
        """
        outcome, seconds, output = self.test(module, 600.0)
        if outcome != "passed":
            raise SystemExit(f"The tests of {module.path} fail without any mutant:\n{output[-5000:]}")
        return seconds

    def require_import(self, module: Module) -> None:
        """Raise `SystemExit` if the tests of a module pass without it; where a mutant has died there is no need to ask."""
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


def judge_all(mutants: list[tuple[Module, Mutant]], jobs: int) -> list[Result]:
    """Test the mutants that are not known to be equivalent."""
    known, results, waiting = equivalents(), [], []
    modules = list({module.path: module for module, _ in mutants}.values())
    for module, mutant in mutants:
        why = known.get((mutant.path, mutant.function, mutant.was, mutant.now))
        if why is None:
            waiting.append((module, mutant))
        else:
            results.append(Result(mutant, "equivalent", 0.0, why))
    with copies(jobs) as made, ThreadPoolExecutor(jobs) as pool:
        free: SimpleQueue[Copy] = SimpleQueue()
        for copy in made:
            free.put(copy)

        def in_copy(work: Callable[..., Any], *arguments: Any) -> Any:
            copy = free.get()
            try:
                return work(copy, *arguments)
            finally:
                free.put(copy)

        try:
            baselines = {pool.submit(in_copy, Copy.baseline, module): module.path for module in modules}
            done = each(as_completed(baselines), "without mutants", len(baselines))
            limits = {baselines[future]: 20.0 + 4.0 * future.result() for future in done}
            futures = [pool.submit(in_copy, Copy.judge, mutant, module, limits[module.path]) for module, mutant in waiting]
            for count, future in enumerate(each(as_completed(futures), "mutants", len(futures)), 1):
                results.append(future.result())
                if not sys.stderr.isatty() and count % 20 == 0:
                    print(f"{count} of {len(waiting)}", file=sys.stderr, flush=True)
            died = {result.mutant.path for result in results if result.outcome in ("killed", "timeout")}
            for module in modules:
                if module.path not in died:
                    made[0].require_import(module)
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            for copy in made:
                copy.stop()
            raise
    return results

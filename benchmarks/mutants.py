"""Change the code at random places, one change at a time, and count how many changes the tests notice.

The table of modules, with the tests of each and its number of mutants, is `mutants.toml`; mutants that no test could notice are
in `equivalent_mutants.toml`, each with the reason, and do not count. Mutants live in copies of the project in a temporary
folder: an interrupted run leaves nothing behind.

    python benchmarks/mutants.py
    python benchmarks/mutants.py --only presets parameters --quota 100

``--record`` writes the mutants that died in an earlier result as a list, drawn from the clone of that time, and ``--replay``
tests the mutants of such a list wherever their code is now: in the module of its path or, if that no longer has the changed
lines, in the one module of the project that has them in a function of that name:

    python benchmarks/mutants.py --record died.json --result benchmarks/mutants.json --tree ../before
    python benchmarks/mutants.py --replay died.json
"""

from __future__ import annotations

import ast
import json
import resource
import signal
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import tomllib
import tyro
from rich.table import Table

from mutant_tests import HERE, ROOT, Module, Result, judge_all
from mutation import Mutant, draw
from turtlebot_gym_agents.commands.console import print_tables
from turtlebot_gym_agents.provenance import write_json


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
    record: Path | None = None
    """Instead of testing, write a list of the mutants of --result that did not survive."""
    result: Path = HERE / "mutants.json"
    """With --record: result whose seed and quotas draw the mutants."""
    tree: Path = ROOT
    """With --record: clone in which they are drawn."""
    replay: Path | None = None
    """Test the mutants of this list instead of drawing."""


class Entry(NamedTuple):
    """A mutant of a list."""

    path: str
    """The module, from the root of the project."""
    function: str
    """Qualified name of the function; "" at the top of the module."""
    operator: str
    was: str
    """The changed lines before, without indentation."""
    now: str
    """The same lines afterwards."""


def recorded(tree: Path, quotas: Mapping[str, int], seed: int, left_out: Sequence[Mapping[str, Any]]) -> list[Entry]:
    """Draw mutants of the modules in a tree, without testing them.

    Args:
        tree: Root of a clone of the project.
        quotas: Number of mutants by module.
        seed: Seed of the draw.
        left_out: Mutants to leave out, such as those that survived or are equivalent.
    """
    known = {(row["path"], row["function"], row["was"], row["now"]) for row in left_out}
    entries = []
    for path, quota in quotas.items():
        for mutant in draw(path, (tree / path).read_text(encoding="utf-8"), quota, seed=seed):
            if (path, mutant.function, mutant.was, mutant.now) not in known:
                entries.append(Entry(path, mutant.function, mutant.operator, mutant.was, mutant.now))
    return entries


def write_list(path: Path, entries: Sequence[Entry]) -> None:
    """Write a list."""
    path.write_text(json.dumps([entry._asdict() for entry in entries], indent=1) + "\n", encoding="utf-8")


def read_list(path: Path) -> list[Entry]:
    """Read a list."""
    return [Entry(**row) for row in json.loads(path.read_text(encoding="utf-8"))]


def find(entry: Entry, sources: Mapping[str, str]) -> Mutant | None:
    """Return the mutant of an entry in the sources as they are, or None if its code is gone or stands in several modules.

    Args:
        entry: What to find.
        sources: Source by path of every module that may hold it.
    """
    if entry.path in sources and (mutant := _in_module(entry, entry.path, sources[entry.path])):
        return mutant
    mutants = [mutant for path, code in sources.items() if (mutant := _in_module(entry, path, code))]
    return mutants[0] if len(mutants) == 1 else None


def _in_module(entry: Entry, path: str, code: str) -> Mutant | None:
    was, now = entry.was.split("\n"), entry.now.split("\n")
    if was[0] not in code:
        return None
    lines = code.split("\n")
    for name, first, last in _functions(code):
        if name.rpartition(".")[2] != entry.function.rpartition(".")[2]:
            continue
        for at in range(first - 1, last - len(was) + 1):
            if [line.strip() for line in lines[at : at + len(was)]] == was:
                changed = "\n".join([*lines[:at], *_indented(lines[at : at + len(was)], now), *lines[at + len(was) :]])
                if _is_python(changed):
                    return Mutant(path, entry.operator, at + 1, name, entry.was, entry.now, changed)
    return None


def _functions(code: str) -> Iterator[tuple[str, int, int]]:
    """Yield the qualified name, first and last line of each function and class, outer ones first, and of the module last."""

    def inside(node: ast.AST, names: tuple[str, ...]) -> Iterator[tuple[str, int, int]]:
        for child in ast.iter_child_nodes(node):
            if isinstance(child, (ast.FunctionDef, ast.ClassDef)):
                start = min([child.lineno, *(decorator.lineno for decorator in child.decorator_list)])
                yield ".".join((*names, child.name)), start, child.end_lineno or child.lineno
                yield from inside(child, (*names, child.name))
            else:
                yield from inside(child, names)

    yield from inside(ast.parse(code), ())
    yield "", 1, code.count("\n") + 1


def _indented(before: Sequence[str], now: Sequence[str]) -> list[str]:
    """Return the new lines with the indentation of the old ones; further lines have that of the first."""
    indents = [line[: len(line) - len(line.lstrip())] for line in before]
    if len(now) != len(before):
        indents = [indents[0]] * len(now)
    return [indent + line for indent, line in zip(indents, now, strict=True)]


def _is_python(code: str) -> bool:
    try:
        ast.parse(code)
    except SyntaxError:
        return False
    return True


def table(config: Config) -> list[Module]:
    """Return the requested modules.

    Raises:
        SystemExit: If there are none.
    """
    text = tomllib.loads((HERE / "mutants.toml").read_text(encoding="utf-8"))
    rows = []
    for row in text["module"]:
        module = Module(**{"quota": text["quota_compiled" if row.get("compiled") else "quota"], **row})
        without = () if module.compiled else tuple(text["without"])
        rows.append(module._replace(quota=config.quota or module.quota, without=without))
    chosen = [
        row
        for row in rows
        if not config.only or any(row.path.removesuffix(".py").endswith(end.removesuffix(".py")) for end in config.only)
    ]
    if not chosen:
        raise SystemExit(f"--only must name modules of benchmarks/mutants.toml, got {' '.join(config.only)}.")
    return chosen


def drawn(modules: list[Module], config: Config) -> list[tuple[Module, Mutant]]:
    """Draw the mutants of each module."""
    return [
        (module, mutant)
        for module in modules
        for mutant in draw(module.path, (ROOT / module.path).read_text(encoding="utf-8"), module.quota, seed=config.seed)
    ]


def replayed(modules: list[Module], config: Config, path: Path) -> tuple[list[tuple[Module, Mutant]], list[Entry]]:
    """Return the mutants of a list that are found in the modules, and the entries that are not."""
    by_path = {module.path: module for module in modules}
    sources = {name: (ROOT / name).read_text(encoding="utf-8") for name in by_path}
    mutants, gone = [], []
    for entry in read_list(path):
        mutant = find(entry, sources)
        if mutant is not None:
            mutants.append((by_path[mutant.path], mutant))
        else:
            gone.append(entry)
    return mutants, gone


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
    if config.record is not None:
        result = json.loads(config.result.read_text(encoding="utf-8"))
        left_out = result["survived"] + result["equivalent"]
        entries = recorded(config.tree, result["config"]["quota"], result["config"]["seed"], left_out)
        write_list(config.record, entries)
        print(f"{config.record}: {len(entries)} mutants of {len(result['config']['quota'])} modules")
        return
    modules, start, gone = table(config), time.monotonic(), []
    if config.replay is not None:
        mutants, gone = replayed(modules, config, config.replay)
    else:
        mutants = drawn(modules, config)
    modules = [module for module in modules if any(module is of for of, _ in mutants)]
    results = sorted(
        judge_all(mutants, config.jobs), key=lambda result: (result.mutant.path, result.mutant.line, result.mutant.now)
    )
    scores, minutes = summary(modules, results), (time.monotonic() - start) / 60.0
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    busy = (used.ru_utime + used.ru_stime) / 60.0
    shown = Table("module", "mutants", "killed", "timeout", "survived", "equivalent", "score")
    for name, row in scores.items():
        score = "" if row["score"] is None else f"{100 * row['score']:.0f} %"
        shown.add_row(name, *(str(row[key]) for key in ("mutants", "killed", "timeout", "survived", "equivalent")), score)
    listed: dict[str, list[Any]] = {"survived": [], "equivalent": []}
    for result in results:
        m = result.mutant
        if result.outcome in listed:
            entry = {"path": m.path, "line": m.line, "function": m.function, "operator": m.operator, "was": m.was, "now": m.now}
            listed[result.outcome].append(entry | ({"why": result.why} if result.why else {}))
        if result.outcome == "survived":
            print(f"{m.path}:{m.line} {m.function} {m.operator}\n- {m.was}\n+ {m.now}\n")
    print_tables(shown)
    for entry in gone:
        print(f"{entry.path} {entry.function} {entry.operator}: not found\n- {entry.was}\n+ {entry.now}\n")
    print(f"{minutes:.0f} minutes, {busy:.0f} of processor time; seed {config.seed}")
    if gone:
        print(f"{len(gone)} of {len(gone) + len(results)} mutants are not found: their code has changed.")
    if config.json:
        settings = {"seed": config.seed, "quota": {module.path: module.quota for module in modules}, "jobs": config.jobs}
        content = {"minutes": minutes, "processor_minutes": busy, "modules": scores, **listed, "gone": gone}
        write_json(config.json, content, config=settings)


if __name__ == "__main__":
    main()

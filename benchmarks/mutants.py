"""Change the code at random places, one change at a time, and count how many changes the tests notice.

The table of modules, with the tests of each and its number of mutants, is `mutants.toml`; mutants that no test could notice are
in `equivalent_mutants.toml`, each with the reason, and do not count. Mutants live in copies of the project in a temporary
folder: an interrupted run leaves nothing behind.

    python benchmarks/mutants.py
    python benchmarks/mutants.py --only presets parameters --quota 100

``--record`` writes the mutants that died in an earlier result as a list, drawn from the clone of that time, and ``--replay``
tests the mutants of such a list wherever their code is now:

    python benchmarks/mutants.py --record died.json --result benchmarks/mutants.json --tree ../before
    python benchmarks/mutants.py --replay died.json
"""

from __future__ import annotations

import json
import resource
import signal
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tomllib
import tyro
from rich.table import Table

import mutant_list
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


def replayed(modules: list[Module], config: Config, path: Path) -> tuple[list[tuple[Module, Mutant]], list[mutant_list.Entry]]:
    """Return the mutants of a list that are found in the modules, and the entries that are not."""
    by_path = {module.path: module for module in modules}
    sources = {name: (ROOT / name).read_text(encoding="utf-8") for name in by_path}
    mutants, gone = [], []
    for entry in mutant_list.read(path):
        mutant = mutant_list.find(entry, sources)
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
        entries = mutant_list.record(config.tree, result["config"]["quota"], result["config"]["seed"], left_out)
        mutant_list.write(config.record, entries)
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

"""Plant defects in copies of the project, and show that the faults, or the tests that are named, notice each.

For every kind of fault, `faults_planted.toml` names a defect that makes it unsafe. A defect is found if each of its kinds was
unsafe within some injections, or each of its tests has failed. One whose text is not in its file, or occurs there twice, counts
as not found: it was not planted. Each changed module writes down where it was imported, and by what: a defect that no node of
its copy has imported is not in force, and counts as not found. An interrupted run goes on where it was.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tomllib
from rich.table import Table

from faults_chain import MARK
from faults_kinds import FAULTS
from harness.study import Study, each, run

ROOT = Path(__file__).parents[1]
TABLE = Path(__file__).with_suffix(".toml")
PARTS = "turtlebot_gym", "agents", "bridges", "lab", "benchmarks", "tests", "pyproject.toml", "README.md"
"""What a copy holds."""
_BUILD = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["hatch"]["build"]["targets"]
PATHS = tuple(dict.fromkeys(str(Path(package).parent) for package in _BUILD["wheel"]["packages"]))
"""Where its packages are: those of the wheel, so that none is imported from where the project is installed."""
WITNESS = """
with open({imported!r}, "a") as _imported:
    _imported.write(f"{{__file__}}\\t{{'{mark}' in __import__('os').environ}}\\n")
"""
"""What a changed module does besides: it writes where it is, and whether a node of a chain has imported it."""


@dataclass(frozen=True, kw_only=True)
class Config(Study):
    """Plant defects."""

    only: tuple[str, ...] = ()
    """Defects by their names; none for all."""
    named: bool = False
    """Whether only the defects that people have named are planted."""
    tries: int = 4
    """Most injections of each kind."""
    at_once: int = 2
    """Number of defects at a time."""
    workers: int = 3
    """Number of robots for each."""
    kept: Path | None = None
    """File of the finished defects, with which an interrupted run goes on; none to keep nothing."""


def defects(config: Config) -> list[dict[str, Any]]:
    """Return the defects to plant."""
    rows = tomllib.loads(TABLE.read_text(encoding="utf-8"))["defect"]
    return [row for row in rows if (not config.only or row["name"] in config.only) and (row.get("named") or not config.named)]


def without_defect() -> list[str]:
    """Return the kinds of fault for which no defect is listed."""
    planted = {kind for row in defects(Config()) for kind in row.get("kinds", [])}
    return [name for name in FAULTS if name not in planted]


def plant(defect: dict[str, Any], into: Path) -> None:
    """Copy the project, change its texts, and let each changed module say that it was imported.

    Raises:
        ValueError: If a text does not occur exactly once in its file.
    """
    for part in PARTS:
        source = ROOT / part
        if source.is_dir():
            shutil.copytree(source, into / part, symlinks=True)
        else:
            shutil.copy2(source, into / part)
    for edit in defect["edit"]:
        path = into / edit["file"]
        text = path.read_text(encoding="utf-8")
        if text.count(edit["old"]) != 1:
            raise ValueError(f"{edit['old']!r} occurs {text.count(edit['old'])} times in {edit['file']}")
        path.write_text(text.replace(edit["old"], edit["new"]), encoding="utf-8")
    for name in files_of(defect):
        with (into / name).open("a", encoding="utf-8") as file:
            file.write(WITNESS.format(imported=str(into / "imported"), mark=MARK))


def files_of(defect: dict[str, Any]) -> list[str]:
    """Return the files that a defect changes, each once."""
    return [*dict.fromkeys(edit["file"] for edit in defect["edit"])]


def not_in_force(defect: dict[str, Any], copy: Path) -> list[str]:
    """Return the changed files that were not imported where the defect is looked for: by nodes, or by tests."""
    seen = (copy / "imported").read_text(encoding="utf-8").splitlines() if (copy / "imported").is_file() else []
    by = bool(defect.get("kinds"))
    return [name for name in files_of(defect) if f"{copy / name}\t{by}" not in seen]


def environment_of(copy: Path) -> dict[str, str]:
    """Return the variables with which a copy's own packages are imported."""
    return {**os.environ, "PYTHONPATH": os.pathsep.join(str(copy / path) for path in PATHS)}


def find(defect: dict[str, Any], config: Config) -> dict[str, Any]:
    """Plant a defect, and return who noticed it."""
    begun = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder).resolve()
        try:
            plant(defect, copy)
        except (ValueError, OSError) as error:
            return {"name": defect["name"], "found": False, "by": {}, "why": f"not planted: {error}", "seconds": 0.0}
        environment = environment_of(copy)
        by = {test: _fails(test, copy, environment) for test in defect.get("tests", [])}
        by |= _unsafe(defect.get("kinds", []), config, copy, environment)
        absent = not_in_force(defect, copy)
    missed = [name for name, why in by.items() if not why]
    why = f"not noticed by {', '.join(missed)}" if missed else "" if by else "nobody looks"
    why = f"not in force: no process of the copy has imported {', '.join(absent)}" if absent else why
    return {"name": defect["name"], "found": not why, "by": by, "why": why, "seconds": time.monotonic() - begun}


def _fails(test: str, copy: Path, environment: dict[str, str]) -> str:
    """Return the last words of a test that fails, or an empty text if it passes or does not run."""
    command = [sys.executable, "-m", "pytest", "-q", "-x", "--no-header", "-p", "no:cacheprovider", test]
    done = subprocess.run(command, cwd=copy, env=environment, capture_output=True, text=True)
    return done.stdout.strip().splitlines()[-1] if done.returncode == 1 else ""


def _unsafe(kinds: list[str], config: Config, copy: Path, environment: dict[str, str]) -> dict[str, str]:
    """Return by kind why it was unsafe, an empty text if it was not."""
    if not kinds:
        return {}
    results = copy / "results.json"
    words = [
        "--only",
        *kinds,
        "--faults",
        str(config.tries * len(kinds)),
        "--until-unsafe",
        "--workers",
        str(config.workers),
        "--busy",
        "0",
        "--json",
        str(results),
    ]
    done = subprocess.run(
        [sys.executable, "benchmarks/faults.py", *words], cwd=copy, env=environment, capture_output=True, text=True
    )
    if not results.is_file():
        print(done.stderr, file=sys.stderr)
        return dict.fromkeys(kinds, "")
    counts = json.loads(results.read_text(encoding="utf-8"))["faults"]
    return {kind: next(iter(counts[kind]["reasons"]), "") for kind in kinds}


def measure(config: Config) -> tuple[dict[str, Any], list[Table]]:
    """Return which defects were found, and their table."""
    wanted, begun = defects(config), time.monotonic()
    rows = [json.loads(line) for line in config.kept.read_text().splitlines()] if config.kept and config.kept.is_file() else []
    rows = [row for row in rows if row["name"] in {defect["name"] for defect in wanted}]
    wanted = [defect for defect in wanted if defect["name"] not in {row["name"] for row in rows}]
    with ThreadPoolExecutor(config.at_once) as pool:
        futures = [pool.submit(find, defect, config) for defect in wanted]
        for future in each(as_completed(futures), "defects", len(wanted)):
            rows.append(row := future.result())
            if config.kept:
                with config.kept.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(row) + "\n")
            print(f"{row['name']}: {row['why'] or 'found'}, {row['seconds']:.0f} s", file=sys.stderr, flush=True)
    minutes, found = (time.monotonic() - begun) / 60.0, sum(row["found"] for row in rows)
    table = Table("planted defect", "found", "s", "by", caption=f"{found} of {len(rows)} found in {minutes:.1f} minutes")
    for row in rows:
        by = "; ".join(f"{name}: {why}" for name, why in row["by"].items() if why)
        table.add_row(row["name"], "yes" if row["found"] else "NO", f"{row['seconds']:.0f}", row["why"] or by)
    return {"defects": rows, "found": found, "planted": len(rows), "minutes": minutes}, [table]


if __name__ == "__main__":
    _, results = run(Config, measure)
    raise SystemExit(results["found"] < results["planted"])

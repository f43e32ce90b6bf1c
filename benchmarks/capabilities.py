"""Run what the CHANGELOG says that there is, one command after the other, and write a table of their last lines.

The list is `capabilities.toml`. The commands run in an empty folder, where later ones find the files of earlier ones.

    python benchmarks/capabilities.py --markdown out/capabilities.md
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import tomllib
import tyro

from harness.pairs import environment_of
from harness.tables import markdown

HERE = Path(__file__).parent
ROOT = HERE.parent
MISSING = "left out: {} is missing"


@dataclass(frozen=True, kw_only=True)
class Config:
    """Run the capabilities of the CHANGELOG."""

    only: str = ""
    """Run those whose line of the CHANGELOG contains this."""
    data: Path = ROOT.parent / "shared" / "data"
    """Folder of recorded drives."""
    seconds: float = 300.0
    """Longest time of a command, s."""
    markdown: Path | None = None
    """Write the table here."""


class Shown(NamedTuple):
    """What a command did."""

    says: str
    """Beginning of the line in the CHANGELOG."""
    command: str
    last: str
    """Last line of its output."""
    status: int | None
    """Exit status; None if it was left out."""
    seconds: float


def read() -> dict[str, Any]:
    """Return the list."""
    return tomllib.loads((HERE / "capabilities.toml").read_text(encoding="utf-8"))


def unlisted(changelog: str, listed: Mapping[str, Any]) -> list[str]:
    """Return the lines of the CHANGELOG that neither a command nor the list of pages has."""
    lines = [part.split("\n\n")[0] for part in changelog.split("\n* ")[1:]]
    known = (*listed["pages"], *(row["says"] for row in listed["capability"]))
    return [" ".join(line.split())[:80] for line in lines if not line.startswith(tuple(known))]


def show(row: Mapping[str, str], folder: Path, config: Config) -> Shown:
    """Run one command."""
    needed = row.get("needs")
    there = config.data.is_dir() if needed == "data" else bool(needed and (find_spec(needed) or shutil.which(needed)))
    text = row.get("run") or row["python"]
    command = text.replace("{root}", str(ROOT)).replace("{data}", str(config.data.resolve()))
    label = " ".join(text.split())
    if needed and not there:
        return Shown(row["says"], label, MISSING.format(needed), None, 0.0)
    program = ["bash", "-o", "pipefail", "-c", command] if "run" in row else [sys.executable, "-c", command]
    search = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    start = time.monotonic()
    try:
        done = subprocess.run(
            program, cwd=folder, env={**os.environ, "PYTHONPATH": environment_of(ROOT)["PYTHONPATH"], "PATH": search},
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=config.seconds,
        )  # fmt: skip
        status, output = done.returncode, done.stdout
    except subprocess.TimeoutExpired:
        status, output = 124, f"longer than {config.seconds:g} s"
    lines = [line.strip(" │") for line in output.splitlines() if any(letter.isalnum() for letter in line)]
    return Shown(row["says"], label, lines[-1] if lines else "", status, time.monotonic() - start)


def table(rows: list[Shown]) -> str:
    """Return the results in Markdown."""
    cells = [(row.says, f"`{row.command[:120]}`", str(row.status), f"`{row.last[:120]}`", f"{row.seconds:.0f}") for row in rows]
    bars = [[cell.replace("|", "¦") for cell in line] for line in cells]
    return markdown(("capability", "command", "status", "last line", "s"), bars) + "\n"


def main() -> None:
    """Run, print, and write the table; the exit status is 1 if a command failed."""
    config, listed = tyro.cli(Config, description=__doc__), read()
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for row in listed["capability"]:
            if config.only in row["says"]:
                shown = show(row, Path(folder), config)
                rows.append(shown)
                word = "FAILED" if shown.status else "ok"
                print(f"{word:6} {shown.seconds:4.0f} s  {shown.says}: {shown.last}", flush=True)
    if config.markdown is not None:
        config.markdown.parent.mkdir(parents=True, exist_ok=True)
        config.markdown.write_text(table(rows), encoding="utf-8")
    for line in unlisted((ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), listed):
        print(f"not in capabilities.toml: {line}")
    failed = [row for row in rows if row.status]
    print(f"{len(rows) - len(failed)} of {len(rows)} commands succeeded.")
    raise SystemExit(bool(failed))


if __name__ == "__main__":
    main()

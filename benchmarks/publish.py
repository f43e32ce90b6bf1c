"""Copy the studies' results from `out/` into the repository, and the findings of `robustness.py` into the README.

Nothing in the repository changes before this step, so that results carry a clean commit. `make study` and `make study-rooms`
run it last.
"""

from __future__ import annotations

import json
from pathlib import Path
from shutil import copyfile
from textwrap import fill

from robustness_text import headline

BEGIN, END = "<!-- The study's findings, by benchmarks/publish.py -->", "<!-- The end of the study's findings -->"
SHIPPED = tuple(f"out/pretrained/ppo-{task}.{kind}" for task in ("nav", "pose", "square") for kind in ("onnx", "md"))
PLACES = {
    "benchmarks": (
        "out/study/robustness.json",
        "out/study/robustness.png",
        "out/pretrained/pretrained.json",
        "out/rooms/rooms_study.json",
    ),
    "agents/pretrained": (*SHIPPED, "out/rooms/ppo-rooms.onnx", "out/rooms/ppo-rooms.md"),
}
"""Files by target folder."""
WIDTH = 128


def findings(study: Path) -> str:
    """Return the README's passage."""
    results = json.loads(study.read_text(encoding="utf-8"))
    return fill(headline(results), WIDTH, break_on_hyphens=False)


def between(page: str, passage: str, begin: str, end: str) -> str:
    """Return a page with the passage between two marks replaced.

    Raises:
        ValueError: If the page lacks a mark.
    """
    before, found_begin, rest = page.partition(begin)
    _, found_end, after = rest.partition(end)
    if not (found_begin and found_end):
        raise ValueError(f"The page must hold {begin!r} and {end!r}.")
    return f"{before}{begin}\n\n{passage}\n\n{end}{after}"


def main() -> None:
    """Copy the existing files, and write the README's passage."""
    for folder, sources in PLACES.items():
        for source in filter(Path.is_file, map(Path, sources)):
            copyfile(source, Path(folder) / source.name)
            print(f"{source} -> {folder}")
    readme = Path("README.md")
    passage = findings(Path("benchmarks/robustness.json"))
    readme.write_text(between(readme.read_text(encoding="utf-8"), passage, BEGIN, END), encoding="utf-8")


if __name__ == "__main__":
    main()

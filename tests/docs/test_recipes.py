"""The recipes of CONTRIBUTING, followed to the letter: their files stand beside the package's own, their code runs."""

import os
import subprocess
import sys

import pytest
from pages import ROOT, blocks_of

pytest.importorskip("stable_baselines3", reason="needs the extra [agents]")

PAGE = ROOT / "CONTRIBUTING.md"
HEADINGS = {
    number: line.removeprefix("### ")
    for number, line in enumerate(PAGE.read_text(encoding="utf-8").splitlines(), 1)
    if line.startswith("### ")
}
PRELUDE = """
import importlib
for package in {packages!r}:
    name = package.replace("/", ".")
    module = importlib.import_module(name)
    module.__path__.append({root!r} + "/" + package)
for line, text in {blocks!r}:
    exec(compile("\\n" * line + text, {page!r}, "exec"))
"""


def recipe(heading):
    """Return the code blocks below a heading."""
    starts = [*HEADINGS, 10**6]
    first = next(number for number, text in HEADINGS.items() if text == heading)
    after = min(number for number in starts if number > first)
    return [block for block in blocks_of(PAGE) if first < block.line < after]


def follow(headings, folder, *, plain):
    """Write the files of recipes, and run their other blocks in one process, in plain Python or compiled."""
    blocks = [block for heading in headings for block in recipe(heading)]
    files = {block.title: block.text for block in blocks if block.title}
    for title, text in files.items():
        (folder / title).parent.mkdir(parents=True, exist_ok=True)
        (folder / title).write_text(text, encoding="utf-8")
    packages = sorted({title.rpartition("/")[0] for title in files})
    run = [(block.line, block.text) for block in blocks if not block.title]
    script = PRELUDE.format(packages=packages, root=str(folder), blocks=run, page=str(PAGE))
    return subprocess.run(
        [sys.executable, "-W", "error", "-c", script],
        cwd=ROOT,
        env={**os.environ, "TURTLEBOT_GYM_PLAIN": str(int(plain))},
        capture_output=True,
        text=True,
    )


def test_each_extension_has_a_recipe():
    for heading in ("A sensor", "A filter", "A plant"):
        assert any("assert " in block.text for block in recipe(heading) if not block.title), heading


@pytest.mark.sample(1)
@pytest.mark.parametrize(
    ("headings", "plain"),
    [
        *((headings, True) for headings in (["A sensor", "A filter"], ["A plant"])),
        pytest.param(["A sensor", "A filter"], False, marks=pytest.mark.slow),
    ],
    ids=str,
)
def test_a_recipe_works_to_the_letter(headings, plain, tmp_path):
    done = follow(headings, tmp_path, plain=plain)
    assert done.returncode == 0, done.stderr

"""The prose linter: looks for the phrases of `words.toml` in pages, notebooks, docstrings, comments, messages and launch files.

    python tests/docs/prose.py [PATH ...]

prints one line for each finding and exits with 1 if there is any. Without paths it reads the whole project. Code, in pages
and in docstrings, is not read.
"""

import ast
import io
import json
import re
import sys
import tokenize
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

import tomllib
from markdown_it import MarkdownIt

ROOT = Path(__file__).parents[2]
WORDS = Path(__file__).with_name("words.toml")
WHOLE = (
    "README.md", "CONTRIBUTING.md", "CHANGELOG.md", "SECURITY.md", "docs", "notebooks", "agents", "benchmarks", "bridges",
    "checker", "tests", "turtlebot_gym",
)  # fmt: skip
"""What `make check` reads."""
SAMPLES = "test_prose.py"
"""File with wrong sentences on purpose."""
MESSAGE = 4
"""Strings of fewer words are names and options, not sentences."""


class Rule(NamedTuple):
    """An entry of `words.toml`."""

    pattern: re.Pattern[str]
    write: str
    """What stands there instead."""
    at: str
    """Where it counts: in ``pages`` only, at the ``start`` of a sentence only, or, if empty, everywhere."""
    sample: str
    """A sentence in which it is found."""
    allow: str
    """A sentence in which it is not; may be empty."""


class Passage(NamedTuple):
    """A paragraph, a table cell, a heading, a comment or a message."""

    text: str
    line: int
    """Of its first line, from 1."""
    in_page: bool = True


class Finding(NamedTuple):
    """A phrase that should be another one."""

    path: Path
    line: int
    found: str
    write: str

    def __str__(self) -> str:
        return f"{self.path}:{self.line}: {self.found!r}: write {self.write!r}"


def read_rules() -> list[Rule]:
    """Return the word list."""
    rules = []
    for entry in tomllib.loads(WORDS.read_text(encoding="utf-8"))["rule"]:
        phrase, sample = entry.get("find"), entry.get("sample", entry.get("find", ""))
        pattern = entry["pattern"] if phrase is None else rf"(?i)(?<!\w){re.escape(phrase)}(?!\w)"
        pattern = pattern.replace(r"\ ", " ").replace(" ", r"\s+")  # a phrase may go over the end of a line
        at = entry.get("at", "")
        if "start" in at:
            pattern = rf"(?:\A|(?<=[.:;!?]\s))\W*{pattern}"
        rules.append(Rule(re.compile(pattern), entry["write"], at, sample, entry.get("allow", "")))
    return rules


def _without_code(text: str) -> str:
    """Return a text with code spans and addresses blanked; lines stay where they are."""
    return re.sub(r"(`+)[^`]*\1|https?://\S+", lambda match: "`" + "\n" * match[0].count("\n") + "`", text)


SHOWN = {"softbreak": "\n", "hardbreak": "\n", "code_inline": "`", "html_inline": ""}
"""What stands for the parts of a passage that are not text."""


def of_markdown(text: str, first: int = 1) -> Iterator[Passage]:
    """Return the passages of a Markdown text whose first line has the number `first`."""
    for token in MarkdownIt("commonmark").enable("table").parse(text):
        if token.type == "inline" and token.map is not None:
            parts = [SHOWN.get(child.type, child.content) for child in token.children or ()]
            yield Passage("".join(parts), first + token.map[0])


def of_notebook(text: str) -> Iterator[Passage]:
    """Return the passages of a notebook's text; lines are counted within a cell."""
    for cell in json.loads(text)["cells"]:
        if cell["cell_type"] == "markdown":
            yield from of_markdown("".join(cell["source"]))


def of_python(text: str) -> Iterator[Passage]:
    """Return docstrings, comments and messages of a module, by paragraphs, and the names of its tests as sentences."""
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.FunctionDef) and node.name.startswith("test_"):
            yield Passage(node.name.replace("_", " "), node.lineno, in_page=False)
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and len(node.value.split()) >= MESSAGE:
            if re.search(r"^(from|import) ", node.value, re.MULTILINE):
                continue  # a program
            line = node.lineno
            for paragraph in re.split(r"(\n\s*\n|\n(?=\s*[*-] ))", node.value):
                if paragraph.strip():
                    yield Passage(_without_code(paragraph), line, in_page=False)
                line += paragraph.count("\n")
    last, said = -1, ""
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.COMMENT:
            alone = token.line.lstrip().startswith("#")
            if said and not (alone and token.start[0] == last + 1):
                yield Passage(_without_code(said), last - said.count("\n"), in_page=False)
                said = ""
            said += ("\n" if said else "") + token.string.lstrip("#: ")
            last = token.start[0]
    if said:
        yield Passage(_without_code(said), last - said.count("\n"), in_page=False)


def of_yaml(text: str) -> Iterator[Passage]:
    """Return the comments of a YAML file, each line by itself: most explain the value before them."""
    for number, line in enumerate(text.splitlines(), 1):
        if match := re.search(r"(?:^|\s)#\s+(.*)", line):
            yield Passage(_without_code(match[1]), number, in_page=False)


def of_launch_file(text: str) -> Iterator[Passage]:
    """Return the comments of a launch file, and the descriptions of its arguments."""
    for match in re.finditer(r'<!--(.*?)-->|description="([^"]*)"', text, re.DOTALL):
        yield Passage(_without_code(match[1] or match[2]), text[: match.start()].count("\n") + 1, in_page=False)


READERS = {".md": of_markdown, ".ipynb": of_notebook, ".py": of_python, ".yaml": of_yaml, ".xml": of_launch_file}


def check(passage: Passage, rules: Iterable[Rule]) -> Iterator[tuple[int, str, str]]:
    """Return line, phrase and remedy of all that the rules find in a passage."""
    for rule in rules:
        if "pages" in rule.at and not passage.in_page:
            continue
        for match in rule.pattern.finditer(passage.text):
            line = passage.line + passage.text[: match.start()].count("\n")
            yield line, " ".join(match[0].split())[:60], rule.write


def findings(paths: Iterable[Path], rules: Iterable[Rule]) -> Iterator[Finding]:
    """Return all findings in files, and in the files below folders."""
    for path in paths:
        files = [path] if path.is_file() else sorted(file for file in path.rglob("*") if file.suffix in READERS)
        for file in (file for file in files if file.name != SAMPLES):
            for passage in READERS[file.suffix](file.read_text(encoding="utf-8")):
                yield from (Finding(file, *match) for match in check(passage, rules))


def main() -> int:
    """Check the paths of the command line, or the whole project."""
    paths = [Path(word) for word in sys.argv[1:]] or [ROOT / name for name in WHOLE if (ROOT / name).exists()]
    every = list(findings(paths, read_rules()))
    for finding in every:
        print(finding)
    return int(bool(every))


if __name__ == "__main__":
    raise SystemExit(main())

"""The pages of the documentation, their code blocks and tables, and the results that they tell."""

import json
import os
import sys
from pathlib import Path
from typing import NamedTuple

from markdown_it import MarkdownIt

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


class Block(NamedTuple):
    kind: str
    title: str
    text: str
    line: int


def parsed(path):
    return MarkdownIt("commonmark").enable("table").parse(path.read_text(encoding="utf-8"))


def blocks_of(path):
    """Return the code blocks of a page; a title is the name of the file that a block is."""
    blocks = []
    for token in parsed(path):
        if token.type == "fence":
            kind, _, rest = token.info.partition(" ")
            title = rest.removeprefix('title="').removesuffix('"')
            assert rest in ("", f'title="{title}"'), f"{path}: {token.info}"
            assert token.map is not None
            blocks.append(Block(kind, title, token.content, token.map[0] + 1))
    return blocks


def text_of(page):
    """Return a page in one line, so that a sentence can be found."""
    return " ".join((ROOT / page).read_text(encoding="utf-8").split())


def rows_after(page, words):
    """Return the cells of the first table after some words, without its heading."""
    lines = (ROOT / page).read_text(encoding="utf-8").partition(words)[2].splitlines()
    is_row = [line.startswith("|") for line in lines]
    begin = is_row.index(True)
    table = lines[begin : is_row.index(False, begin)]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in table[2:]]


def measured(name):
    """Return the published results of a benchmark."""
    return json.loads((ROOT / "benchmarks" / f"{name}.json").read_text(encoding="utf-8"))


def environment():
    """Return the environment of a user who has activated the one of these tests."""
    search = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    return {**os.environ, "PATH": search, "DISABLE_MKDOCS_2_WARNING": "true", "NO_MKDOCS_2_WARNING": "true"}

"""The pages of the documentation, and their code blocks."""

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


def blocks_of(path):
    """Return the code blocks of a page; a title is the name of the file that a block is."""
    blocks = []
    for token in MarkdownIt("commonmark").parse(path.read_text(encoding="utf-8")):
        if token.type == "fence":
            kind, _, rest = token.info.partition(" ")
            title = rest.removeprefix('title="').removesuffix('"')
            assert rest in ("", f'title="{title}"'), f"{path}: {token.info}"
            assert token.map is not None
            blocks.append(Block(kind, title, token.content, token.map[0] + 1))
    return blocks


def environment():
    """Return the environment of a user who has activated the one of these tests."""
    search = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    return {**os.environ, "PATH": search, "DISABLE_MKDOCS_2_WARNING": "true", "NO_MKDOCS_2_WARNING": "true"}

"""The long description for package indexes: the README without what only works inside the repository.

A relative link becomes its text with the file's name, and a relative picture is left out, since an index has neither.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from hatchling.metadata.plugin.interface import MetadataHookInterface

PICTURE = re.compile(r"!\[[^\]]*\]\((?!https?:)[^)]*\)\n*|<picture>.*?</picture>\n*", re.DOTALL)
LINK = re.compile(r"\[([^\]]+)\]\((?!https?:)([^)#]*)[^)]*\)")
COMMENT = re.compile(r"<!--.*?-->\n*", re.DOTALL)


def long_description(readme: str) -> str:
    """Return a README's text for a package index."""
    return LINK.sub(r"\1 (`\2`)", PICTURE.sub("", COMMENT.sub("", readme)))


class LongDescription(MetadataHookInterface):
    """Give the project its `readme`."""

    def update(self, metadata: dict[str, Any]) -> None:
        """Put the long description into the project's metadata."""
        text = (Path(self.root) / "README.md").read_text(encoding="utf-8")
        metadata["readme"] = {"content-type": "text/markdown", "text": long_description(text)}

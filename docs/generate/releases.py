"""The release notes: the changelog, with its links as a page has them."""

from pathlib import Path

import mkdocs_gen_files

TITLE = "# Changelog"

text = Path("CHANGELOG.md").read_text(encoding="utf-8")
if not text.startswith(TITLE):
    raise ValueError(f"CHANGELOG.md must begin with {TITLE!r}.")
with mkdocs_gen_files.open("releases.md", "w") as page:
    page.write("# Release notes" + text.removeprefix(TITLE).replace("](docs/", "]("))

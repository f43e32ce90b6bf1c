"""Pages with tables of measured results: the words stand in the page, the tables come from the benchmarks' files."""

import sys
from pathlib import Path

import mkdocs_gen_files

sys.path.insert(0, str(Path("docs/generate").resolve()))
from tables import filled

for path in sorted(Path("docs").rglob("*.md")):
    text = path.read_text(encoding="utf-8")
    if "<!-- table: " in text:
        with mkdocs_gen_files.open(path.relative_to("docs").as_posix(), "w") as page:
            page.write(filled(text))

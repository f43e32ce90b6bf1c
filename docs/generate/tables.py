"""Pages with tables of measured results: the words stand in the page, the tables come from the benchmarks' files."""

import json
import re
import sys
from pathlib import Path

import mkdocs_gen_files
import yaml

sys.path.insert(0, "benchmarks")
from harness.tables import table, tables_of

HERE = Path("docs/generate")
HAZARDS = {
    "cause": "{cause}",
    "what happens": "{effect}",
    "who notices": "{by}",
    "zero after": "{after}",
    "at full speed": "{way}",
    "remains": "{remains}",
}


def tables():
    """Return the tables in Markdown by name."""
    made = {
        f"hazards_{part}": table(rows, HAZARDS) for part, rows in yaml.safe_load((HERE / "hazards.yaml").read_text()).items()
    }
    for path in Path("benchmarks").glob("*.json"):
        made |= tables_of(path.stem, json.loads(path.read_text(encoding="utf-8")))
    return made


def folded(text):
    """Return a table in a box that is closed at first."""
    titles, _, *rows = text.strip().splitlines()
    summary = "; ".join(filter(None, map(str.strip, titles.replace("`", "").split("|"))))
    return f'<details markdown="1">\n<summary>{len(rows)} rows: {summary}</summary>\n\n{text}\n</details>'


def cards():
    """Return the cards of the policies that come with the package, as sections of the page."""
    texts = [path.read_text(encoding="utf-8") for path in sorted(Path("agents/pretrained").glob("ppo-*.md"))]
    return re.sub(r"(?:^\|.*\n)+", lambda found: folded(found[0]) + "\n", "\n".join(texts).replace("# ", "### "), flags=re.M)


if __name__ in ("__main__", "<run_path>"):
    made = tables()
    for path in sorted(Path("docs").rglob("*.md")):
        text = path.read_text(encoding="utf-8")
        if "<!-- table: " in text:
            filled = re.sub(r"<!-- table: (\w+) -->", lambda found: folded(made[found[1]]), text)
            with mkdocs_gen_files.open(path.relative_to("docs").as_posix(), "w") as page:
                page.write(filled.replace("<!-- cards -->", cards()))

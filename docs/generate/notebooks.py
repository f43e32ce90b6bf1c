"""The notebooks as pages: their text, code and stored outputs as Markdown, so that they look like every other page."""

import base64
import json
import re
from pathlib import Path

import mkdocs_gen_files

PICTURES = ("image/png", "image/gif")
"""Kinds of pictures that notebooks hold."""
FENCE = "`" * 6
"""Longer than any fence in a notebook."""


def joined(text):
    """Return a text of a notebook, which may be stored in lines."""
    return text if isinstance(text, str) else "".join(text)


def fenced(kind, text):
    """Return a block of code or output."""
    return f"{FENCE}{kind}\n{text.rstrip()}\n{FENCE}"


def shown(output, stem, number):
    """Return an output in Markdown; a picture is written beside the page."""
    data = output.get("data", {})
    for kind in PICTURES:
        if kind in data:
            name = f"{stem}_{number}.{kind.removeprefix('image/')}"
            with mkdocs_gen_files.open(f"notebooks/{name}", "wb") as file:
                file.write(base64.b64decode(joined(data[kind])))
            return f"![Drawn by the code above]({name})"
    return fenced(" { .text .output }", joined(output["text"] if output["output_type"] == "stream" else data["text/plain"]))


def page_of(path):
    """Return a notebook in Markdown."""
    parts, pictures = [], 0
    for cell in json.loads(path.read_text(encoding="utf-8"))["cells"]:
        source = joined(cell["source"])
        if "colab" in cell["metadata"].get("tags", ()):
            continue
        if cell["cell_type"] == "markdown":
            parts.append(source)
            continue
        parts.append(fenced("python", source))
        for output in cell["outputs"]:
            pictures += any(kind in output.get("data", {}) for kind in PICTURES)
            parts.append(shown(output, path.stem, pictures))
    download = f'This page is a notebook: <a href="{path.name}" download>{path.name}</a>.'
    title, _, rest = "\n\n".join(parts).partition("\n")
    return re.sub(r"\n{3,}", "\n\n", f"{title}\n\n{download}\n{rest}\n")


for path in sorted(Path("notebooks").glob("*.ipynb")):
    with mkdocs_gen_files.open(f"notebooks/{path.stem}.md", "w") as page:
        page.write(page_of(path))
    with mkdocs_gen_files.open(f"notebooks/{path.name}", "w") as notebook:
        notebook.write(path.read_text(encoding="utf-8"))

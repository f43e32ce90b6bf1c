"""The notebooks as pages: their text, code and stored outputs as Markdown, so that they look like every other page."""

import base64
from pathlib import Path

import mkdocs_gen_files
import nbformat

FENCE = "`" * 6
"""Longer than any fence in a notebook."""


def shown(output, name):
    """Return printed text or a picture in Markdown; the picture is written beside the page."""
    if output["output_type"] == "stream":
        return f"{FENCE} {{ .text .output }}\n{output['text'].rstrip()}\n{FENCE}"
    with mkdocs_gen_files.open(f"notebooks/{name}.png", "wb") as file:
        file.write(base64.b64decode(output["data"]["image/png"]))
    return f"![Drawn by the code above]({name}.png)"


for path in sorted(Path("notebooks").glob("*.ipynb")):
    with mkdocs_gen_files.open(f"notebooks/{path.stem}.md", "w") as page:
        for number, cell in enumerate(nbformat.read(path, as_version=4).cells):
            if cell.cell_type == "markdown":
                print(cell.source, "\n", file=page)
            elif "colab" not in cell.metadata.get("tags", ()):
                print(f"{FENCE}python\n{cell.source}\n{FENCE}\n", file=page)
                for at, output in enumerate(cell.outputs):
                    print(shown(output, f"{path.stem}_{number}_{at}"), "\n", file=page)
        print(f'This page is a notebook: <a href="{path.name}" download>{path.name}</a>.', file=page)
    with mkdocs_gen_files.open(f"notebooks/{path.name}", "w") as notebook:
        notebook.write(path.read_text(encoding="utf-8"))

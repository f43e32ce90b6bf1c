"""What MkDocs calls while it builds the site.

Formulas become MathML, which browsers draw without a script; links to ``reference/PACKAGE.md#NAME`` find the page that
describes the name; links to notebooks find their pages; the API's pages enter the navigation; and each picture gets its size, a
link to itself and a box as wide as the page at most.
"""

from __future__ import annotations

import html
import re
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from layout import Page, pages
from math_core import LatexToMathML
from PIL import Image

CONVERTER = LatexToMathML()
INLINE = re.compile(r'<span class="arithmatex">\\\((.*?)\\\)</span>', re.DOTALL)
DISPLAY = re.compile(r'<div class="arithmatex">\s*\\\[(.*?)\\\]\s*</div>', re.DOTALL)
"""What `pymdownx.arithmatex` leaves of a formula."""
API = re.compile(r"\]\((?:[\w./-]*/)?turtlebot_gym\w*\.md#(turtlebot_gym[\w.]*)\)")
NOTEBOOK = re.compile(r"\]\(((?:\.\./)*(?:notebooks/)?\d\d_\w+)\.ipynb\)")
PICTURE = re.compile(r"<p>((?:\s*<img [^>]*>)+)\s*</p>")
CELL = re.compile(
    r"<td([^>]*)>(\s*[+<~\u2212-]?\d[\d.,\s()%+\u00b1\u00d7\u2212-]*(?:e[+-]?\d+)?(?: ?[a-zA-Z/\u00b2%]{1,6})?\s*)</td>"
)
"""A cell of a table that holds a number, with its interval and its unit."""
TITLE = re.compile(r' title="([^"]*)"')
IMG = re.compile(r'<img [^>]*?src="([^"#]+)[^>]*>')


def mathml(formula: str, *, display: bool) -> str:
    """Return a formula in MathML; the LaTeX stays as its alternative text."""
    text = formula.strip()
    made = CONVERTER.convert_with_local_state(text, displaystyle=display)
    return made.replace("<math", f'<math alttext="{html.escape(text, quote=True)}"', 1)


def on_config(config: Any) -> Any:
    """Add the pages of the API below the page of their package."""
    _extend(config["nav"])
    return config


def _extend(items: list[Any]) -> None:
    for item in items:
        for inside in item.values() if isinstance(item, dict) else ():
            if not isinstance(inside, list):
                continue
            if len(inside) == 1 and isinstance(inside[0], str) and inside[0].startswith("reference/turtlebot_gym"):
                inside[:] = [{"Contents": inside[0]}, *(_entry(page) for page in pages(Path(inside[0]).stem))]
            else:
                _extend(inside)


def _entry(page: Page) -> dict[str, Any]:
    title = page.name.rpartition(".")[2]
    return {title: [{"Contents": page.path}, *(_entry(child) for child in page.under)] if page.under else page.path}


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Send links to the API and to notebooks to the pages that there are."""
    return NOTEBOOK.sub(r"](\1.md)", API.sub(r"][\1]", markdown))


def on_page_content(content: str, *, page: Any, config: Any, files: Any) -> str:
    """Turn formulas into MathML, mark the numbers of tables, and give pictures their boxes."""
    content = INLINE.sub(lambda found: mathml(html.unescape(found[1]), display=False), content)
    content = DISPLAY.sub(lambda found: f'<div class="formula">{mathml(html.unescape(found[1]), display=True)}</div>', content)
    content = CELL.sub(r'<td class="number"\1>\2</td>', content)
    folder = Path(page.file.abs_dest_path).parent
    sources = {file.abs_dest_path: file.abs_src_path for file in files if file.abs_src_path}

    def boxed(found: re.Match[str]) -> str:
        return "".join(map(figure, IMG.finditer(found[1])))

    def figure(found: re.Match[str]) -> str:
        width, height = size(Path(sources[str((folder / found[1]).resolve())]))
        tag = found[0].replace("<img ", f'<img width="{width}" height="{height}" loading="lazy" ', 1)
        title = TITLE.search(found[0])
        caption = f"<figcaption>{title[1]}</figcaption>" if title else ""
        return f'<figure class="picture"><a href="{found[1]}">{tag}</a>{caption}</figure>'

    return PICTURE.sub(boxed, content)


def size(path: Path) -> tuple[int, int]:
    """Return width and height of a picture in CSS pixels."""
    if path.suffix != ".svg":
        with Image.open(path) as picture:
            return picture.size
    points = (ElementTree.parse(path).getroot().get(side, "") for side in ("width", "height"))
    width, height = (round(float(side.removesuffix("pt")) * 96.0 / 72.0) for side in points)
    return width, height

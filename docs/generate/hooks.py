"""What MkDocs calls while it builds the site: formulas become MathML; links to the API and to notebooks find their pages."""

from __future__ import annotations

import html
import re
from typing import Any

from math_core import LatexToMathML

CONVERTER = LatexToMathML()
INLINE = re.compile(r'<span class="arithmatex">\\\((.*?)\\\)</span>', re.DOTALL)
DISPLAY = re.compile(r'<div class="arithmatex">\s*\\\[(.*?)\\\]\s*</div>', re.DOTALL)
"""What `pymdownx.arithmatex` leaves of a formula."""
API = re.compile(r"\]\((?:[\w./-]*/)?turtlebot_gym\w*\.md#(turtlebot_gym[\w.]*)\)")
NOTEBOOK = re.compile(r"\]\(((?:\.\./)*(?:notebooks/)?\d\d_\w+)\.ipynb\)")


def mathml(found: re.Match[str], *, display: bool) -> str:
    """Return a formula in MathML, which browsers draw without a script; the LaTeX stays as its alternative text."""
    text = html.unescape(found[1]).strip()
    made = CONVERTER.convert_with_local_state(text, displaystyle=display)
    return made.replace("<math", f'<math alttext="{html.escape(text, quote=True)}"', 1)


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Send links to the API and to notebooks to the pages that there are."""
    return NOTEBOOK.sub(r"](\1.md)", API.sub(r"][\1]", markdown))


def on_page_content(content: str, **_: Any) -> str:
    """Turn formulas into MathML."""
    content = INLINE.sub(lambda found: mathml(found, display=False), content)
    return DISPLAY.sub(lambda found: f'<div class="formula">{mathml(found, display=True)}</div>', content)

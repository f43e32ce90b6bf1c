"""Drives as one file that opens in a browser without a server or a network."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from bokeh.document import Document
from bokeh.embed import file_html
from bokeh.resources import INLINE

from turtlebot_gym.drive import Drive
from turtlebot_gym.files import write_text
from turtlebot_gym_view.view import fill


def _to_html(drives: Sequence[Drive], *, title: str) -> str:
    """Return the view of some drives, as `view.fill` makes it, as a self-contained page."""
    document = Document()
    fill(document, drives, title=title)
    return file_html(document, INLINE, title=title, template=document.template, template_variables=document.template_variables)


def write_html(drives: Sequence[Drive], path: str | Path, *, title: str) -> int:
    """Write the view of some drives, side by side, and return the file's size in bytes; see `view.fill`."""
    path, page = Path(path), _to_html(drives, title=title)
    write_text(path, page)
    return path.stat().st_size

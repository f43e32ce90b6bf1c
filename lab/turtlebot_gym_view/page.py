"""The view of drives: one object that a notebook shows, and that becomes a file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from html import escape
from pathlib import Path

from bokeh.document import Document
from bokeh.embed import file_html
from bokeh.resources import INLINE

from turtlebot_gym.drive import Drive
from turtlebot_gym.files import write_text
from turtlebot_gym_view.view import fill

HEIGHT = 640
"""Height of a page within a notebook, pixels."""


@dataclass(frozen=True, kw_only=True)
class Page:
    """The view of drives.

    The page holds all that it needs: BokehJS, style and data. No request leaves the machine.
    """

    drives: Sequence[Drive] = field(repr=False)
    """The drives, at most six; those in the same room are drawn over each other."""
    title: str = "Drives"
    """Title of the page."""

    def html(self) -> str:
        """Return the page."""
        document = Document()
        fill(document, self.drives, title=self.title)
        variables = document.template_variables
        return file_html(document, INLINE, title=self.title, template=document.template, template_variables=variables)

    def save(self, path: str | Path) -> int:
        """Write the page to a file, and return the file's size in bytes."""
        path = Path(path)
        write_text(path, self.html())
        return path.stat().st_size

    def _repr_html_(self) -> str:
        """Return the page in a frame of its own, for a notebook."""
        frame = f'width="100%" height="{HEIGHT}" style="border: 0" title="{escape(self.title)}"'
        return f'<iframe {frame} srcdoc="{escape(self.html())}"></iframe>'

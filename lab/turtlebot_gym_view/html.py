"""Drives as one file that opens in a browser without a server or a network."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from turtlebot_gym.drive import Drive
from turtlebot_gym_view.page import Page


def write_html(drives: Sequence[Drive], path: str | Path, *, title: str, side_by_side: bool = False) -> int:
    """Write the view of some drives, and return the file's size in bytes; see `page.Page`."""
    return Page(drives=drives, title=title, side_by_side=side_by_side).save(path)

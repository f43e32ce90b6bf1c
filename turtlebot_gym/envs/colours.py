"""Colours of the environments' pictures, on light paper and on dark."""

from __future__ import annotations

from typing import NamedTuple

from turtlebot_gym.plotting import BLACK, BLUE, GREEN, VERMILLION


class Colours(NamedTuple):
    """Colours of a picture, those of the viewer in a browser."""

    paper: str = "#ffffff"
    grid: str = "#ebebeb"
    text: str = "#57606a"
    truth: str = BLACK
    body: str = "#c8c8c8"
    estimate: str = VERMILLION
    goal: str = GREEN
    pale_goal: str = "#99d8c7"
    solid: str = "#555555"
    unknown: str = "#dddddd"
    beam: str = "#f0d9e6"
    walker: str = BLUE


LIGHT = Colours()
DARK = Colours(
    "#15191e",
    "#2b3138",
    "#9aa4af",
    "#f2f2f2",
    "#59616b",
    "#f0813a",
    "#1fbf92",
    "#155c49",
    "#8b9098",
    "#3a3f46",
    "#3f2c3a",
    "#4a9fd8",
)

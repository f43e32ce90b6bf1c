"""Colours and dashes of the view: those of `turtlebot_gym.plotting`, each with a variant for dark pages."""

from __future__ import annotations

from typing import NamedTuple

from turtlebot_gym.plotting import BLACK, BLUE, GREEN, ORANGE, PATHS, PURPLE, SKY_BLUE, VERMILLION


class Ink(NamedTuple):
    """A colour, on light pages and on dark ones."""

    light: str
    dark: str


TRUTH = Ink(BLACK, "#f2f2f2")
ESTIMATE = Ink(VERMILLION, "#f0813a")
ODOMETRY = Ink(SKY_BLUE, SKY_BLUE)
COMMAND = Ink(BLUE, "#4aa8e0")
GOAL = Ink(GREEN, "#1fbf92")
SCAN = Ink(PURPLE, PURPLE)
SOLID = Ink("#777777", "#8b9098")
UNKNOWN = Ink("#dddddd", "#3a3f46")
TEXT = Ink("#24292f", "#d7dce2")
FAINT = Ink("#e3e6ea", "#343a42")
LIMIT = Ink("#57606a", "#9aa4af")
"""Colour of limits: the NIS's 95 % line, contact."""
LEVELS = (Ink(GREEN, "#1fbf92"), Ink(ORANGE, ORANGE), Ink(VERMILLION, "#f0813a"))
"""Colours of the guard's reports: fine, warning, error."""

PRESENT = {
    "truth": TRUTH, "estimate": ESTIMATE, "odometry": ODOMETRY, "goal": GOAL, "scan": SCAN, "solid": SOLID, "text": TEXT,
}  # fmt: skip
"""What `present.js` draws with."""

_BRIGHTER = {BLUE: "#4aa8e0", VERMILLION: "#f0813a"}
_DASHES = {"-": "solid", "--": "dashed", "-.": "dashdot", ":": "dotted"}
_ORDER = (0, 3, 2, 4, 1)
"""Colours of runs in turn; those of the estimate and of the odometry come last."""


def run_style(at: int) -> tuple[Ink, str | list[int]]:
    """Return colour and dashes of one of several runs."""
    color, style = PATHS[_ORDER[at % len(_ORDER)]]
    dashes = _DASHES[style] if isinstance(style, str) else [2 * length for length in style[1]]
    return Ink(color, _BRIGHTER.get(color, color)), dashes

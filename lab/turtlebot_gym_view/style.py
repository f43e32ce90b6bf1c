"""Colours, dashes and fonts of the view, on light pages and on dark ones."""

from __future__ import annotations

from typing import Any, NamedTuple

from bokeh.plotting import figure as Figure

from turtlebot_gym.plotting import BLACK, BLUE, GREEN, ORANGE, PATHS, PURPLE, SKY_BLUE, VERMILLION


class ThemeColour(NamedTuple):
    """A colour, on light pages and on dark ones."""

    light: str
    dark: str


TRUTH = ThemeColour(BLACK, "#f2f2f2")
ESTIMATE = ThemeColour(VERMILLION, "#f0813a")
ODOMETRY = ThemeColour(SKY_BLUE, SKY_BLUE)
COMMAND = ThemeColour(BLUE, "#4aa8e0")
GOAL = ThemeColour(GREEN, "#1fbf92")
SCAN = ThemeColour(PURPLE, PURPLE)
CHART = ThemeColour("#e69f0066", "#e69f0055")
"""Colour of the map of a localizer, over the room."""
SOLID = ThemeColour("#777777", "#8b9098")
UNKNOWN = ThemeColour("#dddddd", "#3a3f46")
TEXT = ThemeColour("#24292f", "#d7dce2")
FAINT = ThemeColour("#e3e6ea", "#343a42")
LIMIT = ThemeColour("#57606a", "#9aa4af")
"""Colour of limits: the NIS's 95 % line, contact."""
LEVELS = (ThemeColour(GREEN, "#1fbf92"), ThemeColour(ORANGE, ORANGE), ThemeColour(VERMILLION, "#f0813a"))
"""Colours of the guard's reports: fine, warning, error."""

PRESENT = {
    "truth": TRUTH,
    "estimate": ESTIMATE,
    "odometry": ODOMETRY,
    "goal": GOAL,
    "scan": SCAN,
    "solid": SOLID,
    "text": TEXT,
}
"""What `present.js` draws with."""

FONT = "system-ui, -apple-system, 'Segoe UI', 'DejaVu Sans', sans-serif"
"""System fonts, so that nothing is fetched."""
_BRIGHTER = {BLUE: "#4aa8e0", VERMILLION: "#f0813a"}
_DASHES = {"-": "solid", "--": "dashed", "-.": "dashdot", ":": "dotted"}
_ORDER = (0, 3, 2, 4, 1)
"""Order of the runs' colours; those of the estimate and of the odometry come last."""


def run_style(at: int) -> tuple[ThemeColour, str | list[int]]:
    """Return colour and dashes of one of several runs."""
    color, style = PATHS[_ORDER[at % len(_ORDER)]]
    dashes = _DASHES[style] if isinstance(style, str) else [2 * length for length in style[1]]
    return ThemeColour(color, _BRIGHTER.get(color, color)), dashes


class Theme:
    """Colours of models by property; the browser sets those of the page's scheme."""

    def __init__(self) -> None:
        self.entries: list[list[Any]] = []
        """Model, name of the property, colour on light pages, colour on dark ones."""

    def paint(self, model: Any, ink: ThemeColour, *names: str) -> None:
        """Set the colour of properties of a model, such as ``line_color``."""
        for name in names:
            setattr(model, name, ink.light)
            self.entries.append([model, name, ink.light, ink.dark])

    def dress(self, figure: Figure) -> None:
        """Give a figure the page's colours and font."""
        figure.background_fill_color = figure.border_fill_color = None
        figure.toolbar.logo = None
        for axis in figure.axis:
            axis.major_label_text_font = axis.axis_label_text_font = FONT
            axis.major_label_text_font_size, axis.axis_label_text_font_size = "11px", "11px"
            axis.axis_label_text_font_style = "normal"
            axis.minor_tick_line_color = None
            self.paint(axis, TEXT, "major_label_text_color", "axis_label_text_color")
            self.paint(axis, FAINT, "axis_line_color", "major_tick_line_color")
        for grid in figure.grid:
            self.paint(grid, FAINT, "grid_line_color")
        self.paint(figure, FAINT, "outline_line_color")
        title: Any = figure.title
        title.text_font, title.text_font_size, title.text_font_style = FONT, "12px", "normal"
        self.paint(title, TEXT, "text_color")

"""Colours, dashes and fonts of the view, on light pages and on dark ones."""

from __future__ import annotations

from typing import Any, NamedTuple

from bokeh.plotting import figure as Figure

from turtlebot_gym.plotting import BLACK, BLUE, GREEN, ORANGE, PURPLE, SKY_BLUE, VERMILLION


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
CHART = ThemeColour("#9cc9f0", "#2f6ea3")
"""Colour of the map of a localizer, below the room."""
SOLID = ThemeColour("#777777", "#8b9098")
UNKNOWN = ThemeColour("#dddddd", "#3a3f46")
TEXT = ThemeColour("#24292f", "#d7dce2")
FAINT = ThemeColour("#e3e6ea", "#343a42")
LIMIT = ThemeColour("#57606a", "#9aa4af")
"""Colour of limits: the NIS's 95 % line, contact."""
LEVELS = (ThemeColour(GREEN, "#1fbf92"), ThemeColour(ORANGE, ORANGE), ThemeColour(VERMILLION, "#f0813a"))
"""Colours of the guard's reports: fine, warning, error."""

LOST = ThemeColour("#852f74", "#e08fc0")
PERSON = ThemeColour("#8a5a2b", "#d6a15f")
"""Colour of people who walk."""

PALE = 0.35
"""Opacity of the other drives while one is looked at."""
FONT = "system-ui, -apple-system, 'Segoe UI', 'DejaVu Sans', sans-serif"
"""System fonts, so that nothing is fetched."""
RUNS: tuple[tuple[ThemeColour, list[int]], ...] = (
    (COMMAND, []),
    (ThemeColour("#c98a00", "#f0c030"), [8, 4]),
    (LOST, [8, 3, 2, 3]),
    (TRUTH, [15, 4]),
    (GOAL, [2, 3]),
    (ThemeColour("#b84a00", "#f0813a"), [8, 3, 2, 3, 2, 3]),
)
"""Colour and dashes of each of several drives; no two share either.

References:
    Okabe, Ito, *Color Universal Design* (2008); some are darkened on light pages.
"""


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

"""Colours that differ between light and dark pages."""

from __future__ import annotations

from typing import Any

from bokeh.plotting import figure as Figure

from turtlebot_gym_agents.watch.style import FAINT, TEXT, Ink

FONT = "system-ui, -apple-system, 'Segoe UI', 'DejaVu Sans', sans-serif"
"""System fonts, so that nothing is fetched."""


class Theme:
    """Colours of models by property; the browser sets those of the page's scheme."""

    def __init__(self) -> None:
        self.entries: list[list[Any]] = []
        """Model, name of the property, colour on light pages, colour on dark ones."""

    def paint(self, model: Any, ink: Ink, *names: str) -> None:
        """Set the colour of properties of a model, such as ``line_color``."""
        for name in names:
            setattr(model, name, ink.light)
            self.entries.append([model, name, ink.light, ink.dark])

    def dress(self, figure: Figure) -> None:
        """Set the page's colours and font for a figure's axes, grid and title, with a transparent background."""
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

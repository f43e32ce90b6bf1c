"""The report of a field test: one page that needs no network, light or dark, for a wide screen and a phone."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym_lab.field.findings import FINE, REFUSED, SKIPPED, WARNING, Figure, Finding

MARKS = {FINE: "✓", WARNING: "!", REFUSED: "✗", SKIPPED: "?"}
"""Sign of each verdict, so that it does not rest on a hue alone."""
_STYLE = Path(__file__).with_name("report.css").read_text(encoding="utf-8")


def shown(figure: Figure) -> tuple[str, str]:
    """Return a figure and its interval as text; an empty text for none."""
    unit = f" {figure.unit.replace('^2', '²')}" if figure.unit else ""
    interval = f"{_number(figure.low)} to {_number(figure.high)}" if math.isfinite(figure.low + figure.high) else ""
    return f"{_number(figure.value)}{unit}", interval


def _number(value: float) -> str:
    return str(int(value)) if float(value).is_integer() and abs(value) < 1e6 else f"{value:.4g}"


def page(
    findings: Sequence[Finding],
    *,
    about: Mapping[str, str],
    paths: Mapping[str, NDArray[np.float64]] | None = None,
    scan: NDArray[np.float64] | None = None,
) -> str:
    """Return the report.

    Args:
        findings: The findings, in order.
        about: Lines of the head: robot, time, computer, where the bag is.
        paths: DriveOptions paths by name, shape (n, 2) each, m.
        scan: End points of the beams of a scan, shape (n, 2), m.
    """
    counts = {verdict: sum(finding.verdict == verdict for finding in findings) for verdict in MARKS}
    summary = ", ".join(f"{count} {verdict}" for verdict, count in counts.items() if count)
    worst = REFUSED if counts[REFUSED] else WARNING if counts[WARNING] else FINE
    head = "".join(f"<p class='soft'>{escape(name)}: {escape(text)}</p>" for name, text in about.items())
    drawings = [_drawing("Paths", paths)] if paths else []
    drawings += [_drawing("A scan, in the LiDAR's frame", {"returns": scan}, dots=True)] if scan is not None else []
    sections = "\n".join([*map(_section, findings), *drawings])
    return (
        "<!DOCTYPE html>\n<html lang='en'>\n<head><meta charset='utf-8'>"
        "<meta name='viewport' content='width=device-width, initial-scale=1'><title>Field test</title>"
        f"<style>{_STYLE}</style></head>\n<body>\n<h1>Field test</h1>\n{head}\n"
        f"<p class='verdict {worst}'><span class='tone'>{MARKS[worst]}</span> {escape(summary or 'nothing was found')}</p>\n"
        f"<main>\n{sections}\n</main>\n</body>\n</html>\n"
    )


def _section(finding: Finding) -> str:
    rows = "".join(map(_row, finding.figures))
    table = f"<table>{rows}</table>" if rows else ""
    advice = f"<p class='advice'>{escape(finding.advice)}</p>" if finding.advice else ""
    return (
        f"<section class='{finding.verdict}'><header><h2>{escape(finding.name)}</h2>"
        f"<span class='tone'>{MARKS[finding.verdict]} {finding.verdict}</span></header>"
        f"<p>{escape(finding.text)}</p>{table}{advice}</section>"
    )


def _row(figure: Figure) -> str:
    value, interval = map(escape, shown(figure))
    interval = f" <span class='interval'>{interval}</span>" if interval else ""
    return f"<tr><td>{escape(figure.name)}</td><td><span>{value}</span>{interval}</td></tr>"


def _drawing(title: str, lines: Mapping[str, NDArray[np.float64]], *, dots: bool = False) -> str:
    """Return a picture of lines, or of dots around the robot, true to scale."""
    points = np.concatenate([np.zeros((1, 2)), *lines.values()])
    (left, low), (right, high) = points.min(0) - 0.2, points.max(0) + 0.2
    scale = 400.0 / max(right - left, high - low)

    def at(rows: Iterable[Sequence[float]]) -> list[str]:
        return [f"{(x - left) * scale:.1f},{(high - y) * scale:.1f}" for x, y in rows]

    inks, shapes, words = ("var(--line)", "var(--other)", "var(--fine)"), [], []
    for number, (name, rows) in enumerate(lines.items()):
        ink = inks[number % len(inks)]
        if dots:
            shapes += [f"<circle cx='{x}' cy='{y}' r='2' fill='{ink}'/>" for x, y in (pair.split(",") for pair in at(rows))]
        else:
            dash = f" stroke-dasharray='{3 * number} {2 * number}'" if number else ""
            shapes.append(f"<polyline points='{' '.join(at(rows))}' fill='none' stroke='{ink}' stroke-width='2'{dash}/>")
        words.append(f"<i class='ink{number}'>{'●' if dots else '―' if not number else '┄'}</i> {escape(name)}")
    (home,) = at([(0.0, 0.0)])
    x, y = home.split(",")
    shapes.append(f"<circle cx='{x}' cy='{y}' r='5' fill='none' stroke='var(--text)' stroke-width='2'/>")
    metre = f"M 8 {(high - low) * scale - 8:.1f} h {scale:.1f}"
    shapes.append(f"<path d='{metre}' stroke='var(--text)' stroke-width='2'/>")
    shapes.append(f"<text x='8' y='{(high - low) * scale - 14:.1f}'>1 m</text>")
    size = f"0 0 {(right - left) * scale:.1f} {(high - low) * scale:.1f}"
    words.append(f"○ {'LiDAR' if dots else 'start'}")
    return (
        f"<section class='wide'><h2>{escape(title)}</h2><p class='soft'>{' &nbsp; '.join(words)}</p>"
        f"<svg viewBox='{size}' role='img' aria-label='{escape(title)}'>{''.join(shapes)}</svg></section>"
    )

"""Report of a calibration: tables for the terminal, a figure, and the comment above a noise file."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from rich.table import Table

from turtlebot_gym.plotting import BLUE, ORANGE, VERMILLION
from turtlebot_gym_agents.figures import legends_below
from turtlebot_gym_lab.calibration import Calibration, CalibrationEstimate
from turtlebot_gym_lab.calibration.shown import Drift, Residuals, drift, residuals

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


BINS = 60
"""Bins of the histograms."""


def _basis(fitted: Calibration) -> str:
    source = "measured poses" if fitted.kind == "pose" else "wheel odometry"
    to = "the truth" if fitted.has_truth else "the innovations alone"
    return f"{source}, fitted to {to}, integrator {fitted.integrator}"


def calibration_tables(fitted: Calibration, *, title: str) -> list[Table]:
    """Return tables of the estimates of a log, of what it does not determine, and of remarks."""
    table = Table(
        "",
        "value",
        "95 % interval",
        "unit",
        "in the file",
        title=f"{title}: {_basis(fitted)}",
        caption="* by the profile likelihood; what is not determined stays as usual",
    )
    for name, estimate in fitted.estimates.items():
        value = f"{estimate.value:.4g}" if estimate.is_determined else "not determined"
        table.add_row(name, value, interval_text(estimate), estimate.unit, _in_file(fitted, name))
    tables, lacking = [table], {name: each.remedy for name, each in fitted.estimates.items() if not each.is_determined}
    if lacking | fitted.unknown:
        tables.append(Table("not determined by this log", "what would determine it"))
        for name, remedy in (lacking | fitted.unknown).items():
            tables[-1].add_row(name, remedy)
    if fitted.remarks:
        tables.append(Table("found in the log"))
        for remark in fitted.remarks:
            tables[-1].add_row(remark)
    return tables


def interval_text(estimate: CalibrationEstimate) -> str:
    """Return an interval with as many digits as tell its ends apart; one without a width says nothing of an error."""
    low, high = estimate.low, estimate.high
    if low == high:
        return "undetermined"
    digits = next((digits for digits in range(4, 12) if f"{low:.{digits}g}" != f"{high:.{digits}g}"), 12)
    upper = f"{high:.{digits}g}" if math.isfinite(high) else "?"
    return f"{low:.{digits}g} to {upper}{' *' if estimate.is_profile else ''}"


def _in_file(fitted: Calibration, name: str) -> str:
    from turtlebot_gym_lab.calibration.coordinates import PARAMETERS, value_of

    if name not in PARAMETERS and name != "dropout_probability":
        return "-"
    value = value_of(fitted.noise, name) if name in PARAMETERS else fitted.noise.odometry.dropout_probability
    return f"{value:.4g}"


def comment(fitted: Calibration, name: str, version: str) -> str:
    """Return the comment above the numbers in a noise file."""
    lines = [f"Calibrated from {name} by turtlebot-gym {version}: {_basis(fitted)}."]
    for key, estimate in fitted.estimates.items():
        value = f"{estimate.value:.4g}" if estimate.is_determined else f"not determined ({estimate.remedy})"
        lines.append(f"{key}: {value}, 95 % interval {interval_text(estimate)} {estimate.unit}".rstrip())
    lines += [f"{key}: unknown; {remedy}" for key, remedy in fitted.unknown.items()]
    lines += [f"Found: {remark}" for remark in fitted.remarks]
    lines.append(fitted.verdict.text)
    return "\n".join(lines)


def calibration_figure(fitted: Calibration, *, title: str) -> Figure:
    """Return a figure of errors, measured and fitted: histograms, and drift by distance.

    Raises:
        ValueError: If the calibration has no truth.
    """
    from matplotlib.figure import Figure

    if not fitted.has_truth:
        raise ValueError("a figure shows errors, which need the truth: leave out --plot.")
    number = 3 * (fitted.kind == "pose")
    figure = Figure(figsize=(3.2 * (number + 2), 3.4), layout="constrained")
    panels = iter(figure.subplots(1, number + 2))
    shown, drifts = residuals(fitted), drift(fitted)
    for at, name in enumerate(("x (m)", "y (m)", "heading (rad)")[:number]):
        _draw_histogram(next(panels), fitted, shown, at, f"measured minus true {name}")
    for at, name in enumerate(("position (m)", "heading (rad)")):
        _draw_drift(next(panels), drifts, at, name)
    figure.suptitle(title)
    return legends_below(figure)


def _draw_histogram(axes: Axes, fitted: Calibration, shown: Residuals, at: int, label: str) -> Axes:
    values, deviations = shown.values[:, at], shown.deviations[:, at]
    axes.hist(values, bins=BINS, density=True, color=BLUE, alpha=0.5, label="measured")
    x = np.linspace(values.min(), values.max(), 300)
    spikes = [(1.0, 0.0)]
    if at == 2:
        share, size = fitted.likeliest.odometry.spike_probability, fitted.likeliest.odometry.spike
        spikes = [(1.0 - share, 0.0), (0.5 * share, size), (0.5 * share, -size)]
    s = np.sqrt((deviations**2).mean())
    density = sum(weight * np.exp(-0.5 * ((x - mean) / s) ** 2) for weight, mean in spikes) / (s * math.sqrt(2.0 * math.pi))
    axes.plot(x, density, color=VERMILLION, label="fitted")
    axes.set(xlabel=label, ylabel="density", yscale="log", ylim=(0.5 / (len(values) * np.ptp(values) / BINS), None))
    return axes


def _draw_drift(axes: Axes, drifts: Drift, at: int, label: str) -> Axes:
    axes.plot(drifts.length, drifts.measured[:, at], "o", color=BLUE, label="measured")
    axes.plot(drifts.length, drifts.fitted[:, at], "--", color=ORANGE, label="fitted")
    axes.set(xlabel="driven distance (m)", ylabel=f"RMS drift of the {label}", xlim=(0.0, None), ylim=(0.0, None))
    axes.grid(alpha=0.3)
    return axes

"""The study's figure: PPO minus the tuned baseline in every scenario, and the gain from tuning the baseline."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

GREEN, VERMILLION, GREY = "#009E73", "#D55E00", "#666666"
VERDICTS = {"PPO faster": (GREEN, "^"), "PPO slower": (VERMILLION, "v"), "no difference found": (GREY, "o")}
"""Colour and marker of each verdict after the correction for the number of scenarios."""

LINEAR = 0.2
"""Largest difference drawn on a linear scale, s."""
TICKS = (-5.0, -2.0, -1.0, -0.5, -0.2, -0.1, 0.0, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0)


def draw(rows: Sequence[dict[str, Any]]) -> Figure:
    """Draw comparisons from `robustness.py`, one line per scenario."""
    figure = Figure(figsize=(11.5, 1.9 + 0.36 * len(rows)), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True, width_ratios=[2.2, 1.0])
    at = np.arange(len(rows))[::-1]
    for y, row in zip(at, rows, strict=True):
        difference = row["ppo"]["difference"]
        colour, marker = VERDICTS[row["verdict"]]
        margins = [[difference["value"] - difference["low"]], [difference["high"] - difference["value"]]]
        left.errorbar(difference["value"], y, xerr=margins, fmt=marker, color=colour, capsize=3, markersize=7)
        base = row["baselines"][0]
        right.barh(y, base["time_untuned"]["value"] - base["time"]["value"], height=0.55, color=GREY)
    names = [f"{row['scenario']}\n{_times(row)}" for row in rows]
    left.set_yticks(at, names, fontsize=8.5)
    left.axvline(0.0, color="black", linewidth=0.8)
    left.set_xscale("symlog", linthresh=LINEAR)
    left.set_xticks(TICKS, [f"{tick:g}" for tick in TICKS])
    left.xaxis.minorticks_off()
    ends = [row["ppo"]["difference"][end] for row in rows for end in ("low", "high")]
    left.set_xlim(min(-1.5 * LINEAR, 1.2 * min(ends)), max(1.5 * LINEAR, 1.2 * max(ends)))
    left.set_xlabel(f"PPO minus the tuned baseline (s): left of the line PPO is faster\nlogarithmic beyond {LINEAR:g} s")
    right.set_xlabel("the baseline's defaults\nminus tuned (s)")
    for axes in (left, right):
        axes.grid(axis="x", alpha=0.3)
        axes.set_axisbelow(True)
        axes.tick_params(axis="y", length=0)
        axes.spines[["top", "right"]].set_visible(False)
    handles = [
        Line2D([], [], color=colour, marker=marker, linestyle="none", markersize=7, label=name)
        for name, (colour, marker) in VERDICTS.items()
    ]
    first = rows[0]["ppo"]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), frameon=False)
    figure.suptitle(
        f"{first['trainings']} trainings and {first['episodes']} paired episodes to a scenario; 95 % intervals over both",
        fontsize=10,
    )
    return figure


def _times(row: dict[str, Any]) -> str:
    return f"{row['compared_with']} {row['baselines'][0]['time']['value']:.2f} s, PPO {row['ppo']['time']['value']:.2f} s"

"""The eight figures of the pages: a drive around the square, and what the benchmarks measured as dots with intervals."""

import io
import json
import math
import re
import textwrap
from pathlib import Path
from typing import NamedTuple

import gymnasium as gym
import mkdocs_gen_files
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

from turtlebot_gym import SQUARE
from turtlebot_gym.drive import Drive, RoomData
from turtlebot_gym.plotting import (
    BLACK,
    BLUE,
    GREEN,
    ORANGE,
    PURPLE,
    SKY_BLUE,
    VERMILLION,
    draw_over_time,
    draw_trajectory,
)
from turtlebot_gym_agents.policies import BearingPolicy

COLORS = (BLUE, VERMILLION, GREEN, ORANGE, PURPLE, SKY_BLUE, BLACK)
MARKERS = "osD^vPX"
WIDTH, ROW = 5.5, 0.27  # in; a phone shows two thirds of the width; a row is a case
WORLDS = ("clutter", "dense", "corridor", "office", "cellular", "crowd", "map")


class Panel(NamedTuple):
    """What one axis shows of all cases."""

    label: str
    """With the unit."""
    series: dict
    """By its name in the legend, a value of each case: a number, an interval of value, low and high, or None."""
    factor: float = 1.0
    """From the file's unit to the label's."""
    line: float | None = None
    """Where a line marks an aim or no difference."""
    scale: str = "linear"


def read(name):
    """Return the results of a benchmark."""
    return json.loads(Path("benchmarks", f"{name}.json").read_text(encoding="utf-8"))


def dots(cases, *panels):
    """Return a figure with a line for each case and the panels beside each other."""
    several = max(len(panel.series) for panel in panels)
    names = [textwrap.fill(case, 26) for case in cases]
    row = max(ROW, 0.11 * several, *(0.17 * (name.count("\n") + 1) for name in names))
    height = len(cases) * row + (1.0 if several > 1 else 0.6)
    figure = Figure(figsize=(WIDTH, height), layout="constrained")
    axes = figure.subplots(1, len(panels), sharey=True, squeeze=False)[0]
    for ax, panel in zip(axes, panels, strict=True):
        for at, (name, values) in enumerate(panel.series.items()):
            offset = 0.62 * ((at + 0.5) / len(panel.series) - 0.5)
            rows = np.array([(k + offset, *bounds(value)) for k, value in enumerate(values) if value is not None])
            middle, low, high = panel.factor * rows[:, 1:].T
            ax.hlines(rows[:, 0], low, high, color=COLORS[at], linewidth=1.6)
            ax.plot(middle, rows[:, 0], MARKERS[at], color=COLORS[at], markersize=4.5, label=name)
        if panel.line is not None:
            ax.axvline(panel.line, color="0.4", linestyle="--", linewidth=1.0)
        ax.set(xlabel=panel.label, xscale=panel.scale)
        if panel.scale == "log":
            ax.xaxis.set(major_locator=LogLocator(subs=(1.0, 2.0, 5.0)), major_formatter="{x:g}", minor_formatter="")
        ax.grid(axis="x", color="0.88")
        ax.set_axisbelow(True)
        ax.spines[["top", "right"]].set_visible(False)
    axes[0].set(yticks=range(len(cases)), yticklabels=names, ylim=(len(cases) - 0.5, -0.5))
    if several > 1:
        handles = max((ax.get_legend_handles_labels() for ax in axes), key=lambda found: len(found[0]))
        figure.legend(*handles, loc="outside upper center", ncols=min(several, 4), frameon=False)
    return figure


def bounds(value):
    """Return a value and its interval; a number has none."""
    return (value["value"], value["low"], value["high"]) if isinstance(value, dict) else (value, math.nan, math.nan)


def pick(rows, part, **wanted):
    """Return a part of the row with the wanted values, or None."""
    return next((row.get(part) for row in rows if all(row[name] == value for name, value in wanted.items())), None)


def loop():
    """Return a drive around the square from above, and the errors of odometry and estimate over time."""
    env, policy = gym.make("turtlebot_gym/TurtleBotSquare-v0", robot="tutorial", noise="tutorial"), BearingPolicy()
    observation, info = env.reset(seed=0)
    infos, over = [info], False
    while not over:
        observation, _, terminated, truncated, info = env.step(policy(observation))
        infos.append(info)
        over = terminated or truncated
    env.close()
    around = RoomData(goal_radius=SQUARE.radius)
    drive = Drive.stack(infos, time=0.1 * np.arange(len(infos)), around=around)
    figure = Figure(figsize=(WIDTH, 3.4), layout="constrained")
    above, errors = figure.subplots(1, 2)
    draw_trajectory(above, drive)
    draw_over_time(errors, drive, "error")
    figure.legend(*above.get_legend_handles_labels(), loc="outside upper center", ncols=4, frameon=False)
    return figure


def open_ground():
    """Return how much slower PPO is than tuned and untuned baselines."""
    rows = read("robustness")["comparisons"]
    differences = {
        "minus the tuned baseline": [row["ppo"]["difference"] for row in rows],
        "minus the untuned one": [row["ppo"]["time"]["value"] - row["baselines"][0]["time_untuned"]["value"] for row in rows],
    }
    return dots([row["scenario"] for row in rows], Panel("time of PPO (s): right of 0 it is slower", differences, line=0.0))


def gains():
    """Return the time to the goal on odometry and on the estimate, by noise."""
    times = {row["scenario"]: row["baselines"][0]["time"] for row in read("robustness")["comparisons"]}
    noises = [name.rpartition(", ")[2] for name in times if name.startswith("Nav, raw odometry, ")]
    both = {words: [times.get(f"Nav, {words}, {noise}") for noise in noises] for words in ("raw odometry", "estimate")}
    return dots(noises, Panel("time to the goal of the tuned baseline (s)", both))


def missions():
    """Return the goals that are truly reached, by what the robot believes."""
    rows = read("missions")["missions"]
    cases = list(dict.fromkeys((row["world"], row["policy"]) for row in rows))
    beliefs = {
        name: [pick(rows, "goals", world=world, policy=policy, belief=name) for world, policy in cases]
        for name in ("wheels", "localizer", "truth")
    }
    return dots([", ".join(case) for case in cases], Panel("goals truly reached (%)", beliefs, 100.0))


def filters():
    """Return errors of filters beside the bound, and whether they state them."""
    settings = read("estimation")["settings"]
    rows = {
        f"{noise.replace(' without its', ', no')}: {name}": row
        for noise, setting in settings.items()
        if noise != "wheel"
        for name, row in setting["filters"].items()
    }
    errors = {name: [row["ratio"][at] for row in rows.values()] for at, name in enumerate(("x", "y", "heading"))}
    nees = {"": [row["nees"] for row in rows.values()]}
    over = Panel("RMSE over the bound", errors, line=1.0, scale="log")
    return dots(list(rows), over, Panel("NEES (3 is right)", nees, line=3.0, scale="log"))


def buildings():
    """Return the share of key frames at which the pose is lost, in two real buildings."""
    found = read("buildings")["buildings"]
    names = list(next(iter(found.values())))
    lost = {building: [rows[name]["lost"] for name in names] for building, rows in found.items()}
    return dots(names, Panel("key frames with the pose lost (%)", lost, 100.0))


def worlds():
    """Return successes and collisions of three policies by world."""
    rows = read("rooms_study")["rows"] + read("rooms_planner")["rows"]
    panels = [
        Panel(
            label,
            {
                name: [pick(rows, part, setting=world, policy=name) for world in WORLDS]
                for name in ("vfh", "ppo-rooms", "planner+safety")
            },
            100.0,
        )
        for label, part in (("goals reached (%)", "success"), ("drives that collide (%)", "collision"))
    ]
    return dots(WORLDS, *panels)


def speed():
    """Return steps per second of one thread as multiples of CartPole's."""
    rows = {name: row["ratio"] for name, row in read("speed")["environments"].items() if not re.search("CartPole|65536", name)}
    rows = {name: ratio for name, ratio in rows.items() if name.startswith("scalar") or name.endswith("one thread")}
    names = [re.sub(r"vector of |TurtleBot|-v0|, one thread", "", name) for name in rows]
    return dots(names, Panel("times CartPole's steps/s", {"": list(rows.values())}, line=1.0))


FIGURES = {"concepts": (loop, filters, missions, worlds), "results": (open_ground, gains, buildings, speed)}
"""Figures by the folder of the site in which they lie."""

if __name__ in ("__main__", "<run_path>"):
    for folder, draws in FIGURES.items():
        for draw in draws:
            drawn = io.BytesIO()
            draw().savefig(drawn, format="svg", bbox_inches="tight", facecolor="white", metadata={"Date": None})
            with mkdocs_gen_files.open(f"{folder}/{draw.__name__}.svg", "wb") as file:
                file.write(drawn.getvalue())

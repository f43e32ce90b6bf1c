"""What the pages show of benchmarks, as figures."""

import re
import sys
from pathlib import Path

import mkdocs_gen_files
from matplotlib.figure import Figure

sys.path.insert(0, str(Path("docs/generate").resolve()))
from drives import blocks, loop, two_filters
from in_rooms import policies, sway, worlds
from panels import BLUE, VERMILLION, WIDTH, Panel, Series, dots, pick, svg
from rows import named, read


def open_ground():
    """Return how much slower PPO is than tuned and untuned baselines."""
    rows = read("robustness")["comparisons"]
    untuned = [row["ppo"]["time"]["value"] - row["baselines"][0]["time_untuned"]["value"] for row in rows]
    differences = [Series("minus the tuned baseline", [row["ppo"]["difference"] for row in rows])]
    differences.append(Series("minus the untuned one", untuned))
    return dots([row["scenario"] for row in rows], Panel("time of PPO (s): right of 0 it is slower", differences, line=0.0))


def missions():
    """Return the goals that are truly reached, by what the robot believes."""
    rows = read("missions")["missions"]
    cases = list(dict.fromkeys((row["world"], row["policy"]) for row in rows))
    beliefs = [
        Series(name, [pick(rows, world=world, policy=policy, belief=name).get("goals") for world, policy in cases])
        for name in ("wheels", "localizer", "truth")
    ]
    return dots([", ".join(case) for case in cases], Panel("goals truly reached (%)", beliefs, 100.0))


def filters():
    """Return errors of filters beside the bound, and whether they state them."""
    settings = read("estimation")["settings"]
    rows = [
        (f"{noise.replace(' without its', ', no')}: {name}", row)
        for noise, setting in settings.items()
        if noise != "wheel"
        for name, row in setting["filters"].items()
    ]
    errors = [Series(name, [row["ratio"][at] for _, row in rows]) for at, name in enumerate(("x", "y", "heading"))]
    nees = [Series("", [row["nees"] for _, row in rows])]
    panels = (
        Panel("RMSE over the bound", errors, line=1.0, scale="log"),
        Panel("NEES (3 is right)", nees, line=3.0, scale="log"),
    )
    return dots([name for name, _ in rows], *panels)


def buildings():
    """Return the share of key frames at which the pose is lost, in two real buildings."""
    found = read("buildings")["buildings"]
    names = list(next(iter(found.values())))
    lost = [Series(building, [rows[name]["lost"] for name in names]) for building, rows in found.items()]
    return dots(names, Panel("key frames with the pose lost (%)", lost, 100.0))


def carried():
    """Return the share of robots that are right again within ten metres."""
    found = read("buildings")["found"]
    names = list(next(iter(found.values())))
    right = [Series(building, [rows[name]["right"] for name in names]) for building, rows in found.items()]
    return dots(names, Panel("drives that are right within 10 m (%)", right, 100.0))


def gains():
    """Return the time to the goal on odometry and on the estimate, by noise."""
    times = {row["scenario"]: row["baselines"][0]["time"] for row in read("robustness")["comparisons"]}
    noises = [name.rpartition(", ")[2] for name in times if name.startswith("Nav, raw odometry, ")]
    both = [Series(words, [times.get(f"Nav, {words}, {noise}") for noise in noises]) for words in ("raw odometry", "estimate")]
    return dots(noises, Panel("time to the goal of the tuned baseline (s)", both))


def coverage():
    """Return how many intervals of calibrations hold the truth, by parameter."""
    settings = [setting["parameters"] for setting in read("calibration_intervals")["coverage"].values()]
    truth = {}
    for name in dict.fromkeys(name for setting in settings for name in setting):
        rows = [setting[name] for setting in settings if name in setting]
        truth[name] = sum(row["coverage"] * row["drives"] for row in rows) / sum(row["drives"] for row in rows)
    return dots(
        list(truth), Panel("intervals that hold the true value (%)", [Series("", list(truth.values()))], 100.0, line=95.0)
    )


def speed():
    """Return steps per second of one thread as multiples of CartPole's."""
    rows = [row for row in named(read("speed")["environments"]) if "CartPole" not in row["name"] and "65536" not in row["name"]]
    rows = [row for row in rows if row["name"].startswith("scalar") or row["name"].endswith("one thread")]
    names = [re.sub(r"vector of |TurtleBot|-v0|, one thread", "", row["name"]) for row in rows]
    return dots(names, Panel("times CartPole's steps/s", [Series("", [row["ratio"] for row in rows])], line=1.0))


def stops():
    """Return when the last motion came in injected faults, by kind."""
    figure = Figure(figsize=(WIDTH, 2.6), layout="constrained")
    axes = figure.subplots()
    lags = [kind["longest_lag"] for kind in read("faults")["faults"].values()]
    axes.hist(lags, bins=[0.02 * k for k in range(32)], color=BLUE)
    axes.axvline(0.5, color=VERMILLION, linestyle="--", label="measured_age")
    axes.set(xlabel="last motion after the newest measurement, the longest of each kind (s)", ylabel="kinds of fault")
    axes.legend()
    return figure


def zeros():
    """Return the time until the robot is told to stand, by kind of fault."""
    kinds = {name: kind["longest_stop"] for name, kind in read("faults")["faults"].items() if kind["longest_stop"]}
    slow = {
        name: stop for name, stop in sorted(kinds.items(), key=lambda each: -each[1]) if stop > 0.6 and name != "healthy wall"
    }
    return dots(list(slow), Panel("zero after the fault, the longest of 8 (s)", [Series("", list(slow.values()))]))


IN_ROOMS = (worlds, policies, sway)
OF_BELIEF = (two_filters, filters, missions)
FIGURES = {
    "concepts": (blocks, loop, stops, zeros, *IN_ROOMS, *OF_BELIEF),
    "howto": (coverage,),
    "results": (open_ground, buildings, carried, gains, speed),
}
"""Figures by the folder of the site in which they lie."""

if __name__ in ("__main__", "<run_path>"):
    for folder, draws in FIGURES.items():
        for draw in draws:
            with mkdocs_gen_files.open(f"{folder}/{draw.__name__}.svg", "wb") as file:
                file.write(svg(draw()))

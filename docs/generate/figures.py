"""What the pages show of benchmarks."""

import io
import json
from pathlib import Path

import mkdocs_gen_files
from matplotlib.figure import Figure

from turtlebot_gym.plotting import BLUE, GREEN, ORANGE, VERMILLION


def write(path, figure):
    """Write a figure into the site."""
    drawn = io.BytesIO()
    figure.savefig(drawn, format="svg", bbox_inches="tight", facecolor="white", metadata={"Date": None})
    with mkdocs_gen_files.open(path, "wb") as file:
        file.write(drawn.getvalue())


def results(name):
    """Return the results of a benchmark."""
    return json.loads(Path("benchmarks", f"{name}.json").read_text(encoding="utf-8"))


def arrival():
    """Return how many arrivals are false and how late the robot is, by rule and noise."""
    figure = Figure(figsize=(7.0, 3.0), layout="constrained")
    axes = figure.subplots()
    for (noise, rules), color in zip(results("arrival")["rules"].items(), (BLUE, GREEN, ORANGE, VERMILLION), strict=True):
        within = [rule for name, rule in rules.items() if name.startswith("within")]
        axes.plot(
            [rule["later"]["value"] for rule in within],
            [100.0 * rule["false"]["value"] for rule in within],
            "o-",
            color=color,
            label=noise,
        )
    axes.set(xlabel="believes later that it has arrived, by a smaller radius (s)", ylabel="false arrivals (%)", ylim=0.0)
    axes.legend(title="noise")
    return figure


def floors():
    """Return how many drives on wheel odometry succeed, with grip and without."""
    rows = [row for row in results("transfer")["policies"] if row["noise"] == "wheel" and "Nav" in row["env"]]
    names = list(dict.fromkeys(row["policy"] for row in rows if row["policy"] != "proportional"))
    figure = Figure(figsize=(7.0, 3.0), layout="constrained")
    axes = figure.subplots()
    for at, (floor, color) in enumerate((("unicycle", BLUE), ("grip", GREEN), ("slippery", ORANGE))):
        shares = {row["policy"]: 100.0 * row["succeeded"] / row["of"] for row in rows if row["floor"] == floor}
        axes.barh(
            [k + 0.27 * (at - 1) for k in range(len(names))], [shares[name] for name in names], 0.25, color=color, label=floor
        )
    axes.set(xlabel="goals reached on wheel odometry (%)", yticks=range(len(names)), yticklabels=names)
    axes.invert_yaxis()
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


def stops():
    """Return when the last motion came in injected faults, by kind."""
    kinds = results("faults")["faults"].values()
    figure = Figure(figsize=(7.0, 2.6), layout="constrained")
    axes = figure.subplots()
    axes.hist([kind["longest_lag"] for kind in kinds], bins=[0.02 * k for k in range(32)], color=BLUE)
    axes.axvline(0.5, color=VERMILLION, linestyle="--", label="measured_age")
    axes.set(xlabel="last motion after the newest measurement, the longest of each kind (s)", ylabel="kinds of fault")
    axes.legend()
    return figure


write("concepts/arrival.svg", arrival())
write("concepts/floors.svg", floors())
write("concepts/stops.svg", stops())

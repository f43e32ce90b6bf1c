"""The tables of measured results, made from the benchmarks' files: a page names them as ``<!-- table: NAME -->``."""

import re
import sys
from pathlib import Path

sys.path.insert(0, "benchmarks")
from rows import hazards, named, read, rooms

from harness.tables import table

EVENTS = {
    "dropout_probability": ("a gap begins, per 0.1 s", "gaps"),
    "gap_end": ("it ends, per 0.1 s", "gap ends"),
    "leap_probability": ("the pose leaps, per 0.1 s", "leaps"),
    "reset_probability": ("odometry begins anew, per 0.1 s", "resets"),
    "slip_start": ("wheels slip, per 0.1 s", "slips"),
    "reverse_probability": ("reverse counts as forward, per 0.1 s of reverse", "counted forwards"),
}
"""Events of the preset `recorded`, and their names in `benchmarks/recorded.json`."""
SHARES = {"success, %": "{success:.1%}", "collisions, %": "{collision:.1%}"}
SPEED = {
    "environment": "{name}",
    "steps/s": "{steps_per_second:,.0f}",
    "times CartPole": "{ratio:.2f}",
    "steps/CPU s": "{steps_per_cpu_second:,.0f}",
    "times CartPole by CPU s": "{cpu_ratio:.2f}",
}


def recorded():
    """Return what recordings of real robots' wheels show."""
    found = read("recorded")
    rows = [{"name": name, **fits} for name, fits in found["parameters"].items()]
    rows += [{"name": f"{name}: {words}", "preset": found["events"][event]} for name, (words, event) in EVENTS.items()]
    robots = {robot: f"{{{robot}.value:.3g}}" for robot in ("wifibot", "aces", "intel")}
    return table(rows, {"parameter": "{name}", "preset `recorded`": "{preset:.3g}", **robots})


def hazards_table(part):
    """Return the hazards of a part with their tests."""
    columns = {"cause": "{cause}", "what happens": "{effect}", "who notices": "{by}"}
    columns |= {"zero after": "{after}", "at full speed": "{way}", "remains": "{remains}", "test": "{test}"}
    return table([{**row, "test": ", ".join(f"`{test}`" for test in row["tests"])} for row in hazards(part)], columns)


TABLES = {
    "open_ground": lambda: table(
        read("robustness")["comparisons"],
        {
            "scenario": "{scenario}",
            "PPO, s": "{ppo[time]:.2f}",
            "baseline": "{baselines[0][policy]}",
            "tuned, s": "{baselines[0][time]:.2f}",
            "untuned, s": "{baselines[0][time_untuned].value:.2f}",
            "PPO minus tuned, s": "{ppo[difference]:+.2f}",
            "p (Holm)": "{p_holm:.2g}",
            "PPO succeeds, %": "{ppo[success]:.1%}",
            "tuned succeeds, %": "{baselines[0][success]:.1%}",
        },
    ),
    "rooms": lambda: table(
        rooms(),
        {
            "setting": "{setting}",
            "policy": "{policy}",
            "success, %": "{success:.1%}",
            "minus `vfh`, points": "{success_difference:+.1%}",
            "collisions, %": "{collision:.1%}",
            "time, s": "{time.value:.1f}",
        },
    ),
    "sway": lambda: table(
        read("rooms_planner_wheel")["rows"],
        {"setting": "{setting}", "policy": "{policy}", **SHARES, "later within the layer, s": "{later:+.2f}"},
    ),
    "missions": lambda: table(
        read("missions")["missions"],
        {
            "world": "{world}",
            "policy": "{policy}",
            "belief": "{belief}",
            "truly reached, %": "{goals:.0%}",
            "falsely, %": "{false_goals:.0%}",
            "reached an hour": "{goals_an_hour:.0f}",
            "lost, % of the time": "{lost:.0%}",
        },
    ),
    "filters": lambda: table(
        [
            {"noise": noise, "name": name, **row}
            for noise, setting in read("estimation")["settings"].items()
            for name, row in setting["filters"].items()
        ],
        {
            "noise": "{noise}",
            "filter": "{name}",
            "x": "{ratio[0]:.3f}",
            "y": "{ratio[1]:.3f}",
            "heading": "{ratio[2]:.3f}",
            "NEES of the pose": "{nees:.2f}",
        },
    ),
    "buildings": lambda: table(
        [{"building": name, **row} for name, rows in read("buildings")["buildings"].items() for row in named(rows)],
        {
            "building": "{building}",
            "condition": "{name}",
            "median, m": "{median:.3f}",
            "95 %, m": "{quantile95:.3f}",
            "worst, m": "{worst:.3f}",
            "lost": "{lost:.1%}",
            "says so": "{declared_lost:.1%}",
            "NEES": "{nees:.1f}",
            "mean": "{mean_nees:.1f}",
            "wrong, s": "{wrong:.1f}",
        },
    ),
    "found": lambda: table(
        [{"building": name, **row} for name, rows in read("buildings")["found"].items() for row in named(rows)],
        {
            "building": "{building}",
            "drives that begin": "{name}",
            "right after 10 m": "{right:.1%}",
            "found, median, s": "{found:.1f}",
            "way, m": "{way:.1f}",
            "wrong, s": "{wrong:.1f}",
        },
    ),
    "recorded": recorded,
    "hazards_guard": lambda: hazards_table("guard"),
    "hazards_sensors": lambda: hazards_table("sensors"),
    "speed": lambda: table(named(read("speed")["environments"]), SPEED),
    "peers": lambda: table(
        read("peers")["rows"],
        {
            "environment": "{peer}",
            "number": "{size}",
            "ns a step": "{peer_ns[cpu].value:,.0f}",
            "ours": "{ours}",
            "its ns a step": "{ours_ns[cpu].value:,.0f}",
            "times ours": "{ratio.value:.1f}",
            "in the rounds": "{ratio.low:.1f} to {ratio.high:.1f}",
        },
    ),
    "gpu": lambda: table(
        read("gpu")["rates"],
        {"environments": "{environments:,}", "steps/s": "{steps_per_second:,.0f}", "memory, bytes": "{memory_bytes:,}"},
    ),
    "training": lambda: table(
        named(read("training")["recipes"]),
        {
            "training": "{name}",
            "steps": "{steps:,}",
            "CPU s": "{total:.1f}",
            "least success, %": "{success:.1%}",
            "time over the baseline's": "{time:.3f}",
        },
    ),
    "busy": lambda: table(named(read("speed")["busy"]["environments"]), SPEED),
}


def folded(text):
    """Return a table in a box that is closed at first."""
    titles, _, *rows = text.strip().splitlines()
    summary = "; ".join(filter(None, map(str.strip, titles.replace("`", "").split("|"))))
    return f'<details markdown="1">\n<summary>{len(rows)} rows: {summary}</summary>\n\n{text}\n</details>'


def cards():
    """Return the cards of the policies that come with the package, as sections of the page."""
    texts = [path.read_text(encoding="utf-8") for path in sorted(Path("agents/pretrained").glob("ppo-*.md"))]
    return re.sub(r"(?:^\|.*\n)+", lambda found: folded(found[0]) + "\n", "\n".join(texts).replace("# ", "### "), flags=re.M)


def filled(text):
    """Return a page with its tables and cards."""
    text = re.sub(r"<!-- table: (\w+) -->", lambda found: folded(TABLES[found[1]]()), text)
    return text.replace("<!-- cards -->", cards())

"""The rows of measured results, from the benchmarks' files."""

import json
from pathlib import Path

import yaml

from turtlebot_gym.presets import make_robot

HAZARDS = Path("docs/generate/hazards.yaml")


def read(name):
    """Return the results of a benchmark."""
    return json.loads(Path("benchmarks", f"{name}.json").read_text(encoding="utf-8"))


def named(mapping):
    """Return rows with their names."""
    return [{"name": name, **row} for name, row in mapping.items()]


def rooms():
    """Return the rows of rooms, without the safety layer and within it."""
    bare = read("rooms_study")["rows"]
    within = [row for row in read("rooms_planner")["rows"] if row["policy"].endswith("+safety")]
    return bare + within + [row for row in read("rooms_planner_lidars")["rows"] if row["policy"].endswith("+safety")]


def hazards(part):
    """Return the hazards of a part, with the times of the injected faults."""
    faults, speed = read("faults")["faults"], make_robot("burger").max_wheel
    rows = yaml.safe_load(HAZARDS.read_text(encoding="utf-8"))[part]
    for row in rows:
        kinds = [faults[kind] for kind in row.get("faults", ())]
        unstopped = [kind for kind in kinds if kind["longest_stop"] is None]
        if unstopped:
            row["after"], row["way"] = f"{unstopped[0]['unsafe']} of {unstopped[0]['injected']} drove on", "to the wall"
        elif kinds:
            longest = max(kind["longest_stop"] for kind in kinds)
            row["after"], row["way"] = f"{longest:.2f} s", f"{speed * longest:.2f} m"
    return rows

"""The findings of all benchmarks in words, losses first, for the page of results. Their numbers come from the JSON files."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import belief_text

Results = Mapping[str, Any]
FOLDER = Path(__file__).parent


def read(name: str) -> Results:
    """Return the results of a benchmark."""
    return json.loads((FOLDER / f"{name}.json").read_text(encoding="utf-8"))


def findings() -> str:
    """Return all findings as Markdown."""
    study, rooms, planner, people = read("robustness"), read("rooms_study"), read("rooms_planner"), read("people")
    losses = [
        *open_ground(study["comparisons"]),
        *rooms_lost(rooms["rows"]),
        among_people(people["rows"]),
        f"* {belief_text.sentence(read('belief')['rows'])} [Training on the belief](#training-on-the-belief).",
        layer(rooms["rows"]),
        slippery(read("transfer")["policies"]),
        arrivals(study["false_arrivals"]),
        buildings(read("buildings")["buildings"]),
        delay(read("ros")["parts"]["latency"]["figures"]),
    ]
    gains = [
        what_the_filter_buys(study["comparisons"]),
        rooms_won(rooms["rows"]),
        begun_with(read("from_policy")["tasks"]),
        memory(planner["rows"]),
        *reaction(people["rows"]),
        missions(read("missions")["missions"]),
        stops(read("faults")["faults"]),
    ]
    return "\n".join(["### What loses, or does not hold\n", *losses, "\n### What helps\n", *gains])


def open_ground(rows: Sequence[Results]) -> list[str]:
    """Return how PPO does beside tuned baselines, and beside their defaults."""
    slower = [row for row in rows if row["verdict"] == "PPO slower"]
    faster = [row for row in rows if row["verdict"] == "PPO faster"]
    worst = max((row["ppo"]["difference"]["value"] for row in slower), default=0.0)
    seeming = [
        row for row in rows if row not in faster and row["ppo"]["time"]["value"] < row["baselines"][0]["time_untuned"]["value"]
    ]
    return [
        f"* **On open ground learning {'sometimes pays' if faster else 'does not pay'}.** PPO is slower than the "
        f"tuned baseline in {len(slower)} of {len(rows)} "
        f"scenarios, by {worst:.1f} s at most, and faster in {counted(len(faster))}. "
        "[Comparisons](#all-comparisons).",
        f"* **An untuned baseline makes learning look good.** Against the baselines' defaults PPO would have won "
        f"{len(seeming)} more.",
    ]


def rooms_lost(rows: Sequence[Results]) -> list[str]:
    """Return where a learned policy does not beat VFH+ in rooms, and what it touches."""
    level, worse, collisions = [], [], []
    for row in of(rows, "ppo-rooms"):
        difference = row["success_difference"]
        if difference["high"] < 0.0:
            worse.append(row["setting"])
        elif difference["low"] <= 0.0 and "," not in row["setting"]:
            level.append(row["setting"])
        if "," not in row["setting"]:
            collisions.append(row["collision"]["value"])
    touched = max(row["collision"]["value"] for row in of(rows, "vfh") if "," not in row["setting"])
    return [
        f"* **In rooms PPO hits things, geometry hardly does.** `ppo-rooms` collides in {percent(min(collisions))} to "
        f"{percent(max(collisions))} of the rooms of a world, `vfh` in {percent(touched)} at most. [Rooms](#rooms).",
        f"* **In {listed(level)} `ppo-rooms` reaches no more goals than `vfh`**, and fewer in `{listed(worse)}`. It is "
        "the best of three trainings; three later ones together do not differ from `vfh`.",
    ]


def among_people(rows: Sequence[Results]) -> str:
    """Return what policies that see one scan reach among people."""
    single = [row["success"]["value"] for row in rows if "stop" not in row["policy"]]
    stopping = {kind: [row["success"]["value"] for row in rows if row["policy"].endswith(kind)] for kind in ("rule", "learned")}
    return (
        f"* **Among people who walk, every policy that sees one scan fails in more than half of the rooms**: "
        f"{span(single)} of the goals. Who judges by three scans when to stand reaches {span(stopping['rule'])} by a tuned "
        f"rule and {span(stopping['learned'])} by a learned one. [People](concepts/rooms.md#people)."
    )


def reaction(rows: Sequence[Results]) -> list[str]:
    """Return with which LiDARs a stop that was learned beats the tuned rule by its whole interval; without one no finding."""
    gains = [(f"`{row['lidar']}`", row["success_minus_rule"]) for row in rows if "success_minus_rule" in row]
    won = [f"{lidar} ({100.0 * gain['value']:+.1f} points)" for lidar, gain in gains if gain["low"] > 0.0]
    lost = [lidar for lidar, gain in gains if gain["high"] < 0.0]
    others = f"it loses with {listed(lost)}" if lost else "with the other LiDARs no difference was found"
    finding = f"* **Among people a learned stop beats the tuned rule** in the same rooms with {listed(won)}; {others}."
    return [f"{finding} [People](concepts/rooms.md#people)."] if won else []


def layer(rows: Sequence[Results]) -> str:
    """Return what the safety layer cost before it knew a way out."""
    cells = {(row["setting"], row["policy"]): row["success"]["value"] for row in rows}
    before, within = (cells["office", f"ppo-rooms{suffix}"] for suffix in ("", "+safety"))
    return (
        f"* **A layer that only brakes is expensive.** In offices `ppo-rooms` fell from {percent(before, 0)} to "
        f"{percent(within, 0)} of the goals within it, without a contact. The layer has a way out since, which is not in these "
        "tables. [What it costs](#what-the-safety-layer-costs)."
    )


def slippery(rows: Sequence[Results]) -> str:
    """Return what wheel odometry loses on a slippery floor."""
    chosen = [
        row["succeeded"] / row["of"]
        for row in rows
        if row["noise"] == "wheel" and row["floor"] == "slippery" and "Nav" in row["env"] and row["policy"] != "proportional"
    ]
    return (
        f"* **On a slippery floor wheel odometry alone misses about half of the goals**: policies reach {span(chosen)}. "
        "With grip everything carries over to the other physics. [Another physics](concepts/transfer.md#policies)."
    )


def arrivals(rows: Sequence[Results]) -> str:
    """Return how often a robot that ends on its belief is not there."""
    worst = max(rows, key=lambda row: row["false_arrival"]["value"])
    return (
        f"* **A robot that ends on its belief is sometimes wrong**: in up to {percent(worst['false_arrival']['value'])} of the "
        f"arrivals, under `{worst['noise']}`. [Arrival](concepts/tasks.md#who-says-that-it-has-arrived)."
    )


def buildings(results: Results) -> str:
    """Return under which conditions the localizer loses itself in recorded buildings."""
    lost = {name: [row[name]["lost"] for row in results.values()] for name in next(iter(results.values()))}
    without = sum(max(shares) == 0.0 for shares in lost.values())
    half = lost["50 % people"]
    return (
        f"* **People on half of the beams lose the localizer** in {sum(share > 0.0 for share in half)} of {len(half)} real "
        f"buildings, for {percent(max(half))} of the key frames. In {without} of {len(lost)} conditions it is never lost. "
        "[Real buildings](#real-buildings)."
    )


def delay(figures: Sequence[Results]) -> str:
    """Return whether the live graph keeps its limits of delay."""
    limited = [figure for figure in figures if "/cmd_vel, p" in figure["name"] and figure["limit"] is not None]
    kept = all(figure["value"] <= figure["limit"] for figure in limited)
    values, limits = (" and ".join(f"{figure[key]:.1f}" for figure in limited) for key in ("value", "limit"))
    return (
        f"* **The live graph {'keeps its limits' if kept else 'is slower than its own limits'}**: {values} ms from odometry to "
        f"command (median and 99 %), where {limits} are the limits. [The live graph](#the-live-graph)."
    )


def what_the_filter_buys(rows: Sequence[Results]) -> str:
    """Return what an estimate is worth to geometry, by noise."""
    by_name = {row["scenario"]: row["baselines"][0]["time"]["value"] for row in rows}
    gains = {
        noise: by_name[f"Nav, raw odometry, {noise}"] - by_name[f"Nav, estimate, {noise}"]
        for noise in ("tutorial", "documented", "rough", "wheel")
    }
    most, least = (choose(gains, key=lambda noise: gains[noise]) for choose in (max, min))
    return (
        f"* **The filter pays most where odometry is worst**: {gains[most]:.1f} s of a drive under `{most}`, "
        f"{gains[least]:.1f} s under `{least}`, where nothing corrects it. [The belief](concepts/belief.md#two-filters)."
    )


def rooms_won(rows: Sequence[Results]) -> str:
    """Return in which worlds a learned policy reaches more goals."""
    won = [
        (row["setting"], 100.0 * row["success_difference"]["value"])
        for row in of(rows, "ppo-rooms")
        if row["success_difference"]["low"] > 0.0 and "," not in row["setting"]
    ]
    gains = listed([f"{name} ({gain:.1f} points)" for name, gain in won])
    return f"* **Learning reaches more goals where there are dead ends**: `ppo-rooms` beats `vfh` in {gains}. [Rooms](#rooms)."


def begun_with(tasks: Results) -> str:
    """Return what trainings gain that begin with a known policy."""
    rooms, pose = tasks["Rooms"], tasks["Pose"]
    known, nothing, polar, none = (
        percent(runs["last"]["success"]) for runs in (rooms["vfh"], rooms["none"], pose["polar"], pose["none"])
    )
    alike = [task for task, begun in tasks.items() if all(runs["reached"] == len(runs["runs"]) for runs in begun.values())]
    return (
        f"* **A training in rooms begins best with a known policy**: from `vfh`, {_of_trainings(rooms['vfh'])} reach "
        f"{percent(rooms['vfh']['to'], 0)} in `dense` rooms, the median after {rooms['vfh']['seconds']:.0f} CPU seconds, and "
        f"end at {known}; plain ones, of which {_of_trainings(rooms['none'])} reach it, end at {nothing}. On open ground it "
        f"gains nothing: {listed(alike)} are learned at once either way, and on Pose it ends at {polar} instead of {none}. "
        "[Train](howto/train.md#begin-with-a-known-policy)."
    )


def _of_trainings(runs: Results) -> str:
    """Return how many trainings reached a success."""
    return "all" if runs["reached"] == len(runs["runs"]) else counted(runs["reached"])


def memory(rows: Sequence[Results]) -> str:
    """Return what a planner with a memory reaches within the layer."""
    chosen = of(rows, "planner+safety")
    touched, reached = sum(row["collision"]["value"] for row in chosen), span([row["success"]["value"] for row in chosen])
    return (
        f"* **A memory pays more than learning**: `planner+safety` reaches {reached} of the goals in "
        f"{len(chosen)} worlds, {'with' if touched else 'without'} contact. [Who finds the "
        "way](concepts/rooms.md#which-policies-find-the-way)."
    )


def missions(rows: Sequence[Results]) -> str:
    """Return what localization is worth in ten minutes of goals."""
    office = {row["belief"]: row["goals"]["value"] for row in rows if (row["world"], row["policy"]) == ("office", "ppo-rooms")}
    wheels, localized, truth = (percent(office[name], 0) for name in ("wheels", "localizer", "truth"))
    return (
        f"* **A map and a scan are worth the true pose**: in ten minutes of goals in offices a robot on its wheels reaches "
        f"{wheels}, localized {localized}, with the true pose {truth}. [Goals in turn](concepts/belief.md#goals-in-turn)."
    )


def stops(faults: Results) -> str:
    """Return how many injected faults were unsafe."""
    injected, unsafe = (sum(kind[name] for kind in faults.values()) for name in ("injected", "unsafe"))
    return (
        f"* **The guard stops**: of {injected:,} faults of {len(faults)} kinds {counted(unsafe)} "
        f"{'were' if unsafe > 1 else 'was'} unsafe. "
        "[Safety](concepts/safety.md)."
    )


def of(rows: Sequence[Results], policy: str) -> list[Results]:
    """Return the rows of a policy."""
    return [row for row in rows if row["policy"] == policy]


def counted(number: int) -> str:
    """Return a number, 0 as a word."""
    return str(number) if number else "none"


def percent(share: float, digits: int = 1) -> str:
    """Return a share in per cent."""
    return f"{100.0 * share:.{digits}f} %"


def span(shares: Sequence[float]) -> str:
    """Return the least and the largest share."""
    return f"{100.0 * min(shares):.0f} to {percent(max(shares), 0)}"


def listed(names: Sequence[str]) -> str:
    """Return names as in a sentence."""
    return " and ".join(filter(None, (", ".join(names[:-1]), names[-1]))) if names else "none"

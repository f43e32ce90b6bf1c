"""The results' findings and tables, from the files that the study, the trainings and the live graph have left."""

import json
import sys
from contextlib import contextmanager
from pathlib import Path

import mkdocs_gen_files

sys.path.insert(0, "benchmarks")
import buildings_text
import speed_text
from robustness_text import conditions, summary
from turtlebot_gym_agents.policies.named import SAFETY


def seconds(interval, sign=""):
    """Return a time with its 95 % interval, s."""
    value, low, high = (f"{interval[part]:{sign}.2f}" for part in ("value", "low", "high"))
    return f"{value} ({low}, {high})"


@contextmanager
def folded(page, summary):
    """Put what is written in a box that is closed at first."""
    print(f'<details markdown="1">\n<summary>{summary}</summary>\n', file=page)
    yield
    print("\n</details>\n", file=page)


def percent(interval):
    """Return a share with its 95 % interval, %."""
    value, low, high = (f"{100.0 * interval[part]:.1f}" for part in ("value", "low", "high"))
    return f"{value} ({low}, {high})"


study = json.loads(Path("benchmarks/robustness.json").read_text(encoding="utf-8"))
with mkdocs_gen_files.open("results.md", "a") as page:
    print("\n## What the study finds\n", file=page)
    print("\n".join(summary(study)), file=page)
    print(f"\n{conditions(study)}\n", file=page)
    print("## All comparisons\n", file=page)
    print(
        "Times are means over episodes; a failed episode counts as the time limit. The first baseline of each scenario was the",
        file=page,
    )
    print("fastest one after tuning, and PPO is compared with it.\n", file=page)
    print("| scenario | policy | time, s | untuned, s | PPO minus it, s | p (Holm) | success, % |", file=page)
    print("|---|---|---|---|---|---|---|", file=page)
    for row in study["comparisons"]:
        ppo, name = row["ppo"], row["scenario"]
        seeds = f"{ppo['trainings']} trainings"
        print(f"| {name} | PPO, {seeds} | {seconds(ppo['time'])} | | | | {percent(ppo['success'])} |", file=page)
        for baseline in row["baselines"]:
            compared = baseline["policy"] == row["compared_with"]
            cells = f"{seconds(ppo['difference'], '+')} | {row['p_holm']:.2g}" if compared else "|"
            times = f"{seconds(baseline['time'])} | {baseline['time_untuned']['value']:.2f}"
            print(f"| | {baseline['policy']} | {times} | {cells} | {percent(baseline['success'])} |", file=page)
    rooms = json.loads(Path("benchmarks/rooms_study.json").read_text(encoding="utf-8"))
    print("\n## Rooms\n", file=page)
    episodes, first = rooms["config"]["episodes"], rooms["config"]["first_seed"]
    print(
        f"`make study-rooms`: {episodes} held-out rooms of each setting, on seeds from {first:,}. LiDAR `lds01`, noise",
        "`tutorial` and the filter's estimate where the setting does not say otherwise. `ppo-rooms` is the best of the",
        "trainings, by its evaluation seeds.\n",
        sep="\n",
        file=page,
    )
    with folded(page, "All settings and policies"):
        print(
            "| setting | policy | success, % | minus `vfh`, points | collisions, % | time-outs, % | SPL | time, s |", file=page
        )
        print("|---|---|---|---|---|---|---|---|", file=page)
        for row in rooms["rows"]:
            shares = " | ".join(percent(row[name]) for name in ("success", "success_difference", "collision", "timeout"))
            spl, time = row["spl"]["value"], row["time"]["value"]
            print(f"| {row['setting']} | {row['policy']} | {shares} | {spl:.3f} | {time:.1f} |", file=page)
    print("\n### What the safety layer costs\n", file=page)
    print(
        "Each policy without and with the layer, in the same rooms. The last column is the delay in rooms that it crosses",
        "either way, with its 95 % interval. This is the layer before it had a way out, which only reduced the speed.\n",
        sep="\n",
        file=page,
    )
    print("| setting | policy | collisions, % | with the layer | success, % | with the layer | later, s |", file=page)
    print("|---|---|---|---|---|---|---|", file=page)
    cells = {(row["setting"], row["policy"]): row for row in rooms["rows"]}
    for (setting, policy), row in cells.items():
        if "later" in row:
            name = policy.removesuffix(SAFETY)
            pair = cells[setting, name], row
            shares = " | ".join(
                f"{100.0 * baseline[part]['value']:.1f}" for part in ("collision", "success") for baseline in pair
            )
            print(f"| {setting} | {name} | {shares} | {seconds(row['later'], '+')} |", file=page)
    barn = json.loads(Path("benchmarks/barn.json").read_text(encoding="utf-8"))
    print("\n## The 200 worlds of the BARN challenge\n", file=page)
    print(f"`make bench-barn`: {barn['config']['episodes']} drives through each world; intervals are over worlds.\n", file=page)
    print("| policy | success, % | collisions, % | time-outs, % | score, at most 0.5 |", file=page)
    print("|---|---|---|---|---|", file=page)
    for policy, cells in barn["mean"].items():
        shares = " | ".join(percent(cells[name]) for name in ("success", "collision", "timeout"))
        print(f"| {policy} | {shares} | {cells['barn']['value']:.3f} |", file=page)
    print(buildings_text.section(json.loads(Path("benchmarks/buildings.json").read_text(encoding="utf-8"))), file=page)
    print("\n## The live graph\n", file=page)
    live = json.loads(Path("benchmarks/ros.json").read_text(encoding="utf-8"))
    print(f"`make bench-ros`, on {live['cores']} cores; one process per node, over real DDS.\n", file=page)
    print("| | measured | limit |\n|---|---|---|", file=page)
    for part, result in live["parts"].items():
        for figure in result["figures"]:
            limit = "" if figure["limit"] is None else f"{figure['limit']:g}"
            print(f"| {part}: {figure['name']} | {figure['value']:.3g} {figure['unit']} | {limit} |", file=page)
    speeds = [json.loads(Path(f"benchmarks/{name}.json").read_text(encoding="utf-8")) for name in ("speed", "speed_zen5")]
    print(speed_text.section(*speeds), file=page)
    print("\n## The policies that come with the package\n", file=page)
    for card in sorted(Path("agents/pretrained").glob("ppo-*.md")):
        print(card.read_text(encoding="utf-8").replace("# ", "### ", 1), file=page)

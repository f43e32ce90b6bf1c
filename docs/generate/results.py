"""The results' tables, from the files that the study and the trainings have left."""

import json
from pathlib import Path

import mkdocs_gen_files


def interval(estimate, sign=""):
    """Return a time with half its 95 % interval, s."""
    return f"{estimate['value']:{sign}.2f} ± {(estimate['high'] - estimate['low']) / 2.0:.2f}"


study = json.loads(Path("benchmarks/robustness.json").read_text(encoding="utf-8"))
noises = list(dict.fromkeys(cell["noise"] for cell in study["matrix"]))
rows = {}
for cell in study["matrix"]:
    if cell["trained"] in (None, cell["noise"]):
        text = f"{interval(cell['time'])} s, {100.0 * cell['success']['value']:.1f} %"
        rows.setdefault((cell["policy"], cell["observation"]), {})[cell["noise"]] = text

with mkdocs_gen_files.open("results.md", "a") as page:
    print(
        f"\n## Policies, what they see, and noise\n\nTask Nav, {study['config']['episodes']} episodes each: time to the goal",
        file=page,
    )
    print(
        "with its 95 % interval, a failure counted as 30 s, and success. PPO is trained on the noise that it is tested on.\n",
        file=page,
    )
    print(f"| policy | sees | {' | '.join(noises)} |\n|---|---{'|---' * len(noises)}|", file=page)
    for (policy, observation), row in rows.items():
        print(f"| {policy} | {observation} | {' | '.join(row[noise] for noise in noises)} |", file=page)
    print("\n## Tasks where more than geometry may count\n", file=page)
    print(
        "Noise `tutorial`. The difference is that of paired episodes: below zero PPO is faster than the best baseline. A false",
        file=page,
    )
    print("arrival is one that the robot believed in and that was none.\n", file=page)
    print("| task | policy | time, s | difference, s | success, % | false arrivals, % |\n|---|---|---|---|---|---|", file=page)
    for case in study["scenarios"]:
        difference = interval(case["minus_baseline"], "+") if "minus_baseline" in case else ""
        shares = " | ".join(f"{100.0 * case[name]['value']:.1f}" for name in ("success", "false_arrival"))
        print(f"| {case['scenario']} | {case['policy']} | {interval(case['time'])} | {difference} | {shares} |", file=page)
    print("\n## The live graph\n", file=page)
    live = json.loads(Path("benchmarks/ros.json").read_text(encoding="utf-8"))
    print(f"`make bench-ros`, on {live['cores']} cores; a process for each node, real DDS.\n", file=page)
    print("| | measured | to be below |\n|---|---|---|", file=page)
    for part, result in live["parts"].items():
        for figure in result["figures"]:
            limit = "" if figure["limit"] is None else f"{figure['limit']:g}"
            print(f"| {part}: {figure['name']} | {figure['value']:.3g} {figure['unit']} | {limit} |", file=page)
    print("\n## The policies that come with the package\n", file=page)
    for card in sorted(Path("agents/pretrained").glob("ppo-*.md")):
        print(card.read_text(encoding="utf-8").replace("# ", "### ", 1), file=page)

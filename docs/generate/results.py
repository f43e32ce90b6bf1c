"""The results' findings and tables, from the files that the study, the trainings and the live graph have left."""

import io
import re
import sys
from pathlib import Path

import mkdocs_gen_files

sys.path.insert(0, "benchmarks")
import belief_text
import buildings_text
import findings_text
import speed_text
from harness.tables import markdown
from robustness_text import conditions, summary
from turtlebot_gym_agents.evaluation.metrics import Interval
from turtlebot_gym_agents.policies.named import SAFETY

TABLE = re.compile(r"(?:^\|.*\n)+", re.MULTILINE)


def folded(text):
    """Return Markdown with each table in a box that is closed at first."""

    def box(found):
        titles, _, *rows = found[0].strip().splitlines()
        named = "; ".join(filter(None, map(str.strip, titles.replace("`", "").split("|"))))
        return f'<details markdown="1">\n<summary>{len(rows)} rows: {named}</summary>\n\n{found[0]}\n</details>\n'

    return TABLE.sub(box, text)


def compared(study):
    """Return the rows of the study on open ground."""
    for row in study["comparisons"]:
        ppo = row["ppo"]
        times, shares = f"{Interval(**ppo['time']):.2f}", f"{Interval(**ppo['success']):.1%}"
        yield row["scenario"], f"PPO, {ppo['trainings']} trainings", times, "", "", "", shares
        for baseline in row["baselines"]:
            beside = baseline["policy"] == row["compared_with"]
            cells = (f"{Interval(**ppo['difference']):+.2f}", f"{row['p_holm']:.2g}") if beside else ("", "")
            times = f"{Interval(**baseline['time']):.2f}", f"{baseline['time_untuned']['value']:.2f}"
            yield "", baseline["policy"], *times, *cells, f"{Interval(**baseline['success']):.1%}"


def layered(rows):
    """Return the rows of policies without and within the safety layer."""
    cells = {(row["setting"], row["policy"]): row for row in rows}
    for (setting, policy), row in cells.items():
        if "later" in row:
            pair = cells[setting, policy.removesuffix(SAFETY)], row
            shares = (f"{100.0 * side[part]['value']:.1f}" for part in ("collision", "success") for side in pair)
            yield setting, policy.removesuffix(SAFETY), *shares, f"{Interval(**row['later']):+.2f}"


def in_rooms(rows):
    """Return the rows of the study in rooms."""
    for row in rows:
        shares = (f"{Interval(**row[name]):.1%}" for name in ("success", "success_difference", "collision", "timeout"))
        yield row["setting"], row["policy"], *shares, f"{row['spl']['value']:.3f}", f"{row['time']['value']:.1f}"


def in_barn(mean):
    """Return the rows of the worlds of BARN."""
    for policy, cells in mean.items():
        shares = (f"{Interval(**cells[name]):.1%}" for name in ("success", "collision", "timeout"))
        yield policy, *shares, f"{cells['barn']['value']:.3f}"


def lived(parts):
    """Return the rows of the live graph."""
    for part, result in parts.items():
        for figure in result["figures"]:
            limit = "" if figure["limit"] is None else f"{figure['limit']:g}"
            yield f"{part}: {figure['name']}", f"{figure['value']:.3g} {figure['unit']}", limit


STUDY, ROOMS, BARN, LIVE = (findings_text.read(name) for name in ("robustness", "rooms_study", "barn", "ros"))
page = io.StringIO()
print("\n## Findings\n", file=page)
print(findings_text.findings(), file=page)
print("\nIntervals are 95 %; tables are folded, and open by a click.\n", file=page)
print("## All comparisons\n", file=page)
print("![PPO minus the tuned baseline by scenario, and what tuning it is worth](benchmarks/robustness.png)\n", file=page)
print(f"{conditions(STUDY)}\n", file=page)
print('<details markdown="1">\n<summary>The findings with their numbers</summary>\n', file=page)
print("\n".join(summary(STUDY)), file=page)
print("\n</details>\n", file=page)
print("Times are means over episodes; a failed episode counts as the time limit. The first baseline of each", file=page)
print("scenario was the fastest one after tuning, and PPO is compared with it.\n", file=page)
titles = "scenario", "policy", "time, s", "untuned, s", "PPO minus it, s", "p (Holm)", "success, %"
print(markdown(titles, compared(STUDY)), file=page)
episodes, first = ROOMS["config"]["episodes"], ROOMS["config"]["first_seed"]
print("## Rooms\n", file=page)
print(
    f"`make study-rooms`: {episodes} held-out rooms of each setting, on seeds from {first:,}. LiDAR `lds01`, noise",
    "`tutorial` and the filter's estimate where the setting does not say otherwise. `ppo-rooms` is the best of the",
    "trainings, by its evaluation seeds.\n",
    sep="\n",
    file=page,
)
titles = "setting", "policy", "success, %", "minus `vfh`, points", "collisions, %", "time-outs, %", "SPL", "time, s"
print(markdown(titles, in_rooms(ROOMS["rows"])), file=page)
print("### What the safety layer costs\n", file=page)
print(
    "Each policy without and with the layer, in the same rooms. The last column is the delay in rooms that it crosses",
    "either way, with its 95 % interval. This is the layer before it had a way out, which only reduced the speed.\n",
    sep="\n",
    file=page,
)
titles = "setting", "policy", "collisions, %", "within", "success, %", "within", "later, s"
print(markdown(titles, layered(ROOMS["rows"])), file=page)
print("## The 200 worlds of the BARN challenge\n", file=page)
print(f"`make bench-barn`: {BARN['config']['episodes']} drives through each world; intervals are over worlds.\n", file=page)
print(
    markdown(("policy", "success, %", "collisions, %", "time-outs, %", "score, at most 0.5"), in_barn(BARN["mean"])), file=page
)
print(belief_text.section(findings_text.read("belief")), file=page)
print(buildings_text.section(findings_text.read("buildings")), file=page)
print("\n## The live graph\n", file=page)
print(f"`make bench-ros`, on {LIVE['cores']} cores; one process per node, over real DDS.\n", file=page)
print(markdown(("figure", "measured", "limit"), lived(LIVE["parts"])), file=page)
print(speed_text.section(findings_text.read("speed"), findings_text.read("speed_zen5")), file=page)
print("\n## The policies that come with the package\n", file=page)
for card in sorted(Path("agents/pretrained").glob("ppo-*.md")):
    print(card.read_text(encoding="utf-8").replace("# ", "### ", 1), file=page)
with mkdocs_gen_files.open("results.md", "a") as results:
    results.write(folded(page.getvalue()))

"""The tables of the page of results, from the benchmarks' files; the words around them stand in `docs/results.md`."""

import json
import re
import sys
from pathlib import Path

import mkdocs_gen_files

sys.path.insert(0, "benchmarks")
from harness.tables import table

SPEED = {
    "environment": "{name}",
    "steps/s": "{steps_per_second:,.0f}",
    "times CartPole": "{ratio:.2f}",
    "steps/CPU s": "{steps_per_cpu_second:,.0f}",
    "times CartPole by CPU s": "{cpu_ratio:.2f}",
}


def read(name):
    """Return the results of a benchmark."""
    return json.loads(Path("benchmarks", f"{name}.json").read_text(encoding="utf-8"))


def named(mapping):
    """Return rows with their names."""
    return [{"name": name, **row} for name, row in mapping.items()]


TABLES = {
    "open_ground": lambda: table(
        read("robustness")["comparisons"],
        {
            "scenario": "{scenario}",
            "PPO, s": "{ppo[time]:.2f}",
            "baseline": "{baselines[0][policy]}",
            "tuned, s": "{baselines[0][time]:.2f}",
            "untuned, s": "{baselines[0][time_untuned].value:.2f}",
            "PPO minus it, s": "{ppo[difference]:+.2f}",
            "p (Holm)": "{p_holm:.2g}",
            "PPO succeeds, %": "{ppo[success]:.1%}",
            "it succeeds, %": "{baselines[0][success]:.1%}",
        },
    ),
    "rooms": lambda: table(
        read("rooms_study")["rows"],
        {
            "setting": "{setting}",
            "policy": "{policy}",
            "success, %": "{success:.1%}",
            "minus `vfh`, points": "{success_difference:+.1%}",
            "collisions, %": "{collision:.1%}",
            "time, s": "{time.value:.1f}",
        },
    ),
    "barn": lambda: table(
        named(read("barn")["mean"]),
        {
            "policy": "{name}",
            "success, %": "{success:.1%}",
            "collisions, %": "{collision:.1%}",
            "time-outs, %": "{timeout:.1%}",
            "score, at most 0.5": "{barn.value:.3f}",
        },
    ),
    "belief": lambda: table(
        read("belief")["rows"],
        {
            "setting": "{setting}",
            "policy, or trained on": "{policy}",
            "reached an hour": "{an_hour:.0f}",
            "more than on truth": "{minus_truth:+.0f}",
            "more than `vfh`": "{minus_vfh:+.0f}",
            "reached, %": "{goals:.1%}",
            "falsely, %": "{false_goals:.1%}",
            "lost, %": "{lost:.1%}",
            "contacts, %": "{collision:.1%}",
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
    "graph": lambda: table(
        [{"part": name, **row} for name, part in read("ros")["parts"].items() for row in part["figures"]],
        {"part": "{part}", "figure": "{name}", "measured": "{value:.3g} {unit}", "limit": "{limit:g}"},
    ),
    "speed": lambda: table(named(read("speed")["environments"]), SPEED),
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


text = Path("docs/results.md").read_text(encoding="utf-8")
text = re.sub(r"<!-- table: (\w+) -->", lambda found: folded(TABLES[found[1]]()), text)
with mkdocs_gen_files.open("results.md", "w") as page:
    page.write(text.replace("<!-- cards -->", cards()))

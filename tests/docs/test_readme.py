"""The README: it is short, its figures are the measured ones, and package indexes get a text without broken links."""

import re
import sys
from urllib.parse import urlsplit

import pytest
from markdown_it import MarkdownIt
from pages import ROOT, measured

OFFICE = "office", "ppo-rooms"
README = (ROOT / "README.md").read_text(encoding="utf-8")


def row_of(phrase):
    (row,) = [line for line in README.splitlines() if line.startswith("|") and phrase in line]
    return row


def test_it_is_short_and_says_what_was_measured():
    """In the row of the table that holds a phrase."""
    lockstep, rooms, faults, calibration = map(measured, ("lockstep", "rooms_study", "faults", "calibration_intervals"))
    by_policy = {row["policy"]: row for row in rooms["rows"] if row["setting"] == "dense"}
    within = {row["policy"]: row for row in measured("rooms_planner")["rows"] if row["setting"] == "dense"}
    in_layer = [within[policy] for policy in ("ppo-rooms+safety", "planner+safety")]
    shares = [f"{100 * row['success']['value']:.1f} %" for row in in_layer]
    total, learned, vfh = faults["total"], by_policy["ppo-rooms"], by_policy["vfh"]
    gains = {row["setting"]: row["success_difference"] for row in rooms["rows"] if row["policy"] == "ppo-rooms"}
    level = [name for name in ("clutter", "corridor", "crowd") if gains[name]["low"] < 0.0 < gains[name]["high"]]
    settings = calibration["coverage"].values()
    truth = [row for setting in settings for row in setting["parameters"].values()]
    share = 100 * sum(row["coverage"] * row["drives"] for row in truth) / sum(row["drives"] for row in truth)
    missions = {row["belief"]: row for row in measured("missions")["missions"] if (row["world"], row["policy"]) == OFFICE}
    reached = tuple(f"{100 * missions[belief]['goals']['value']:.0f} %" for belief in ("wheels", "localizer", "truth"))
    verdicts = [row["verdict"] for row in measured("robustness")["comparisons"]]
    equality, drives = lockstep["parts"]["equality"], sum(setting["drives"] for setting in settings)
    for phrase, claim in (
        (
            "lock-step",
            f"{len(equality['of'])} drives of {lockstep['config']['steps']} steps in the live graph: {equality['largest']}",
        ),
        ("VFH+", f"reaches {100 * learned['success']['value']:.1f} % of the goals, VFH+ {100 * vfh['success']['value']:.1f} %"),
        ("VFH+", f"PPO collides in {100 * learned['collision']['value']:.1f} %, VFH+ in none"),
        ("VFH+", f"three others reach {100 * by_policy['ppo, 3 trainings']['success']['value']:.1f} %"),
        ("VFH+", f"No difference in `{level[0]}`, `{level[1]}` and `{level[2]}`"),
        ("VFH+", "Within the safety layer PPO reaches {}, a planner {}, and none collides".format(*shares)),
        ("A localizer", "{} reached on the wheels alone, {} localized, {} on the true pose".format(*reached)),
        ("A guard", f"{total['injected']} injected faults of {len(faults['faults'])} kinds: {total['unsafe']} unsafe motion"),
        ("Your robot", f"the truth in {share:.1f} % of cases, {drives} drives"),
        ("Honest", f"slower in {verdicts.count('PPO slower')} of {len(verdicts)} scenarios, faster in none"),
    ):
        assert claim in row_of(phrase)
    assert rooms["config"]["episodes"] == 1000
    assert not any(row["collision"]["value"] for row in (vfh, *in_layer))
    assert "PPO faster" not in verdicts
    assert len(README.splitlines()) <= 120


def test_a_package_index_gets_no_link_into_the_repository():
    pytest.importorskip("hatchling", reason="needs the extra [dev]")
    sys.path.insert(0, str(ROOT))
    from hatch_build import long_description

    description = long_description(README)
    inline = [child for token in MarkdownIt("commonmark").enable("table").parse(description) for child in token.children or ()]
    targets = [str(value) for child in inline for name, value in child.attrs.items() if name in ("href", "src")]
    assert targets
    assert all(urlsplit(target).scheme == "https" for target in targets)
    assert "<!--" not in description
    assert "Start here (`docs/start.md`)" in description
    assert re.findall(r"^#+ .*", description, re.MULTILINE) == re.findall(r"^#+ .*", README, re.MULTILINE)
    assert long_description("![a](b.png)\n\n[c](d.md#e) [f](https://g)") == "c (`d.md`) [f](https://g)"

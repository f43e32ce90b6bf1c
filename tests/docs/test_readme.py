"""The README: it is short, its figures are the measured ones, and package indexes get a text without broken links."""

import re
import sys
from urllib.parse import urlsplit

import pytest
from markdown_it import MarkdownIt
from pages import ROOT, measured

README = (ROOT / "README.md").read_text(encoding="utf-8")


def row_of(phrase):
    (row,) = [line for line in README.splitlines() if line.startswith("|") and phrase in line]
    return row


def test_it_is_short():
    assert len(README.splitlines()) <= 120


def test_the_live_graph_is_the_environment():
    equality = measured("lockstep")["parts"]["equality"]
    steps = measured("lockstep")["config"]["steps"]
    assert f"{len(equality['of'])} drives of {steps} steps in the live graph: {equality['largest']}" in row_of("lock-step")


def test_rooms_are_as_measured():
    by_policy = {row["policy"]: row for row in measured("rooms_study")["rows"] if row["setting"] == "dense"}
    learned, vfh = by_policy["ppo-rooms"], by_policy["vfh"]
    assert measured("rooms_study")["config"]["episodes"] == 1000
    assert vfh["collision"]["value"] == 0.0
    row = row_of("VFH+")
    assert (
        f"PPO reaches {100 * learned['success']['value']:.1f} % of the goals, VFH+ {100 * vfh['success']['value']:.1f} %" in row
    )
    assert f"PPO collides in {100 * learned['collision']['value']:.1f} %, VFH+ in none" in row


def test_the_guard_was_measured_on_as_many_faults():
    total = measured("faults")["total"]
    assert total["unsafe"] == 0
    assert f"{total['injected']} injected faults: no unsafe motion" in row_of("A guard")


def test_the_intervals_of_calibration_are_as_measured():
    truth = measured("calibration")["coverage"]["truth"].values()
    share = sum(row["coverage"] * row["drives"] for row in truth) / sum(row["drives"] for row in truth)
    drives = measured("calibration")["config"]["drives"]
    assert f"the truth in {100 * share:.1f} % of cases, {drives} drives" in row_of("Your robot")


def test_losses_of_learning_are_as_measured():
    verdicts = [row["verdict"] for row in measured("robustness")["comparisons"]]
    assert "PPO faster" not in verdicts
    assert f"slower in {verdicts.count('PPO slower')} of {len(verdicts)} scenarios, faster in none" in row_of("Honest")


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

"""The pages on speed, on training on the belief and on results say what the committed files say, losses first."""

import copy
from pathlib import Path

import numpy as np
import pytest

import belief_text
import findings_text
import speed_text
from belief import ratios
from harness import check
from turtlebot_gym_agents.evaluation import comparison


@pytest.fixture
def results():
    return copy.deepcopy(findings_text.read("belief"))


def learned(results, policy, setting):
    return next(row for row in results["rows"] if (row["policy"], row["setting"]) == (policy, setting))


def test_the_section_shows_each_row(results):
    text = belief_text.section(results)
    assert sum(line.startswith("| ") for line in text.splitlines()) == 1 + len(results["rows"])
    for row in results["rows"]:
        assert belief_text.shown(row["an_hour"]) in text


def test_a_gain_is_claimed_where_interval_and_adjusted_p_value_say_so(results):
    for row in results["rows"]:
        if "p_truth" in row:
            row["p_truth"] = 0.5
    assert "No gain shows" in belief_text.sentence(results["rows"])
    row = learned(results, "localizer, evidence", "unknown start")
    row["minus_truth"]["an_hour"] = {"value": 30.0, "low": 20.0, "high": 40.0}
    row["p_truth"] = 0.02  # of nine tests: 0.18 adjusted
    assert "No gain shows" in belief_text.sentence(results["rows"])
    row["p_truth"] = 0.002
    assert "It pays in some settings" in belief_text.sentence(results["rows"])
    assert "+30 (+20, +40) on that belief with its evidence (unknown start)" in belief_text.sentence(results["rows"])


def test_a_win_over_geometry_needs_the_whole_interval(results):
    for row in results["rows"]:
        for other in ("vfh", "planner"):
            if f"minus_{other}" in row:
                row[f"minus_{other}"]["an_hour"] = {"value": 5.0, "low": -1.0, "high": 11.0}
    assert "No policy that was trained here beats geometry" in belief_text.search(results["rows"])
    learned(results, "truth", "right map")["minus_vfh"]["an_hour"]["low"] = 1.0
    assert "Learning beats geometry" in belief_text.search(results["rows"])


def test_the_spread_of_a_ratio_of_sums_holds_the_variance_of_trainings():
    random = np.random.default_rng(0)
    given = random.integers(5, 15, (5, 400))
    alike = random.binomial(given, 0.7)
    unlike = random.binomial(given, np.linspace(0.5, 0.9, 5)[:, None])
    assert ratios(alike, given).mean() == pytest.approx(alike.sum() / given.sum())
    widths = [np.ptp(comparison.spread(ratios(part, given)).interval()[1:]) for part in (alike, unlike)]
    assert widths[0] < 0.03
    assert widths[1] > 0.2


@pytest.fixture
def read(monkeypatch):
    """The files' content, which a test may change."""
    texts = {}
    original = findings_text.read
    monkeypatch.setattr(findings_text, "read", lambda name: texts.setdefault(name, copy.deepcopy(original(name))))
    return findings_text.read


def test_losses_come_first_and_no_finding_is_more_than_a_few_numbers(read):
    text = findings_text.findings()
    rows = read("robustness")["comparisons"]
    slower = sum(row["verdict"] == "PPO slower" for row in rows)
    assert f"slower than the tuned baseline in {slower} of {len(rows)} scenarios" in text.split("### ")[1]
    assert text.startswith("### What loses, or does not hold")
    findings = [line for line in text.splitlines() if line.startswith("* ")]
    assert len(findings) > 12
    assert max(sum(word.strip("().,:").replace(".", "").isdigit() for word in line.split()) for line in findings) <= 6


def test_other_results_make_other_findings(read):
    for row in read("robustness")["comparisons"]:
        row["verdict"] = "PPO faster"
    for kind in read("faults")["faults"].values():
        kind["unsafe"] = 1
    for figure in read("ros")["parts"]["latency"]["figures"]:
        figure["value"] = 0.1
    for row in read("people")["rows"]:
        row["success_minus_rule"] = {"value": 0.0, "low": -0.1, "high": 0.1}
    read("from_policy")["tasks"]["Rooms"]["none"]["reached"] = 3
    text = findings_text.findings()
    assert "plain ones, of which 3 reach it" in text
    assert "learning sometimes pays" in text
    assert f"{len(read('faults')['faults'])} were unsafe" in text
    assert "learned stop beats" not in text
    assert "The live graph keeps its limits" in text


BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


@pytest.fixture
def committed():
    return check.read(BENCHMARKS / "speed.json")


def test_the_committed_file_has_what_the_guard_and_the_page_need(committed):
    assert (BENCHMARKS / "speed.png").read_bytes().startswith(b"\x89PNG")
    ours = [name for name, row in committed["environments"].items() if row["by"] == "turtlebot_gym"]
    assert {"scalar, TurtleBotNav-v0", "vector of 4096, TurtleBotNav-v0", "vector of 65536, TurtleBotNav-v0"} <= {*ours}
    section = speed_text.section(committed)
    for name, row in committed["environments"].items():
        assert f"| {name} |" in section
        assert f"{row['steps_per_second']:,.0f} | {row['ratio']:.2f} |" in section
    assert "busy" in committed
    assert f"| {committed['training']['ratio']:.1f}" not in section
    assert f"{committed['training']['ratio']:.1f} times as many as" in section


def test_the_page_states_the_least_of_the_processors(committed):
    other = check.read(BENCHMARKS / "speed_zen5.json")
    name = "vector of 4096, TurtleBotNav-v0, one thread"
    ratios = [result["environments"][name]["cpu_ratio"] for result in (committed, other)]
    cells = " | ".join(f"{ratio:.2f}" for ratio in (*ratios, min(ratios)))
    assert f"| {name} | {cells} |" in speed_text.section(committed, other)


@pytest.mark.parametrize(("version", "is_older"), [("0.0.1", True), (None, False)])
def test_the_page_says_where_its_figures_are_older_than_others(committed, version, is_older):
    other = check.read(BENCHMARKS / "speed_zen5.json")
    section = speed_text.section(committed | {"version": version or other["version"]}, other)
    assert ("This is of version 0.0.1, which was slower" in section) == is_older


def test_the_page_names_a_peer_that_took_no_part(committed):
    section = speed_text.section(committed | {"peers": {"envpool": {"missing": "no wheel for Python 3.10."}}})
    assert "envpool took no part: no wheel for Python 3.10.\n" in section


def test_the_page_says_what_python_takes_where_that_was_measured(committed):
    text = "Outside its compiled loops a vector step of 1, 4096 environments takes 3.3, 7.5 microseconds."
    assert text in speed_text.section(committed | {"python_us": {"1": 3.26, "4096": 7.5}})
    bare = {name: part for name, part in committed.items() if name != "python_us"}
    assert "Outside its compiled loops" not in speed_text.section(bare)


def test_what_was_not_measured_is_left_out(committed):
    bare = {name: part for name, part in committed.items() if name not in ("busy", "training", "peers")}
    section = speed_text.section(bare | {"used_by_others": None})
    assert "PPO" not in section
    assert "busy" not in section
    assert "meanwhile" not in section

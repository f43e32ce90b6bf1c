"""The findings on the page of results say what the files say, losses first."""

import copy

import pytest

import findings_text


@pytest.fixture
def read(monkeypatch):
    """The files' content, which a test may change."""
    found = {}
    original = findings_text.read
    monkeypatch.setattr(findings_text, "read", lambda name: found.setdefault(name, copy.deepcopy(original(name))))
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
    assert f"{len(read('faults')['faults'])} was unsafe" in text
    assert "learned stop beats" not in text
    assert "The live graph keeps its limits" in text

"""The section on training on the belief claims what the table of its file supports, and no more."""

import copy

import numpy as np
import pytest

import belief_text
from belief import ratios
from findings_text import read
from turtlebot_gym_agents.evaluation import comparison


@pytest.fixture
def results():
    return copy.deepcopy(read("belief"))


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

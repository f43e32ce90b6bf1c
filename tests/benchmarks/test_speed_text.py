"""The page of speed says what the committed file says."""

from pathlib import Path

import pytest

import speed_text
from harness import check

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
    said = "Outside its compiled loops a vector step of 1, 4096 environments takes 3.3, 7.5 microseconds."
    assert said in speed_text.section(committed | {"python_us": {"1": 3.26, "4096": 7.5}})
    bare = {name: part for name, part in committed.items() if name != "python_us"}
    assert "Outside its compiled loops" not in speed_text.section(bare)


def test_what_was_not_measured_is_left_out(committed):
    bare = {name: part for name, part in committed.items() if name not in ("busy", "training", "peers")}
    section = speed_text.section(bare | {"used_by_others": None})
    assert "PPO" not in section
    assert "busy" not in section
    assert "meanwhile" not in section

"""The page of results says what was measured, and the table of a result is made by one function."""

import re
import sys

import pytest
from pages import ROOT, measured, rows_after

pytest.importorskip("stable_baselines3", reason="needs the extra [agents]")

from harness.tables import table

PAGE = " ".join((ROOT / "docs" / "results.md").read_text(encoding="utf-8").split())
TRANSFER = "docs/concepts/transfer.md"


def percent(value, digits=1):
    return f"{100.0 * value:.{digits}f} %"


def span(values):
    return f"{100.0 * min(values):.0f} to {percent(max(values), 0)}"


def rows_of(name, policy):
    return [row for row in measured(name)["rows"] if row["policy"] == policy]


def test_a_table_shows_intervals_and_leaves_what_is_missing_empty():
    rows = [{"name": "a", "share": {"value": 0.5, "low": 0.25, "high": 1.0}, "of": [{"x": 1.5}]}, {"name": "b", "share": None}]
    made = table(rows, {"name": "`{name}`", "share, %": "{share:.0%}", "x": "{of[0][x]:.1f} s"})
    assert made.splitlines() == [
        "| name | share, % | x |",
        "| --- | --- | --- |",
        "| `a` | 50 (25, 100) | 1.5 s |",
        "| `b` |  |  |",
    ]


def test_every_table_of_the_page_can_be_made(monkeypatch):
    monkeypatch.chdir(ROOT)
    monkeypatch.syspath_prepend(ROOT / "docs" / "generate")
    pytest.importorskip("mkdocs_gen_files")
    source = (ROOT / "docs" / "generate" / "results.py").read_text(encoding="utf-8").partition("\ntext = ")[0]
    names = {}
    exec(compile(source, "results.py", "exec"), names)
    wanted = re.findall(r"<!-- table: (\w+) -->", (ROOT / "docs" / "results.md").read_text(encoding="utf-8"))
    assert sorted(wanted) == sorted(names["TABLES"])
    for make in names["TABLES"].values():
        first, *rest = [line.count("|") for line in make().splitlines()]
        assert rest
        assert {*rest} == {first}
    assert "harness.tables" in sys.modules


def test_findings_on_open_ground_are_what_was_measured():
    study = measured("robustness")
    rows = study["comparisons"]
    slower = [row for row in rows if row["verdict"] == "PPO slower"]
    worst = max(row["ppo"]["difference"]["value"] for row in slower)
    assert not [row for row in rows if row["verdict"] == "PPO faster"]
    assert f"slower than the tuned baseline in {len(slower)} of {len(rows)} scenarios, by {worst:.1f} s at most" in PAGE
    seeming = [row for row in rows if row["ppo"]["time"]["value"] < row["baselines"][0]["time_untuned"]["value"]]
    assert f"PPO would have won {len(seeming)} more" in PAGE
    arrived = max(study["false_arrivals"], key=lambda row: row["false_arrival"]["value"])
    assert f"in up to {percent(arrived['false_arrival']['value'])} of the arrivals, under `{arrived['noise']}`" in PAGE
    times = {row["scenario"]: row["baselines"][0]["time"]["value"] for row in rows}
    gains = [times[f"Nav, raw odometry, {noise}"] - times[f"Nav, estimate, {noise}"] for noise in ("tutorial", "wheel")]
    assert f"{gains[0]:.1f} s of a drive under `tutorial`, {gains[1]:.1f} s under `wheel`" in PAGE


def test_findings_in_rooms_are_what_was_measured():
    ppo, vfh = ([row for row in rows_of("rooms_study", policy) if "," not in row["setting"]] for policy in ("ppo-rooms", "vfh"))
    touched = [row["collision"]["value"] for row in ppo]
    least = 100.0 * min(touched)
    most = percent(max(row["collision"]["value"] for row in vfh))
    assert f"collides in {least:.1f} to {percent(max(touched))} of the rooms of a world, `vfh` in {most}" in PAGE
    level = [row["setting"] for row in ppo if row["success_difference"]["low"] <= 0.0 <= row["success_difference"]["high"]]
    assert level == ["clutter", "corridor", "crowd", "map"]
    won = {row["setting"]: 100.0 * row["success_difference"]["value"] for row in ppo if row["success_difference"]["low"] > 0.0}
    assert won.keys() == {"dense", "office", "cellular"}
    assert all(f"{name} ({gain:.1f} points)" in PAGE for name, gain in won.items())
    planned = rows_of("rooms_planner", "planner+safety")
    assert f"reaches {span([row['success']['value'] for row in planned])} of the goals in {len(planned)} worlds" in PAGE
    assert not any(row["collision"]["value"] for row in planned)
    people = measured("people")["rows"]
    for part, words in (
        ("vfh", "more than half of the rooms**: {}"),
        ("rule", "{} by a tuned"),
        ("learned", "{} by a learned"),
    ):
        chosen = [row for row in people if (row["policy"].endswith(part) if part != "vfh" else "stop" not in row["policy"])]
        assert words.format(span([row["success"]["value"] for row in chosen])) in PAGE
    begun = measured("from_policy")["tasks"]["Rooms"]
    assert begun["vfh"]["reached"] == begun["vfh"]["trainings"]
    assert begun["none"]["reached"] == 0
    assert f"end at {percent(begun['vfh']['success'])}; plain ones, of which none reach it, end at" in PAGE
    assert f"end at {percent(begun['none']['success'])}. [Train]" in PAGE


def test_findings_on_belief_buildings_graph_and_guard_are_what_was_measured():
    learned = [row for row in measured("belief")["rows"] if row["policy"] in ("wheels", "localizer", "localizer, evidence")]
    gains = [row["minus_truth"]["value"] for row in learned]
    assert f"training on the truth are {min(gains):+.0f} to {max(gains):+.0f} goals an hour" in PAGE
    assert not [row for row in learned if row["minus_truth"]["low"] > 0.0 or row["minus_vfh"]["low"] > 0.0]
    drives, found = (list(measured("buildings")[part].values()) for part in ("buildings", "found"))
    back, people = (max(rows[name]["lost"] for rows in drives) for name in ("reverse as forward", "50 % people"))
    assert f"for {percent(back)} of the key frames in one of two real buildings" in PAGE
    assert f"People on half of the beams lose it for at most {percent(people)}" in PAGE
    right = [min(rows[f"carried, {share} % people"]["right"] for rows in found) for share in (25, 50)]
    assert f"is right again within 10 m in {percent(right[0], 0)} of the cases, on half in {percent(right[1], 0)}" in PAGE
    figures = [figure for figure in measured("ros")["parts"]["latency"]["figures"] if figure["limit"]][:2]
    values, limits = (" and ".join(f"{figure[key]:.1f}" for figure in figures) for key in ("value", "limit"))
    assert f"{values} ms from odometry to command (median and 99 %), where {limits} are" in PAGE
    total, kinds = measured("faults")["total"], len(measured("faults")["faults"])
    assert f"of {total['injected']:,} injected faults of {kinds} kinds {total['unsafe']} were unsafe" in PAGE


def test_the_tables_of_another_physics_are_what_was_measured():
    results, floors = measured("transfer"), ("unicycle", "grip", "slippery")
    for part, words in (("policies", "## Policies"), ("trained", "PPO on Nav, noise `tutorial`, two trainings")):
        measured_rows = results[part]
        page = rows_after(TRANSFER, words)
        assert len(page) == len(measured_rows) // len(floors)
        for at, (task, policy, noise, *cells) in enumerate(page):
            three = measured_rows[at * 3 : at * 3 + 3]
            assert f"turtlebot_gym/TurtleBot{task}-v0" == three[0]["env"]
            assert (policy, noise) == (three[0]["policy"], three[0]["noise"])
            assert [row["floor"] for row in three] == [*floors]
            both = [row["where_both_succeed"] for row in three[1:]]
            times = [f"{pair['ratio']:.3f}" if pair["ratio"] and pair["n"] > 4 else "" for pair in both]
            assert cells == [*(str(row["succeeded"]) for row in three), *times], policy
    by_cell = {(row["noise"], row["filter"], row["floor"]): row for row in results["filters"]}
    page = rows_after(TRANSFER, "## Filters")
    assert len(page) * len(floors) == len(by_cell)
    for noise, name, *cells in page:
        three = [by_cell[noise, name, floor] for floor in floors]
        wanted = table([three[2]], {"": "{over_matched:.2f}"}).splitlines()[-1].strip("| ")
        assert cells == [*(f"{row['position']:.3f} m, {row['nees']:.1f}" for row in three), wanted]
    drift = table(results["drift"], {"m": "{position:.4f}", "rad": "{heading:.4f}"}).splitlines()[2:]
    assert [f"| {m} | {rad} |" for _, m, rad in rows_after(TRANSFER, "## Drift of wheel odometry")] == drift


def test_the_speed_of_the_readme_is_what_was_measured():
    row = measured("speed")["environments"]["vector of 4096, TurtleBotNav-v0, one thread"]
    claim = f"one core makes {row['steps_per_second'] / 1e6:.1f} million steps/s (EPYC, Zen 5), {row['ratio']:.2f} times"
    assert claim in (ROOT / "README.md").read_text(encoding="utf-8")

"""The page of results says what was measured, and the table of a result is made by one function."""

import re
from importlib import import_module

import pytest
from pages import PAGES, ROOT, measured, text_of

pytest.importorskip("stable_baselines3", reason="needs the extra [agents]")

from harness.tables import table

PAGE = text_of("docs/results.md")
OFFICE = "office", "ppo-rooms"


@pytest.fixture
def generate(monkeypatch):
    """Take the modules that make the site's tables and figures."""
    monkeypatch.chdir(ROOT)
    monkeypatch.syspath_prepend(ROOT / "docs" / "generate")


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


def test_every_table_of_the_pages_can_be_made(generate):
    tables = import_module("tables")
    pages = [path.read_text(encoding="utf-8") for path in PAGES]
    wanted = [name for page in pages for name in re.findall(r"<!-- table: (\w+) -->", page)]
    assert sorted(wanted) == sorted(tables.TABLES)  # each table stands on one page
    for make in tables.TABLES.values():
        first, *rest = [line.count("|") for line in make().splitlines()]
        assert rest
        assert {*rest} == {first}
    assert "<!--" not in tables.filled("\n".join(pages))


@pytest.mark.nightly
def test_every_figure_of_the_pages_can_be_drawn(generate):
    pytest.importorskip("mkdocs_gen_files")
    figures, drawn = import_module("figures"), set()
    for folder, draws in figures.FIGURES.items():
        for draw in draws:
            assert figures.svg(draw()).startswith(b"<?xml")
            drawn.add(f"{folder}/{draw.__name__}.svg")
    assert len(drawn) == sum(map(len, figures.FIGURES.values()))
    shown = {
        (path.parent / name).resolve().relative_to(ROOT / "docs").as_posix()
        for path in PAGES
        for name in re.findall(r"\]\(([\w./]+\.svg)", path.read_text(encoding="utf-8"))
    }
    assert shown == drawn


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
    for policy, words in (("vfh", "in half of the rooms**: {} of the goals"), ("vfh+yield", "is {}; nothing")):
        rows = [row for row in measured("among_people")["rows"] if row["policy"] == policy and row["people"] == "forces"]
        assert words.format(span([row["success"]["value"] for row in rows])) in PAGE
    begun = measured("from_policy")["tasks"]["Rooms"]
    assert begun["vfh"]["reached"] == begun["vfh"]["trainings"]
    assert begun["none"]["reached"] == 0
    assert f"end at {percent(begun['vfh']['success'])}; plain ones, of which none reach it, end at" in PAGE
    assert f"end at {percent(begun['none']['success'])}. [Train]" in PAGE
    pose = measured("from_policy")["tasks"]["Pose"]
    assert pose["polar"]["success"] < pose["none"]["success"]
    three = {row["setting"]: row["success_difference"] for row in rows_of("rooms_study", "ppo, 3 trainings")}
    assert all(three[world]["low"] < 0.0 < three[world]["high"] for world in ("dense", "office"))
    ideal = next(row for row in rows_of("rooms_study", "ppo-rooms") if row["setting"] == "dense, ideal")
    assert ideal["success_difference"]["high"] < 0.0
    barn = measured("barn")["mean"]
    assert {barn[policy]["success"]["value"] for policy in ("planner+safety", "ppo-rooms+safety")} == {1.0}


def test_findings_on_belief_buildings_graph_and_guard_are_what_was_measured():
    learned = [row for row in measured("belief")["rows"] if row["policy"] in ("wheels", "localizer", "localizer, evidence")]
    gains = [row["minus_truth"]["value"] for row in learned]
    assert f"training on the truth are {min(gains):+.0f} to {max(gains):+.0f} goals an hour" in PAGE
    assert not [row for row in learned if row["minus_truth"]["low"] > 0.0 or row["minus_vfh"]["low"] > 0.0]
    hour = {row["policy"]: row["an_hour"]["value"] for row in measured("belief")["rows"] if row["setting"] == "unknown start"}
    assert f"reaches {hour['vfh, turns in doubt']:.0f} goals an hour instead of {hour['vfh']:.0f}" in PAGE
    goals = {
        row["belief"]: row["goals"]["value"]
        for row in measured("missions")["missions"]
        if (row["world"], row["policy"]) == OFFICE
    }
    reached = [percent(goals[belief], 0) for belief in ("wheels", "localizer", "truth")]
    assert "`ppo-rooms` on wheels reaches {}, localized {}, with the true pose {}".format(*reached) in PAGE
    drives, found = (list(measured("buildings")[part].values()) for part in ("buildings", "found"))
    back, people = (max(rows[name]["lost"] for rows in drives) for name in ("reverse as forward", "50 % people"))
    assert f"for {percent(back)} of the key frames in one of two real buildings" in PAGE
    assert f"People on half of the beams lose it for at most {percent(people)}" in PAGE
    right = [min(rows[f"carried, {share} % people"]["right"] for rows in found) for share in (25, 50)]
    assert f"is right again within 10 m in {percent(right[0], 0)} of the cases with people on a quarter of the beams" in PAGE
    assert f"and in {percent(right[1], 0)} with people on half" in PAGE
    figures = [figure for figure in measured("ros")["parts"]["latency"]["figures"] if figure["limit"]][:2]
    values, limits = (" and ".join(f"{figure[key]:.1f}" for figure in figures) for key in ("value", "limit"))
    assert f"{values} ms from odometry to command (median and 99 %), where {limits} are" in PAGE
    total, kinds = measured("faults")["total"], len(measured("faults")["faults"])
    assert f"of {total['injected']:,} injected faults of {kinds} kinds {total['unsafe']} were unsafe" in PAGE


def test_findings_in_another_physics_are_what_was_measured():
    results, page = measured("transfer"), text_of("docs/concepts/transfer.md")
    on_wheels = [row for row in results["policies"] if row["noise"] == "wheel" and "Nav" in row["env"]]
    shares = [
        row["succeeded"] / row["of"] for row in on_wheels if row["floor"] == "slippery" and row["policy"] != "proportional"
    ]
    for text in (page, PAGE):
        assert f"policies reach {span(shares)}" in text
    rows = {(row["policy"], row["noise"], row["floor"]): row for row in results["policies"] if "Nav" in row["env"]}
    later = sorted(rows["bearing", noise, "slippery"]["where_both_succeed"]["ratio"] for noise in ("documented", "tutorial"))
    assert f"{100.0 * (later[0] - 1.0):.0f} to {100.0 * (later[1] - 1.0):.0f} % later" in page
    assert {rows["bearing", noise, "slippery"]["succeeded"] for noise in ("documented", "tutorial")} == {50}
    grip = [row["where_both_succeed"] for row in results["policies"] if row["floor"] == "grip"]
    assert all(abs(pair["ratio"] - 1.0) < 0.021 for pair in grip if pair["n"] > 4)
    (matched,) = (
        row for row in results["filters"] if (row["noise"], row["filter"], row["floor"]) == ("tutorial", "matched", "slippery")
    )
    assert f"its NEES is {matched['nees']:.0f} instead of 3" in page
    drift = [f"{100.0 * row['position']['value']:.1f} cm" for row in results["drift"]]
    for words in ("{} for the unicycle", "{} in MuJoCo with grip", "{} on the slippery floor"):
        assert words.format(drift.pop(0)) in page
    usual, wide = (
        [row["succeeded"] for row in results["trained"] if row["floor"] == "slippery" and f"error {error}" in row["policy"]]
        for error in ("0.02", "0.15")
    )
    assert (
        "{} and {} of 50 goals on the slippery floor with the usual `--randomize`, {} and {} with".format(*usual, *wide) in page
    )


def test_the_speed_of_the_pages_is_what_was_measured():
    row = measured("speed")["environments"]["vector of 4096, TurtleBotNav-v0, one thread"]
    training = measured("speed")["training"]
    millions, times = f"{row['steps_per_second'] / 1e6:.1f} million steps", f"{row['ratio']:.2f} times"
    assert f"one core makes {millions}/s (EPYC, Zen 3), {times}" in (ROOT / "README.md").read_text(encoding="utf-8")
    assert f"makes {millions} a second**, {times} CartPole's" in PAGE
    assert f"PPO learns from {training['steps_per_second']:,.0f} steps/s" in PAGE
    assert f"environment, {training['ratio']:.1f} times as many" in PAGE
    assert f"{millions}/s with 4096 environments on one core of an EPYC (Zen 3), {times}" in text_of("docs/faq.md")
    for page in ("docs/faq.md", "docs/coming.md"):
        assert f"learns from {1000 * round(training['steps_per_second'] / 1000):,} steps/s" in text_of(page)

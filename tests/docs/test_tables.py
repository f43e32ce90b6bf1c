"""What the pages say of measurements is what was measured, and what a page says of a test is a test."""

import re

import yaml
from pages import ROOT, measured, rows_after, text_of

from turtlebot_gym_agents.evaluation.metrics import Interval

ROOMS, SAFETY, BELIEF = (text_of(f"docs/concepts/{name}.md") for name in ("rooms", "safety", "belief"))
CALIBRATE = text_of("docs/howto/calibrate.md")


def shown(interval, form=".1%"):
    return format(Interval(**interval), form)


def span(values, digits=0):
    """Return the least and the greatest of some shares, in per cent; one number if they look the same."""
    low, high = (f"{100.0 * value:.{digits}f}" for value in (min(values), max(values)))
    return f"{high} %" if low == high else f"{low} to {high} %"


def with_margin(interval, digits):
    """Return a number with half of the width of its interval."""
    return f"{interval['value']:.{digits}f} ± {(interval['high'] - interval['low']) / 2.0:.{digits}f}"


def test_the_table_of_fixes_is_what_was_measured():
    cases, rows = measured("fix")["cases"], rows_after("docs/howto/fix.md", "## What it is worth")
    for name, *cells in rows:
        assert cells == [f"{with_margin(cases[name]['position'], 3)} m", with_margin(cases[name]["nees"], 2)], name
    assert len(rows) == len(cases)


def test_shares_of_arrivals_are_what_was_measured():
    page, rules = text_of("docs/concepts/tasks.md"), measured("arrival")["rules"]
    without, within = (
        [rules[noise][f"within {name}"]["false"]["value"] for noise in rules] for name in ("0.15 m", "0.10 m: the margin")
    )
    assert f"Without a margin {span(without)} of the arrivals are false, with it 0 to {100.0 * max(within):.1f} %." in page
    assert f"never arrives at {100.0 * rules['wheel']['inside by 95 %']['never']:.0f} % of the goals" in page
    assert all(0.2 < rules[noise]["within 0.10 m: the margin"]["later"]["value"] < 0.3 for noise in rules)


def test_findings_on_the_localizer_are_what_was_measured():
    results = measured("localization")
    unknown = [world["after 10 s"]["value"] for world in results["unknown"].values()]
    carried = [world["after 20 s"]["value"] for world in results["kidnapped"].values()]
    assert f"Of robots with an unknown start {span(unknown, 1)} are within 0.3 m and 0.3 rad of the truth after 10 s." in BELIEF
    assert f"Of robots that were carried away {span(carried, 1)} are so after 20 s." in BELIEF
    cases = results["cases"].values()
    assert max(world["localizer"]["position_rms"] for world in cases) < 0.0105  # "within 1 cm"
    assert min(world["map off by 5 cm"]["nees"]["value"] for world in cases) > 30.0
    assert (results["config"]["runs"], results["config"]["seconds"]) == (32, 300.0)
    alone = [row["goals"]["value"] for row in measured("missions")["missions"] if row["belief"] == "wheels"]
    assert f"On wheels alone {span(alone)} of the goals are reached" in BELIEF
    assert f"{measured('missions')['config']['missions']} missions each" in BELIEF


def test_findings_in_rooms_are_what_was_measured():
    office = measured("lockstep_office")
    rooms = office["parts"]["rooms"]
    said = f"in {office['config']['rooms']} `office` rooms `planner+safety` reached {rooms['goals']:.0f} goals and hit nothing"
    assert said in ROOMS
    assert rooms["largest difference"] == rooms["collisions"] == 0.0
    assert rooms["same outcome"] == office["config"]["rooms"]
    results = measured("known_map")
    (without, known), number = results["rows"], results["config"]["episodes"]
    assert f"reaches {shown(known['success'])} % of the goals in {number} `office` rooms" in ROOMS
    assert f"without the map {shown(without['success'])} %, and is {shown(known['sooner'], '.2f')} s sooner" in ROOMS
    wheel = measured("rooms_planner_wheel")
    within = [row for row in wheel["rows"] if row["policy"] in ("planner+safety", "ppo-rooms+safety")]
    touched = sum(round(wheel["config"]["episodes"] * row["collision"]["value"]) for row in within)
    assert f"{touched} of {len(within) * wheel['config']['episodes']:,} such drives touched something" in ROOMS
    layer = [row for row in measured("rooms_lidars")["rows"] if row["policy"].endswith("+safety")]
    assert not any(row["collision"]["value"] for row in layer)
    assert {row["setting"] for row in layer} == {row["setting"] for row in measured("rooms_lidars")["rows"]}
    ppo, vfh = (
        [
            row["collision"]["value"]
            for row in measured("rooms_study")["rows"]
            if row["policy"] == name and "," not in row["setting"]
        ]
        for name in ("ppo-rooms", "vfh")
    )
    assert (
        f"in {100.0 * min(ppo):.1f} to {100.0 * max(ppo):.1f} % of the rooms, `vfh` in {100.0 * max(vfh):.1f} % at most"
        in ROOMS
    )
    planned = [row for row in measured("rooms_planner")["rows"] if row["policy"] == "planner+safety"]
    assert f"reaches {span([row['success']['value'] for row in planned])} of the goals without contact" in ROOMS


def test_findings_among_people_are_what_was_measured():
    rows = measured("among_people")["rows"]

    def shares(policy, people="forces"):
        return [row["success"] for row in rows if row["policy"] == policy and row["people"] == people]

    for policy, words in (
        ("vfh", "`vfh` reaches {} of the goals"),
        ("vfh+yield", "On wheel odometry it reaches {}"),
        ("stop that knows", "That one reaches {}:"),
    ):
        assert words.format(span([share["value"] for share in shares(policy)])) in ROOMS
    assert f"and {100.0 * shares('vfh+yield', 'ORCA')[0]['value']:.0f} % among people who walk by ORCA" in ROOMS
    for policy in ("stop at distances", "arcs around tracks", "stop learned"):
        for people in ("forces", "ORCA"):
            pairs = zip(shares("vfh+yield", people), shares(policy, people), strict=True)
            assert all(other["low"] < best["high"] for best, other in pairs), f"{policy} gains"


def test_what_the_layer_costs_on_the_node_is_what_was_measured():
    figures = {figure["name"]: figure["value"] for figure in measured("ros_layer")["parts"]["layer"]["figures"]}
    page = text_of("docs/concepts/graph.md")
    for name, words in (
        ("/odom to /cmd_vel with {}, p50", "by {:.1f} to {:.1f} ms"),
        ("CPU of velocity_controller with {}, 10 commands a second", "takes {:.1f} to {:.1f} % of a core more"),
    ):
        more = [
            figures[name.format(f"{policy}+safety")] - figures[name.format(policy)]
            for policy in ("vfh", "ppo-rooms", "planner")
        ]
        assert words.format(min(more), max(more)) in page
    median, tail = [figure for figure in measured("ros")["parts"]["latency"]["figures"] if figure["limit"]][:2]
    assert f"after {median['value']:.1f} ms** (median; 99 % within {tail['value']:.1f} ms)" in page
    assert f"limits are {median['limit']:g} and {tail['limit']:g} ms" in page


def test_findings_on_the_guard_are_what_was_measured():
    faults = measured("faults")
    kinds, total = faults["faults"], faults["total"]
    unsafe = {name: kind["unsafe"] for name, kind in kinds.items() if kind["unsafe"]}
    assert unsafe == {"robot turns the other way": 1, "LiDAR turned by 180 degrees": 1}
    assert (
        f"{total['unsafe']} of {total['injected']:,} injected faults were unsafe.** `make faults` injects {len(kinds)} kinds"
        in SAFETY
    )
    others = sum(kind["injected"] for name, kind in kinds.items() if name not in unsafe)
    assert f"The other {len(kinds) - len(unsafe)} kinds had no unsafe fault in {others:,}, a share below 0.3 %" in SAFETY
    assert 1.0 - 0.05 ** (1.0 / others) < 0.003
    assert max(kind["longest_lag"] for kind in kinds.values()) < 0.5  # "within half a second in every kind"
    standby = measured("standby")
    said = f"In {standby['within_0.3_s']} of {standby['times']} kills of the guard at full speed the zero came within"
    assert f"{said} {standby['longest_s']:.2f} s, after {standby['longest_m']:.3f} m at most" in SAFETY


def test_each_hazard_names_tests_and_faults_that_exist():
    exist = {
        name for path in (ROOT / "tests").rglob("test_*.py") for name in re.findall(r"def (test_\w+)", path.read_text("utf-8"))
    }
    parts = yaml.safe_load((ROOT / "docs" / "generate" / "hazards.yaml").read_text(encoding="utf-8"))
    rows = [row for part in parts.values() for row in part]
    assert len(rows) == 25
    assert all(row["tests"] and exist.issuperset(row["tests"]) for row in rows)
    assert {kind for row in rows for kind in row.get("faults", ())} <= measured("faults")["faults"].keys()
    assert all(("faults" in row) != ("after" in row) for row in rows)


def test_findings_on_calibration_are_what_was_measured():
    settings = measured("calibration_intervals")["coverage"].values()

    def share(rows):
        rows = list(rows)
        return 100.0 * sum(row["coverage"] * row["drives"] for row in rows) / sum(row["drives"] for row in rows)

    every = share(row for setting in settings for row in setting["parameters"].values())
    veer = share(setting["parameters"]["veer"] for setting in settings)
    drives = sum(setting["drives"] for setting in settings)
    assert (
        f"{every:.1f} % of the intervals hold the true value, and {veer:.1f} % of those of `veer`, in {drives} drives"
        in CALIBRATE
    )
    alone = [row for row in measured("calibration")["coverage"]["innovations"].values() if row["determined"]]
    held = sum(row["determined"] * row["coverage_where_determined"] for row in alone) / sum(row["determined"] for row in alone)
    scans = measured("calibration_by_scans")["coverage"]["all"]
    assert f"By scans alone it is {100.0 * scans:.1f} %, and from innovations alone {100.0 * held:.1f} %." in CALIBRATE
    (first,) = (
        row for row in measured("calibration_recorded")["wheels"] if (row["log"], row["rate"]) == ("wifibot1.txt", 50.0)
    )
    piece = first["pieces"][0]
    assert (
        f"drifts {piece['file']:.3f} m in {piece['length']:g} m of the second, raw odometry {piece['raw']:.3f} m" in CALIBRATE
    )
    results = measured("calibration_policy")
    lost = {end: 100.0 * results["lost"][end] for end in ("value", "low", "high")}
    assert f"{lost['value']:.2f} % of the time ({lost['low']:+.2f}, {lost['high']:+.2f}) in fourteen pairs" in CALIBRATE
    for row in results["robots"].values():
        assert abs(row["error"]) < 0.02
        best = [min(training["time"] for training in row["times"][side]) for side in ("calibrated", "truth")]
        assert abs(best[0] / best[1] - 1.0) < 0.006
    assert (results["config"]["first"], results["config"]["seeds"], results["config"]["episodes"]) == (3, 7, 500)
    assert all(abs(results["lost"][end]) < 0.02 for end in ("low", "high"))


def test_findings_on_noises_are_what_was_measured():
    page = text_of("docs/concepts/noises.md")
    of = {(case["policy"], case["noise"], case["filter"]): case for case in measured("recorded_policies")["cases"]}
    for name, *_, ratio in rows_after("docs/concepts/noises.md", "# Which noise is yours"):
        case = of.get(("bearing", name.strip("`"), "matched"))
        assert ratio == (f"{case['ratio']:.2f}" if case else "")
    wheel, recorded = (of["bearing", noise, "matched"] for noise in ("wheel", "recorded"))
    assert f"is {wheel['ratio']:.2f} with `wheel` and {recorded['ratio']:.2f} with `recorded`" in page
    reached, falsely = (100.0 * recorded[part]["value"] for part in ("success", "false_arrival"))
    assert f"`bearing` reaches {reached:.0f} % of the goals, and in {falsely:.0f} % of the drives the belief arrives" in page
    names = ("matched", "calibrated", "matched, fix localization")
    shares = [f"{100.0 * of['ppo-nav', 'recorded', name]['success']['value']:.0f}" for name in names]
    assert "raises `ppo-nav` from {} to {} %, and a localization to {} %".format(*shares) in page
    wheel, recorded = (of["proportional", noise, "matched"] for noise in ("wheel", "recorded"))
    errors = [f"{recorded[f'{what}_position_mean']['value']:.3f} m" for what in ("estimate", "odometry")]
    assert (
        f"{wheel['estimate_position_mean']['value']:.3f} m both, ratio {wheel['ratio']:.2f}; on wheels as recordings show them "
        f"{errors[0]} of {errors[1]}"
    ) in text_of("README.md")

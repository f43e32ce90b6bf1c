"""The tables of the pages are what was measured, and what a page says of a test is a test."""

import re

from pages import ROOT, measured, rows_after

from turtlebot_gym.presets import make_robot
from turtlebot_gym_agents.evaluation.metrics import Interval
from turtlebot_gym_lab.drives.reading import FORMATS

MEASURED = {
    "`tutorial`": "tutorial",
    "`documented`, no bias": "documented without its bias",
    "`rough`, no slip": "rough without slip",
    "`rough`": "rough",
}
"""Settings of `benchmarks/estimation.json`, as the page of the belief calls them."""


def with_margin(interval, digits):
    """Return a number with half of the width of its interval."""
    return f"{interval['value']:.{digits}f} ± {(interval['high'] - interval['low']) / 2.0:.{digits}f}"


def test_the_tables_of_filters_and_of_fixes_are_what_was_measured():
    settings, noise = measured("estimation")["settings"], ""
    rows = rows_after("docs/concepts/belief.md", "The table shows the RMSE after 3 s")
    for said, name, *numbers in rows:
        noise = said or noise
        figures = settings[MEASURED[noise]]["filters"][name.replace("`", "")]
        wanted = [*(with_margin(ratio, 3) for ratio in figures["ratio"]), with_margin(figures["nees"], 2)]
        assert numbers == wanted, (noise, name)
    assert len(rows) == 11
    cases, rows = measured("fix")["cases"], rows_after("docs/howto/fix.md", "## What it is worth")
    for name, *cells in rows:
        assert cells == [f"{with_margin(cases[name]['position'], 3)} m", with_margin(cases[name]["nees"], 2)], name
    assert len(rows) == len(cases)


def test_the_table_of_arrivals_is_what_was_measured():
    rules = measured("arrival")["rules"]
    page, rows = (ROOT / "docs" / "concepts" / "tasks.md").read_text(encoding="utf-8"), 0
    names, *lines = [line for line in page.partition("`benchmarks/arrival.json`")[2].splitlines() if line.startswith("|")]
    noises = [cell.strip(" `") for cell in names.strip("|").split("|")[1:]]
    for line in lines[1:]:
        rule, *cells = (cell.strip() for cell in line.strip("|").split("|"))
        for noise, cell in zip(noises, cells, strict=True):
            row = rules[noise][rule]
            never = f", never {100.0 * row['never']:.0f} %" if row["never"] else ""
            assert cell == f"{100.0 * row['false']['value']:.1f} %, {row['later']['value']:.2f} s{never}", line
        rows += 1
    assert rows == 7


def test_the_table_of_the_localizer_is_what_was_measured():
    results, page = measured("localization"), "docs/concepts/belief.md"
    rows = rows_after(page, "five minutes in each of three worlds")
    for name, *cells in rows:
        figures = [results["cases"][world][name] for world in ("dense", "office", "corridor")]
        assert cells == [
            f"{100.0 * figure['position_rms']:.1f} / {1e3 * figure['heading_rms']:.0f} / {figure['nees']['value']:.1f}"
            for figure in figures
        ], name
    assert len(rows) == len(results["cases"]["dense"])
    assert (results["config"]["runs"], results["config"]["seconds"]) == (32, 300.0)
    shares = rows_after(page, "Share of robots within 0.3 m and 0.3 rad of the truth")
    for said, *cells in shares:
        when, of = said.partition("after ")[2], results["unknown" if said.startswith("unknown") else "kidnapped"]
        figures = [figure[f"after {when}" if when else "sure and wrong"] for figure in of.values()]
        assert cells == [f"{100.0 * (figure['value'] if isinstance(figure, dict) else figure):.1f}" for figure in figures], said
    assert len(shares) == 4
    later = [100.0 * setting["after 2 s"]["value"] for setting in results["blocked"].values()]
    assert f"in {min(later):.0f} to {max(later):.0f} % of the cases" in (ROOT / page).read_text(encoding="utf-8")


def test_the_table_of_missions_is_what_was_measured():
    results, names = measured("missions"), {"wheels": "wheels alone", "localizer": "localizer", "truth": "the truth"}
    units = {"false_goals": 100.0, "goals_an_hour": 1.0, "lost": 100.0}
    for row, x in zip(rows_after("docs/concepts/belief.md", "## Goals in turn"), results["missions"], strict=True):
        others = [f"{unit * x[name]['value']:.0f}" for name, unit in units.items()]
        assert row == [x["world"], f"`{x['policy']}`", names[x["belief"]], shown(x["goals"], ".0%"), *others]
    assert f"On {results['config']['missions']} missions" in (ROOT / "docs/concepts/belief.md").read_text(encoding="utf-8")


def test_lock_step_in_offices_is_what_was_measured():
    """With the planner's memory and the safety layer."""
    office = measured("lockstep_office")
    rooms, page = office["parts"]["rooms"], (ROOT / "docs/concepts/rooms.md").read_text(encoding="utf-8")
    said = f"in {office['config']['rooms']} `office` rooms `planner+safety` reached {rooms['goals']:.0f} goals and hit nothing"
    assert said in " ".join(page.split())
    assert rooms["largest difference"] == 0.0
    assert rooms["collisions"] == 0.0
    assert rooms["same outcome"] == office["config"]["rooms"]
    robot = measured("as_robot_office")
    goals = [round(robot[arm]["drives"] * robot[arm]["success"]["value"]) for arm in ("plain, bare", "robot, bare")]
    claim = f"`planner+safety` reaches {goals[0]} goals by plain messages and {goals[1]} by the robot's, difference"
    value, low, high = (100.0 * robot["difference, bare"][part] for part in ("value", "low", "high"))
    assert f"{claim} {value:.1f} points ({low:+.1f}, {high:+.1f}), without a contact" in " ".join(page.split())
    assert not robot["plain, bare"]["contacts"] + robot["robot, bare"]["contacts"]


def test_what_the_layer_costs_on_the_node_is_what_was_measured():
    results = measured("ros_layer")
    figures = {figure["name"]: figure["value"] for figure in results["parts"]["layer"]["figures"]}
    page = " ".join((ROOT / "docs/concepts/graph.md").read_text(encoding="utf-8").split())
    for name, words in (
        ("/odom to /cmd_vel with {}, p50", "delays the command by {:.1f} to {:.1f} ms"),
        ("CPU of velocity_controller with {}, 10 commands a second", "takes {:.1f} to {:.1f} % of a core more"),
    ):
        more = [
            figures[name.format(f"{policy}+safety")] - figures[name.format(policy)]
            for policy in ("vfh", "ppo-rooms", "planner")
        ]
        assert words.format(min(more), max(more)) in page
    assert f"{results['config']['layer_seconds']:.0f} s each" in page


def test_what_a_known_map_is_worth_is_what_was_measured():
    page, results = " ".join((ROOT / "docs/concepts/rooms.md").read_text(encoding="utf-8").split()), measured("known_map")
    (without, known), number = results["rows"], results["config"]["episodes"]
    assert f"reaches {shown(known['success'])} % of the goals in {number} `office` rooms" in page
    assert f"without the map {shown(without['success'])} %" in page
    assert f"{shown(known['sooner'], '.2f')} s sooner" in page
    touched = [round(number * row["collision"]["value"]) for row in (without, known)]
    assert "{} of them touched something without the map, and {} with it".format(*touched) in page


def test_the_table_of_a_robot_that_sways_is_what_was_measured():
    page, results = "docs/concepts/rooms.md", measured("rooms_planner_wheel")
    driven, touched = {(row["setting"], row["policy"]): row for row in results["rows"]}, 0
    table = rows_after(page, "**Near obstacles, a robot that sways")
    for world, policy, *cells in table:
        pair = [driven[f"{world.strip('`')}, noise wheel", policy.strip("`") + end] for end in ("", "+safety")]
        touched += round(results["config"]["episodes"] * pair[1]["collision"]["value"])
        assert cells == [shown(row[part]) for row in pair for part in ("success", "collision")] + [
            shown(pair[1]["later"], "+.2f")
        ]
    assert f"In these {len(table) * results['config']['episodes']:,} drives {touched} touched" in (ROOT / page).read_text(
        "utf-8"
    )


def test_the_table_of_people_is_what_was_measured():
    results = measured("people")["rows"]
    for row, x in zip(rows_after("docs/concepts/rooms.md", "## People"), results, strict=True):
        policy = x["policy"] if "," in x["policy"] else f"`{x['policy']}`"
        assert row == [
            f"`{x['lidar']}`",
            policy,
            shown(x["success"]),
            shown(x["collision"]),
            f"{x['time_to_goal']['value']:.1f}",
        ]
    page = " ".join((ROOT / "docs/concepts/rooms.md").read_text(encoding="utf-8").split())
    gains = {row["lidar"]: row["success_minus_rule"] for row in results if "success_minus_rule" in row}
    for lidar, words in (
        ("lds01", "`lds01`: {} points ({}, {}), with"),
        ("lds02", "`lds02` it is {} ({}, {})"),
        ("a1", "`a1` {} ({}, {}):"),
    ):
        assert words.format(*(f"{100.0 * gains[lidar][part]:+.1f}" for part in ("value", "low", "high"))) in page
    assert gains["lds01"]["low"] > 0.0


def shown(interval, form=".1%"):
    return format(Interval(**interval), form)


def test_the_tables_of_rooms_are_what_was_measured():
    study = measured("rooms_study")
    by_setting = {(row["setting"], row["policy"]): row for row in study["rows"]}
    planned = {(row["setting"], row["policy"]): row for row in measured("rooms_planner")["rows"]}
    page, tables = "docs/concepts/rooms.md", 0
    for name, *cells in rows_after(page, "## Which policies find the way"):
        policy = {"PPO, 3 trainings": "ppo, 3 trainings"}.get(name, name.strip("`"))
        source = planned if policy.endswith("+safety") else by_setting  # the layer of the study was an earlier one
        rows = [source[world, policy] for world in ("dense", "office")]
        assert cells == [shown(row[part]) for row in rows for part in ("success", "collision")], name
        tables += 1
    worlds = [(name.strip("`"), cells) for name, *cells in rows_after(page, "policies that arrive hardly make a detour")]
    lidars = [(f"dense, {name.strip('`')}", cells) for name, *cells in rows_after(page, "**With an `ideal` LiDAR")]
    for name, cells in [*worlds, *lidars]:
        setting = name.removesuffix(", lds01")
        vfh, ppo = (by_setting[setting, policy] for policy in ("vfh", "ppo-rooms"))
        wanted = [
            shown(vfh["success"]),
            shown(ppo["success"]),
            shown(ppo["collision"]),
            shown(ppo["success_difference"], "+.1%"),
        ]
        assert cells == wanted, name
        tables += 1
    for world, *cells in rows_after(page, "**A memory finds the way without learning.**"):
        vfh, planner = (planned[world.strip("`"), policy] for policy in ("vfh", "planner+safety"))
        wanted = [shown(vfh["success"]), shown(planner["success"]), shown(planner["collision"])]
        times = [f"{row['time']['value']:.1f}" for row in (vfh, planner)]
        assert cells == [*wanted, shown(planner["success_difference"], "+.1%"), *times], world
    planned |= {(row["setting"], row["policy"]): row for row in measured("rooms_planner_lidars")["rows"]}
    for world, lidar, *cells in rows_after(page, "**Other LiDARs will do too.**"):
        setting = f"{world}, {lidar}".replace("`", "")
        vfh, planner = (planned[setting, policy] for policy in ("vfh", "planner+safety"))
        times = [f"{row['time']['value']:.1f}" for row in (vfh, planner)]
        assert cells == [shown(vfh["success"]), shown(planner["success"]), shown(planner["collision"]), *times], setting
        tables += 1
    for world, *cells in rows_after(page, "**Learning gains from the layer.**"):
        bare, within = (planned[world.strip("`"), policy] for policy in ("ppo-rooms", "ppo-rooms+safety"))
        wanted = [shown(row[part]) for row in (bare, within) for part in ("success", "collision")]
        assert cells == [*wanted, f"{within['time']['value']:.1f}"], world
    seen = {(row["setting"], row["policy"]): row for row in measured("rooms_lidars")["rows"]}
    for lidar, *cells in rows_after(page, "**Within the safety layer every LiDAR will do.**"):
        setting = f"dense, {lidar.replace('`', '')}".removesuffix(", lds01")
        arms = [seen[setting, policy] for policy in ("ppo-rooms", "ppo-rooms+safety")]
        assert cells == [shown(arm[part]) for arm in arms for part in ("success", "collision")], lidar
        tables += 1
    for world, policy, *cells in rows_after(page, "**The safety layer is not free.**"):
        bare, safe = (by_setting[world.strip("`"), policy.strip("`") + end] for end in ("", "+safety"))
        shares = [f"{100.0 * figures[part]['value']:.1f}" for part in ("collision", "success") for figures in (bare, safe)]
        assert cells == [*shares, shown(safe["later"], "+.2f")], policy
        tables += 1
    barn = measured("barn")["mean"]
    for name, *cells in rows_after(page, "**The 200 worlds of the BARN challenge**"):
        units = (("success", 100.0, 1), ("collision", 100.0, 1), ("timeout", 100.0, 1), ("barn", 1.0, 3))
        for cell, (part, unit, digits) in zip(cells, units, strict=True):
            figures = barn[name.strip("`")][part]
            margin = f"{0.5 * unit * (figures['high'] - figures['low']):.{digits}f}"
            assert cell == f"{unit * figures['value']:.{digits}f}" + (f" ± {margin}" if float(margin) else ""), name
        tables += 1
    assert tables == 8 + 7 + 4 + 7 + 6 + 12 + len(barn)


def hazards():
    """Return the rows of the hazard tables."""
    headings = ("## If the guard dies", "## Sensors that lie")
    return [row for heading in headings for row in rows_after("docs/concepts/safety.md", heading)]


def test_each_row_of_the_hazard_tables_names_a_test_that_exists():
    exist = {
        name for path in (ROOT / "tests").rglob("test_*.py") for name in re.findall(r"def (test_\w+)", path.read_text("utf-8"))
    }
    named = [re.findall(r"test_\w+", row[-1]) for row in hazards()]
    assert len(named) == 24
    assert all(names and exist.issuperset(names) for names in named)


HAZARDS = {
    "the guard is killed or": ["guard killed"],
    "the guard is suspended or": ["guard hangs"],
    "the standby dies": ["standby killed or hung"],
    "a flood on a topic of the guard": [
        f"flood on {topic}" for topic in ("cmd_vel_in", "cmd_vel_teleop", "scan", "emergency_stop")
    ],
    "a flood on another": [f"flood on {topic}" for topic in ("odom", "estimate", "reference", "pose_fix", "another topic")],
    "a button ends, or": ["press lost by a radio", "one of two buttons silent", "button restarted"],
    "odometry ends": ["odometry dead", "odometry late", "odometry repeated"],
    "scans are late": ["scans late"],
    "the LiDAR repeats": ["LiDAR frozen"],
    "fewer than 2 %": ["LiDAR covered", "LiDAR all zero", "LiDAR all infinite"],
    "the LiDAR is mounted": ["LiDAR turned by 180 degrees"],
    "a twist beyond": ["odometry impossible"],
    "two nodes publish `/odom`": ["two odometries"],
}
"""Causes in the hazard tables, and the injected faults that show them."""


def test_times_and_distances_of_hazards_are_those_of_the_injected_faults():
    faults, speed = measured("faults")["faults"], make_robot("burger").max_wheel
    for cause, kinds in HAZARDS.items():
        (row,) = (row for row in hazards() if row[0].startswith(cause))
        stops = [faults[kind]["longest_stop"] for kind in kinds]
        if None in stops:
            kind = faults[kinds[stops.index(None)]]
            assert row[3:5] == [f"{kind['unsafe']} of {kind['injected']} drove on", "to the wall"], cause
        else:
            assert row[3:5] == [f"{max(stops):.2f} s", f"{speed * max(stops):.2f} m"], cause


def test_the_table_of_recordings_is_what_the_reader_knows():
    rows = rows_after("docs/howto/record.md", "## What can be read")
    assert rows[: len(FORMATS)] == [[form.name, form.files, form.holds] for form in FORMATS]


def percent(interval):
    """Return a share or a difference of shares with its interval, in per cent."""
    return "{value:.1f} [{low:.1f}, {high:.1f}]".format(**{name: 100.0 * part for name, part in interval.items()})


def test_the_table_of_rooms_by_a_robots_messages_is_what_was_measured():
    arms = measured("as_robot")
    for name, *cells in rows_after("docs/concepts/rooms.md", "For `benchmarks/as_robot.json`"):
        arm = arms[name]
        if name.startswith("difference"):
            assert cells == ["", percent(arm), "", ""], name
        else:
            clearance = f"{arm['least clearance']:.3f}"
            assert cells == [str(arm["drives"]), percent(arm["success"]), str(arm["contacts"]), clearance], name


def test_the_table_of_policies_on_calibrated_files_is_what_was_measured():
    results = measured("calibration_policy")
    rows = rows_after("docs/howto/calibrate.md", "The last table is about policies")
    for name, *cells in rows:
        row = results["robots"][name]
        times = [", ".join(f"{training['time']:.2f}" for training in row["times"][side]) for side in ("calibrated", "truth")]
        assert cells == [f"{row['turn_scale']:.3f}", f"{row['found']:.3f}", *times, f"{row['ratio']:.3f}"], name
        assert abs(row["error"]) < 0.02
        best = [min(training["time"] for training in row["times"][side]) for side in ("calibrated", "truth")]
        assert abs(best[0] / best[1] - 1.0) < 0.006, name
    assert len(rows) == len(results["robots"])
    assert (results["config"]["first"], results["config"]["seeds"], results["config"]["episodes"]) == (3, 7, 500)
    lost = [f"{100.0 * results['lost'][end]:+.2f}" for end in ("value", "low", "high")]
    assert lost == ["+0.05", "-1.14", "+1.23"]
    assert all(abs(results["lost"][end]) < 0.02 for end in ("low", "high"))


def test_the_tables_of_the_recorded_noise_are_what_was_measured():
    page, cases = "docs/concepts/noises.md", measured("recorded_policies")["cases"]
    of = {(case["policy"], case["noise"], case["filter"]): case for case in cases}

    def cells(case, *names):
        numbers = {name: case[name]["value"] for name in names}
        return [
            f"{100.0 * value:.0f}" if name in ("success", "false_arrival") else f"{value:.3f}"
            for name, value in numbers.items()
        ]

    errors = ("estimate_position_mean", "odometry_position_mean")
    policies = rows_after(page, "## What policies do with it")
    for policy, noise, *numbers, ratio in policies:
        case = of[policy.strip("`"), noise.strip("`"), "matched"]
        assert [*numbers, ratio] == [*cells(case, "success", "false_arrival", *errors), f"{case['ratio']:.2f}"]
    filters = rows_after(page, "on the same drives of `ppo-nav`")
    for name, *numbers, ratio in filters:
        case = of["ppo-nav", "recorded", name.replace("`", "").replace(" with the fix ", ", fix ")]
        assert [*numbers, ratio] == [*cells(case, "success", *errors), f"{case['ratio']:.2f}"]
    for name, *_, ratio in rows_after(page, "# Which noise is yours"):
        case = of.get(("bearing", name.strip("`"), "matched"))
        assert ratio == (f"{case['ratio']:.2f}" if case else "")
    assert (len(policies), len(filters)) == (12, 8)
    wheel, recorded = (of["proportional", noise, "matched"] for noise in ("wheel", "recorded"))
    said = f"{cells(wheel, errors[0])[0]} m both, ratio {wheel['ratio']:.2f}"
    assert (
        f"{said}; on wheels as recordings show them {cells(recorded, errors[0])[0]} m of {cells(recorded, errors[1])[0]} m"
        in (ROOT / "README.md").read_text(encoding="utf-8")
    )


def test_the_table_of_what_recordings_show_is_what_was_fitted():
    found = measured("recorded")
    events = ("gaps", "gap ends", "leaps", "resets", "slips", "counted forwards")
    intervals = [fits["preset"] for fits in found["parameters"].values()] + [found["events"][name] for name in events]
    rows = rows_after("docs/concepts/noises.md", "## What recordings show")
    for (_, _, cell, _), fit in zip(rows, intervals, strict=True):
        assert cell == f"{fit['value']:.3g} ({fit['low']:.3g}, {fit['high']:.3g})"

"""The README: it is short, and its figures are the measured ones."""

import re

import pytest
import tomllib
from pages import PAGES, ROOT, blocks_of, measured

OFFICE = "office", "ppo-rooms"
README = (ROOT / "README.md").read_text(encoding="utf-8")


FIRST = README.partition("\n## Details\n")[0]
"""What a visitor reads before the details."""
PROSE = " ".join(re.sub(r"```.*?```|\]\([^)]*\)|<[^>]*>", " ", FIRST, flags=re.DOTALL).split())


def row_of(phrase):
    (row,) = [line for line in README.splitlines() if line.startswith("|") and phrase in line]
    return row


def medians_of(localizer):
    """Return the median errors of another localizer in the two buildings, cm, from the page of results."""
    rows = [line for line in (ROOT / "docs/results.md").read_text("utf-8").splitlines() if line.startswith(f"| {localizer} |")]
    return [cell.split()[0] for cell in rows[0].strip("|").split("|")[1:]]


def test_the_first_screen_is_short():
    """Words as `wc -w` counts them, without tags; names of systems and versions are no figures."""
    first, whole = (len(re.sub(r"<[^>]*>", "", text).split()) for text in (FIRST, README))
    assert first <= 250
    assert whole <= 900
    figures = re.findall(r"\d[\d.]*", re.sub(r"ROS 2|x86-64|Python 3\.11", "", PROSE))
    assert 3 <= len(figures) <= 8, figures
    code, command = (block for block in blocks_of(ROOT / "README.md")[:2])
    assert (code.kind, command.kind) == ("python", "console")
    assert len([line for line in code.text.splitlines() if line]) <= 5
    assert len(command.text.splitlines()) == 1


def test_the_first_command_clones_the_address_that_the_package_names():
    """Where pyproject.toml names none, the address is that of the page that one reads."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    address = project.get("urls", {}).get("Repository", "ADDRESS")
    assert f"git clone {address} turtlebot_gym" in FIRST
    assert ("address of this page" in PROSE) == (address == "ADDRESS")


def test_the_figures_of_the_first_screen_are_what_was_measured():
    speed = measured("speed")["environments"]["vector of 4096, TurtleBotNav-v0, one thread"]
    buildings = [rows["5 cm"] for rows in measured("buildings")["buildings"].values()]
    verdicts = [row["verdict"] for row in measured("robustness")["comparisons"]]
    equality = measured("lockstep")["parts"]["equality"]
    assert not any(row["lost"] for row in buildings)
    assert "PPO faster" not in verdicts
    for claim in (
        f"One core makes {speed['steps_per_second'] / 1e6:.1f} million steps/s",
        f"In {len(equality['of'])} live drives their largest difference is {equality['largest']}.",
        f"follows two recorded buildings to {100 * max(row['median'] for row in buildings):.0f} cm (median) and is never lost",
        f"with its defaults it reaches {medians_of('nav2_amcl, defaults')[0]} cm",
        f"slower than a tuned baseline in {verdicts.count('PPO slower')} of {len(verdicts)} scenarios, and faster in none",
    ):
        assert claim in PROSE
    assert {*medians_of("nav2_amcl, defaults")} == {"12"}
    by_policy = {row["policy"]: row["success"] for row in measured("rooms_planner")["rows"] if row["setting"] == "dense"}
    planner, learned = by_policy["planner+safety"], by_policy["ppo-rooms+safety"]
    assert learned["value"] <= planner["high"], "In rooms a planner reaches as many goals."


def test_the_table_says_what_was_measured():
    """In the row of the table that holds a phrase."""
    rooms, faults, calibration = map(measured, ("rooms_study", "faults", "calibration_intervals"))
    buildings = [rows["5 cm"] for rows in measured("buildings")["buildings"].values()]
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
    drives = sum(setting["drives"] for setting in settings)
    for phrase, claim in (
        (
            "Real buildings",
            "{} cm (median), {:.1f} % lost; nav2_amcl, tuned and its map shifted by half a cell: {} cm".format(
                " and ".join(f"{100 * row['median']:.1f}" for row in buildings),
                100 * max(row["lost"] for row in buildings),
                " and ".join(medians_of("the same, its map shifted by half a cell")),
            ),
        ),
        ("VFH+", f"reaches {100 * learned['success']['value']:.1f} % of the goals, VFH+ {100 * vfh['success']['value']:.1f} %"),
        ("VFH+", f"PPO collides in {100 * learned['collision']['value']:.1f} %, VFH+ in none"),
        ("VFH+", f"three others reach {100 * by_policy['ppo, 3 trainings']['success']['value']:.1f} %"),
        ("VFH+", f"No difference in `{level[0]}`, `{level[1]}` and `{level[2]}`"),
        ("VFH+", "Within the safety layer PPO reaches {}, a planner {}, and none collides".format(*shares)),
        ("A localizer", "{} reached on the wheels alone, {} localized, {} on the true pose".format(*reached)),
        ("A guard", f"{total['injected']} injected faults of {len(faults['faults'])} kinds: {total['unsafe']} unsafe motion"),
        ("Your robot", f"the truth in {share:.1f} % of cases, {drives} drives"),
    ):
        assert claim in row_of(phrase)
    assert rooms["config"]["episodes"] == 1000
    assert not any(row["collision"]["value"] for row in (vfh, *in_layer))


MOST_WORDS = 30_000
"""Words of all pages that are written by hand, as `wc -w` counts them."""


def test_all_pages_together_can_be_read():
    pages = [*PAGES, ROOT / "CONTRIBUTING.md"]
    words = {str(path.relative_to(ROOT)): len(path.read_text(encoding="utf-8").split()) for path in pages}
    assert sum(words.values()) <= MOST_WORDS, sorted(words.items(), key=lambda item: -item[1])[:10]


def test_its_film_lasts_15_seconds_and_can_be_read_on_light_and_dark_pages():
    image = pytest.importorskip("PIL.Image", reason="needs the extra [gym]")
    for name in ("docs/film.gif", "docs/film-dark.gif"):
        assert f'"{name}"' in README
        assert (ROOT / name).stat().st_size <= 2_500_000
        with image.open(ROOT / name) as film:
            assert film.width >= 800
            lengths = [film.info["duration"] for at in range(film.n_frames) if film.seek(at) is None]
        assert sum(lengths) == 15_000  # ms

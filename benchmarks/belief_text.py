"""The results page's section on training on the belief, from `belief.json`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from harness.tables import markdown
from turtlebot_gym_agents.evaluation.metrics import Interval, holm, side

TITLES = (
    "setting",
    "policy, or trained on",
    "reached an hour",
    "more than on truth",
    "more than `vfh`",
    "reached, %",
    "falsely, %",
    "lost, %",
    "contacts, %",
    "speed",
)
SHARES = "goals", "false_goals", "lost", "collision"
BELIEFS = {
    "wheels": "wheel odometry",
    "localizer": "the localizer's belief",
    "localizer, evidence": "that belief with its evidence",
}
"""What a policy was trained on instead of the true pose, in words."""
LEARNED = ("truth", *BELIEFS)
SHOWN = "truth, nothing hidden"
TEXT = """
## Training on the belief

`make bench-belief`: the same training, {steps:,} steps that begin with `vfh`, on the true pose, on wheel odometry, and on the
localizer's belief without and with its evidence (observation layout 3), {seeds} trainings each. Each training mixes three
settings: offices with the right map; `dense` with bursts of slip and a map that lacks half of the obstacles, has a quarter too
many and is off by 5 cm; and halls of 10 m by 7 m with one pillar, in which the robot does not know where it starts: turned by
180 degrees they look nearly the same. All drive on the localizer's belief, {missions} missions of {seconds:g} s in the same
rooms. Goals reached an hour are the true ones, and none come after a contact; at those reached falsely only the belief was.
"Speed" is the mean speed, as a share of the limit, in the first 20 s while the stated deviation of the position is above 0.5 m;
`vfh, turns in doubt` stands and turns then. Intervals are 95 % and contain the choice of rooms and of trainings.

"""


def section(results: Mapping[str, Any]) -> str:
    """Return the section."""
    rows = results["rows"]
    findings = [f"* {finding}" for finding in (sentence(rows), search(rows), looking(rows), chance(rows))]
    cells = []
    for row in rows:
        name = row["policy"] if row["policy"].startswith(LEARNED) else f"`{row['policy']}`"
        more = (hourly(row, other) if f"minus_{other}" in row else "" for other in ("truth", "vfh"))
        shares = (f"{100.0 * row[key]['value']:.1f}" for key in SHARES)
        speed = "" if row["speed_in_doubt"] is None else f"{row['speed_in_doubt']:.2f}"
        cells.append((row["setting"], name, shown(row["an_hour"]), *more, *shares, speed))
    return TEXT.format(**results["config"]) + "\n".join((*findings, "", markdown(TITLES, cells)))


def sentence(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return the only claim about beliefs that the differences from the truth support, by p-values adjusted by Holm."""
    tests = [row for row in rows if row["policy"] in BELIEFS]
    found: dict[int, list[str]] = {-1: [], 0: [], 1: []}
    for row, p in zip(tests, holm([row["p_truth"] for row in tests]), strict=True):
        which = side(Interval(**row["minus_truth"]["an_hour"])) if p < 0.05 else 0
        found[which].append(f"{hourly(row, 'truth')} on {BELIEFS[row['policy']]} ({row['setting']})")
    differences = "; ".join(found[1] + found[-1])
    if not found[1]:
        least, most = (choose(row["minus_truth"]["an_hour"]["value"] for row in tests) for choose in (min, max))
        beyond = max(row["minus_truth"]["an_hour"]["high"] for row in tests)
        losses = f"Significant losses: {differences}." if differences else "None is significant."
        return (
            f"**No gain shows from training on what the robot knows**: {len(tests)} differences from training on the truth are "
            f"{least:+.0f} to {most:+.0f} goals an hour, no interval reaches beyond {beyond:+.0f}. {losses}"
        )
    return (
        f"**It pays in some settings to train on what the robot knows.** Significant differences, goals an hour: {differences}."
    )


def search(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return whether a policy trained here reaches more goals than geometry on the same belief, by its whole interval."""
    learned = [row for row in rows if row["policy"] in LEARNED]
    others = [name for name in ("vfh", "planner") if f"minus_{name}" in learned[0]]
    won = [
        f"{hourly(row, other)} on {row['policy']} beside `{other}` ({row['setting']})"
        for row in learned
        for other in others
        if side(Interval(**row[f"minus_{other}"]["an_hour"])) > 0
    ]
    if won:
        return f"**Learning beats geometry on the same belief** by the whole interval, goals an hour: {'; '.join(won)}."
    names = " and ".join(f"`{name}`" for name in others)
    best = "; ".join(
        f"{max(row[f'minus_{other}']['an_hour']['value'] for row in learned):+.0f} beside `{other}`" for other in others
    )
    lost = [row for row in learned for other in others if side(Interval(**row[f"minus_{other}"]["an_hour"])) < 0]
    return (
        f"**No policy that was trained here beats geometry on the same belief**: of {len(others) * len(learned)} "
        f"differences from {names} no whole interval is above 0, and {len(lost)} are below. The best, goals an hour: {best}."
    )


def looking(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return whether a policy learned to look before it drives, and whether that would have paid."""
    cells = {row["policy"]: row for row in rows if row["setting"] == "unknown start"}
    vfh, turns, learned = (cells[name] for name in ("vfh", "vfh, turns in doubt", "localizer, evidence"))
    speeds = f"{learned['speed_in_doubt']:.2f} of the limit, `vfh` at {vfh['speed_in_doubt']:.2f}"
    return (
        f"**Driving is looking.** In doubt about the start, policies with evidence drive at {speeds}. `vfh` that "
        f"stands and turns instead reaches {turns['an_hour']['value']:.0f} goals an hour, not {vfh['an_hour']['value']:.0f}: "
        "a turn shows nothing new, and the pillar is elsewhere."
    )


def chance(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return what trainings on the truth lose if they are shown numbers that were always 0."""
    row = min((row for row in rows if row["policy"] == SHOWN), key=lambda row: row["minus_truth"]["an_hour"]["value"])
    return (
        "**What never varied in a training must not vary in the drive.** Stated deviations and NIS are 0 on the truth, NIS "
        f"also on wheels, and are hidden from these policies. Shown, they change what policies of the truth reach by up to "
        f"{hourly(row, 'truth')} goals an hour ({row['setting']}), which would look like a gain of the belief."
    )


def shown(number: Mapping[str, float], sign: str = "") -> str:
    """Return goals an hour with their interval."""
    return f"{Interval(**number):{sign}.0f}"


def hourly(row: Mapping[str, Any], other: str) -> str:
    """Return how many more goals an hour a row has than another policy."""
    return shown(row[f"minus_{other}"]["an_hour"], "+")

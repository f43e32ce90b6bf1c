"""Figures of policies in rooms."""

from panels import Panel, dots, series
from rows import read, rooms

WORLDS = ("clutter", "dense", "corridor", "office", "cellular", "crowd", "map")


def shares(rows, policies, cases, case="setting"):
    """Return panels of successes and of collisions, in per cent."""
    return [
        Panel(label, [series(rows, policy, cases, case, part, policy=policy) for policy in policies], 100.0)
        for label, part in (("goals reached (%)", "success"), ("drives that collide (%)", "collision"))
    ]


def worlds():
    """Return successes and collisions of three policies by world."""
    return dots(WORLDS, *shares(rooms(), ("vfh", "ppo-rooms", "planner+safety"), WORLDS))


def policies():
    """Return successes and collisions by policy in two worlds."""
    names = ("bearing", "vfh", "ppo-rooms", "ppo, 3 trainings", "ppo-rooms+safety", "planner+safety", "oracle")
    panels = [
        Panel(label, [series(rooms(), world, names, "policy", part, setting=world) for world in ("dense", "office")], 100.0)
        for label, part in (("goals reached (%)", "success"), ("drives that collide (%)", "collision"))
    ]
    return dots(names, *panels)


def sway():
    """Return successes and collisions on wheel odometry, by world."""
    rows = read("rooms_planner_wheel")["rows"]
    cases = list(dict.fromkeys(row["setting"] for row in rows))
    policies = ("planner", "planner+safety", "ppo-rooms", "ppo-rooms+safety")
    return dots([case.removesuffix(", noise wheel") for case in cases], *shares(rows, policies, cases))

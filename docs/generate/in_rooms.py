"""Figures of policies in rooms."""

from panels import Panel, Series, dots, series
from rows import as_robot, barn, read, rooms

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
    names = ("bearing", "gap", "dwa", "vfh", "ppo-rooms", "ppo, 3 trainings", "ppo-rooms+safety", "planner+safety", "oracle")
    panels = [
        Panel(label, [series(rooms(), world, names, "policy", part, setting=world) for world in ("dense", "office")], 100.0)
        for label, part in (("goals reached (%)", "success"), ("drives that collide (%)", "collision"))
    ]
    return dots(names, *panels)


def lidars():
    """Return successes and collisions of a policy alone and within the layer, by LiDAR."""
    rows = read("rooms_lidars")["rows"]
    cases = list(dict.fromkeys(row["setting"] for row in rows))
    names = [case.removeprefix("dense, ").replace("dense", "lds01") for case in cases]
    return dots(names, *shares(rows, ("vfh", "ppo-rooms", "ppo-rooms+safety"), cases))


def sway():
    """Return successes and collisions on wheel odometry, by world."""
    rows = read("rooms_planner_wheel")["rows"]
    cases = list(dict.fromkeys(row["setting"] for row in rows))
    policies = ("planner", "planner+safety", "ppo-rooms", "ppo-rooms+safety")
    return dots([case.removesuffix(", noise wheel") for case in cases], *shares(rows, policies, cases))


def challenge():
    """Return successes and collisions in the BARN challenge's worlds."""
    rows = barn()
    parts = (("goals reached (%)", "success"), ("drives that collide (%)", "collision"))
    panels = [Panel(label, [Series("", [row[part] for row in rows])], 100.0) for label, part in parts]
    return dots([row["name"] for row in rows], *panels)


def messages():
    """Return successes by perfect messages and by those of a robot."""
    rows = as_robot()
    return dots(
        [row["name"] for row in rows], Panel("goals reached (%)", [Series("", [row["success"] for row in rows])], 100.0)
    )

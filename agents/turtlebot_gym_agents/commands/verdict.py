"""Evaluations in words: one sentence per comparison, what decides first, and each difference by its interval."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from turtlebot_gym_agents.evaluation import metrics
from turtlebot_gym_agents.evaluation.evaluate import paired
from turtlebot_gym_agents.evaluation.metrics import Interval, side
from turtlebot_gym_agents.evaluation.result import Evaluation


def verdicts(evaluations: Mapping[str, Evaluation], *, size: int = 1) -> list[str]:
    """Return a sentence per evaluation that can be compared with an earlier one; a single one is described by itself.

    All evaluations, by label, are on the same seeds: all ``size`` settings of the first policy, then of the next. Policies are
    compared with the first one in the same setting; a single policy in its settings, with the first of them.
    """
    rows = list(evaluations.items())
    if len(rows) == 1:
        return [_alone(*rows[0])]
    base = size if len(rows) > size else 1
    return [_compared(*rows[at], *rows[at % base]) for at in range(base, len(rows))]


def _alone(name: str, evaluation: Evaluation) -> str:
    if _by_time(evaluation):
        return f"{name} reaches {_ends(metrics.mean(evaluation.episodes.reached), 2)} waypoints."
    s = evaluation.summary()
    if "goals" in s:
        return f"{name} truly reaches {_ends(s['goals'], 1, 100.0)} % of the goals, {_ends(s['goals_an_hour'], 1)} an hour."
    parts = [f"{name} reaches the goal in {_ends(s['success'], 1, 100.0)} % of the episodes"]
    if evaluation.episodes.success.any():
        parts.append(f"in {_ends(s['time_to_goal'], 2)} s")
    if "collision" in s:
        parts.append(f"and collides in {_ends(s['collision'], 1, 100.0)} %")
    return f"{', '.join(parts)}."


def _compared(name: str, evaluation: Evaluation, other_name: str, other: Evaluation) -> str:
    a, b = evaluation.episodes, other.episodes
    if _by_time(evaluation):
        more = _more(metrics.mean(a.reached - b.reached), 2, "more", "fewer")
        if more:
            return f"{name} reaches {more} waypoints than {other_name}."
        nearer = _more(metrics.mean(a.miss - b.miss), 3, "m farther from", "m nearer to")
        return f"{name} drives {nearer} the waypoints than {other_name}." if nearer else _equal(name, other_name, "waypoints")
    if a.given.max() > 1 and np.isfinite(a.clearance).all():
        more = _more(metrics.mean(a.arrivals.astype(float) - b.arrivals), 2, "more", "fewer")
        return f"{name} truly reaches {more} goals an episode than {other_name}." if more else _equal(name, other_name, "goals")
    goals = metrics.paired_share_difference(a.success, b.success)
    time = paired(evaluation, other)
    slower = _more(time, 2, "s slower", "s faster")
    reaching = _more(goals, 1, "points more", "points fewer", 100.0)
    parts = []
    if reaching:
        parts.append(f"{name} reaches {reaching} of the goals than {other_name}")
    parts += _collisions(evaluation, other) if reaching else []
    if slower and parts:
        parts.append(f"it is {slower}, a failure counted as the time limit")
    elif slower:
        parts.append(f"{name} is {slower} than {other_name}")
    elif not parts:
        parts.append(f"{name} is neither faster nor slower than {other_name} ({_ends(time, 2)} s)")
    if not reaching:
        both = bool(a.success.all() and b.success.all())
        parts.append("both reach every goal" if both else f"no difference in goals reached ({_ends(goals, 1, 100.0)} points)")
        parts += _collisions(evaluation, other)
    return f"{'; '.join(parts)}."


def _collisions(evaluation: Evaluation, other: Evaluation) -> list[str]:
    a, b = evaluation.episodes, other.episodes
    if not np.isfinite(a.clearance).all():
        return []
    if not (a.collision.any() or b.collision.any()):
        return ["neither collides"]
    difference = metrics.paired_share_difference(a.collision, b.collision)
    more = _more(difference, 1, "points more", "points less", 100.0)
    return [f"it collides {more} often" if more else f"no difference in collisions ({_ends(difference, 1, 100.0)} points)"]


def _by_time(evaluation: Evaluation) -> bool:
    return evaluation.config.get("switch") == "time"


def _equal(name: str, other: str, metric: str) -> str:
    return f"{name} and {other} do not differ in {metric}."


def _more(difference: Interval, digits: int, above: str, below: str, factor: float = 1.0) -> str:
    """Return the size and the side of a difference by its interval; empty if the interval contains 0."""
    if not side(difference):
        return ""
    low, high = sorted(abs(factor * end) for end in difference[1:])
    return f"{low:.{digits}f} to {high:.{digits}f} {above if difference.low > 0.0 else below}"


def _ends(interval: Interval, digits: int, factor: float = 1.0) -> str:
    value, low, high = (factor * number for number in interval)
    return f"{low:.{digits}f} to {high:.{digits}f}" if np.isfinite(low + high) else f"{value:.{digits}f}"

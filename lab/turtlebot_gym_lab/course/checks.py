"""Checks of each exercise: each is right, or not yet, with a hint that does not give the answer away."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from turtlebot_gym.validation import NON_NEGATIVE, Numbers
from turtlebot_gym_lab.course import recordings

Check = Callable[[Mapping[str, Any]], str]
"""A check of the names in a solution: it returns a hint, or nothing if all is right."""
EPISODES, SEED = 300, 700_000
"""Episodes of the third exercise, and the seed of the first."""
MOST_COLLISIONS = 0.02


def _close(answer: Any, expected: Any, hint: str) -> str:
    answer, expected = np.asarray(answer, np.float64), np.asarray(expected, np.float64)
    if answer.shape != expected.shape:
        return f"It must have the shape {expected.shape}, it has {answer.shape}."
    return "" if np.allclose(answer, expected, atol=1e-9) else hint


def _place(names: Mapping[str, Any]) -> str:
    answer = names["innovation"](np.array([1.0, 2.0, 0.3]), np.array([0.4, 2.5, 0.1]))
    return _close(answer, [0.6, -0.5, 0.2], "Which of the two is subtracted from the other?")


def _seam(names: Mapping[str, Any]) -> str:
    for measured, estimated, expected in ((-3.1, 3.1, 2 * math.pi - 6.2), (3.0, -3.0, 6.0 - 2 * math.pi), (0.2, 0.1, 0.1)):
        answer = names["innovation"](np.array([0.0, 0.0, measured]), np.array([0.0, 0.0, estimated]))
        if hint := _close(answer, [0.0, 0.0, expected], f"From {estimated} rad to {measured} rad the way is short."):
            return hint
    return ""


_P, _R = np.array([[0.2, 0.05, 0.0], [0.05, 0.1, 0.02], [0.0, 0.02, 0.3]]), np.diag([0.01, 0.04, 0.09])


def _weights(names: Mapping[str, Any]) -> str:
    x, z = np.array([0.0, 1.0, 0.2]), np.array([0.3, 0.8, 0.5])
    answer, _ = names["update"](x.copy(), _P.copy(), z, _R)
    expected = x + _P @ np.linalg.inv(_P + _R) @ (z - x)
    return _close(answer, expected, "How much does the estimate move towards the measurement? It depends on P and on R.")


def _shrinks(names: Mapping[str, Any]) -> str:
    _, answer = names["update"](np.zeros(3), _P.copy(), np.zeros(3), _R)
    expected = np.linalg.inv(np.linalg.inv(_P) + np.linalg.inv(_R))
    return _close(answer, expected, "After a measurement the filter knows more than before, and more than the sensor alone.")


def _crosses(names: Mapping[str, Any]) -> str:
    answer, _ = names["update"](np.array([0.0, 0.0, 3.1]), np.eye(3), np.array([0.0, 0.0, -3.0]), np.eye(3))
    return _close(answer, [0.0, 0.0, 3.1 + 0.5 * (2 * math.pi - 6.1) - 2 * math.pi], "The heading has left [-pi, pi).")


def _variances(names: Mapping[str, Any]) -> str:
    try:
        Numbers(NON_NEGATIVE, 5).check("Q", names["Q"])
    except ValueError as error:
        return str(error)
    return ""


def _honest(seed: int) -> Check:
    def check(names: Mapping[str, Any]) -> str:
        drives = [recordings.filtered(recordings.recording(at), names["Q"], seed=at) for at in range(seed, seed + 4)]
        share = float(np.mean([recordings.honesty(drive) for drive in drives])) / 3.0
        if share > 1.2:
            return f"Its squared errors are {share:.3g} times what it states: it is too sure of something."
        return "" if share > 0.85 else f"Its squared errors are {share:.3g} times what it states: it is too cautious."

    return check


def _sharp(names: Mapping[str, Any]) -> str:
    drives = [recordings.recording(50 + at) for at in range(4)]
    sizes = [recordings.size_of_errors(recordings.filtered(drive, names["Q"])) for drive in drives]
    size, sensor = float(np.mean(sizes)), math.hypot(*np.sqrt(recordings.R[:2]))
    return "" if size < 0.36 * sensor else f"{size:.3f} m, and the sensor alone has {sensor:.3f} m: what could smooth it?"


def _answers(names: Mapping[str, Any]) -> str:
    from turtlebot_gym import make_robot

    policy = names["Mine"](robot=make_robot("burger"), dt=0.1)
    if hasattr(policy, "reset"):
        policy.reset(np.ones(2, np.bool_))
    actions = np.asarray(policy(np.zeros((2, 50), np.float32)), np.float64)
    right = actions.shape == (2, 2) and np.isfinite(actions).all()
    return "" if right else f"For 2 observations it returned {actions.tolist()}."


def _beats(names: Mapping[str, Any]) -> str:
    from turtlebot_gym_agents.evaluation.metrics import paired_share_difference

    mine, vfh = _driven(names)
    gain, low, high = (100.0 * end for end in paired_share_difference(mine.success, vfh.success))
    if low > 0.0:
        return ""
    difference = f"{gain:+.1f} points of the goals ({low:.1f} to {high:.1f})"
    return f"{difference}: the difference could be chance." if gain > 0.0 else f"{difference}: where does it lose time?"


def _careful(names: Mapping[str, Any]) -> str:
    mine, _ = _driven(names)
    share = float(mine.collision.mean())
    return "" if share <= MOST_COLLISIONS else f"It collides in {100 * share:.1f} % of the episodes."


_kept: dict[int, Any] = {}


def _driven(names: Mapping[str, Any]) -> Any:
    """Return the episodes of the solution and those of VFH+, on the same seeds; driven once."""
    from turtlebot_gym import make_robot
    from turtlebot_gym_agents.evaluation.evaluate import evaluate

    if id(names) not in _kept:
        robot = make_robot("burger")
        setting = {"env": "turtlebot_gym/TurtleBotRooms-v0", "world": "office", "episodes": EPISODES, "seed": SEED}
        policies = (names["Mine"](robot=robot, dt=0.1), "vfh")
        _kept[id(names)] = [evaluate(policy, **setting).episodes for policy in policies]
    return _kept[id(names)]


GOES, STANDS = (0.1, 0.5), (0.0, 0.0)


def _sent(guard: Any, *steps: tuple[Any, ...]) -> list[tuple[float, float]]:
    return [(float(v), float(omega)) for v, omega in (guard.step(*step) for step in steps)]


def _obeys(names: Mapping[str, Any]) -> str:
    sent = _sent(names["Guard"](), (0.0, GOES, 0.0, False), (0.3, GOES, 0.0, False), (0.35, (-0.1, 0.0), 0.33, False))
    return "" if sent == [GOES, GOES, (-0.1, 0.0)] else "A fresh command is passed on as it is."


def _before(names: Mapping[str, Any]) -> str:
    return "" if _sent(names["Guard"](), (0.0, None, 0.0, False)) == [STANDS] else "There is no command yet."


def _stale(names: Mapping[str, Any]) -> str:
    sent = _sent(names["Guard"](), (0.0, GOES, 0.0, False), (0.5, GOES, 0.0, False), (9.0, GOES, 0.0, False))
    if sent[1:] != [STANDS, STANDS]:
        return "The program has died, and its last command remains."
    late = _sent(names["Guard"](), (5.0, GOES, 3.0, False))
    return "" if late == [STANDS] else "The command has only just come, but when was it sent?"


def _nonsense(names: Mapping[str, Any]) -> str:
    for command in ((math.nan, 0.0), (0.1, math.inf), (0.0, -math.inf)):
        if _sent(names["Guard"](), (0.0, command, 0.0, False)) != [STANDS]:
            return f"Its command was {command}."
    if _sent(names["Guard"](), (1.0, GOES, 61.0, False)) != [STANDS]:
        return "Its command was sent in the future."
    fast = _sent(names["Guard"](), (0.0, (5.0, -50.0), 0.0, False))[0]
    limits = names.get("MOST_LINEAR", 0.2), names.get("MOST_ANGULAR", 2.0)
    return "" if abs(fast[0]) <= limits[0] and abs(fast[1]) <= limits[1] else "Its command was faster than the robot can drive."


def _pressed(names: Mapping[str, Any]) -> str:
    times = (0.0, 0.05, 0.1, 0.3, 0.5)
    sent = _sent(names["Guard"](), *((now, GOES, now, now == 0.05) for now in times))
    if sent[1] != STANDS:
        return "The button was pressed."
    if sent[2:4] != [STANDS, STANDS]:
        return "The button was pressed once, briefly. How long does that count?"
    return "" if sent[4] == STANDS else "Half a second has not passed since the press."


def _released(names: Mapping[str, Any]) -> str:
    times = (0.0, 0.05, 0.4, 0.5, 0.8, 1.05)
    sent = _sent(names["Guard"](), *((now, GOES, now, now in (0.05, 0.4)) for now in times))
    if sent[4] != STANDS:
        return "It was pressed twice: which press counts?"
    return "" if sent[5] == GOES else "Half a second without a press has passed: the robot may drive again."


CHECKS: dict[int, tuple[tuple[str, Check], ...]] = {
    1: (
        ("The innovation of x and y is right.", _place),
        ("The innovation of the heading goes the short way round.", _seam),
        ("The estimate moves by the right weights.", _weights),
        ("The covariance becomes smaller by what was learned.", _shrinks),
        ("The heading stays in [-pi, pi) when it crosses the seam.", _crosses),
    ),
    2: (
        ("Q holds five variances.", _variances),
        ("On recordings like the one you have, the filter's errors are as large as it states.", _honest(0)),
        ("On drives that you have not seen, too.", _honest(20)),
        ("Its position is far better than the sensor's.", _sharp),
    ),
    3: (
        ("It answers observations with actions.", _answers),
        (f"On {EPISODES} episodes it reaches more goals than VFH+, beyond chance.", _beats),
        (f"It collides in at most {100 * MOST_COLLISIONS:g} %.", _careful),
    ),
    4: (
        ("Fresh commands are obeyed.", _obeys),
        ("Before the first command the robot stands.", _before),
        ("Commands that are too old are not obeyed.", _stale),
        ("Nonsense does not reach the wheels.", _nonsense),
        ("A press stops the robot, however brief.", _pressed),
        ("After half a second without a press it may drive again.", _released),
    ),
}
"""The checks of each exercise, in order."""

"""The sentences that end an evaluation: what decides first, with the right side and interval."""

from dataclasses import replace

import numpy as np
import pytest

from turtlebot_gym_agents.commands.verdict import verdicts
from turtlebot_gym_agents.evaluation.evaluate import evaluate

N = 400


@pytest.fixture(scope="module")
def driven():
    """An evaluation whose numbers the tests replace: every goal is reached in 10 s."""
    made = evaluate("bearing", episodes=N, noise="clean")
    changed = made.episodes._replace(time=np.full(N, 10.0), success=np.ones(N, np.bool_))
    return replace(made, episodes=changed)


def with_(evaluation, **changes):
    return replace(evaluation, episodes=evaluation.episodes._replace(**changes))


def in_room(evaluation, collisions):
    return with_(evaluation, clearance=np.ones(N), collision=np.arange(N) < collisions)


def test_the_slower_one_is_called_slower_by_its_interval(driven):
    spread = np.tile([-0.1, 0.1], N // 2)  # the standard error of the mean is 0.1 / sqrt(N - 1)
    slow = with_(driven, time=10.5 + spread)
    margin = 1.966 * 0.1 / np.sqrt(N - 1)
    ends = f"{0.5 - margin:.2f} to {0.5 + margin:.2f} s"
    assert verdicts({"a": driven, "b": slow}) == [f"b is {ends} slower than a; both reach every goal."]
    assert verdicts({"b": slow, "a": driven}) == [f"a is {ends} faster than b; both reach every goal."]


def test_goals_decide_before_time(driven):
    few = with_(driven, success=np.arange(N) >= N // 10)
    (said,) = verdicts({"a": driven, "b": few})
    assert said.startswith("b reaches ")
    assert " points fewer of the goals than a; it is " in said
    assert "s slower, a failure counted as the time limit." in said
    low, high = (float(word) for word in said.split()[2:5:2])
    assert low < 10.0 < high  # percent


def test_what_does_not_differ_is_said_with_its_interval(driven):
    spread = np.tile([-1.0, 1.0], N // 2)
    (said,) = verdicts({"a": driven, "b": with_(driven, time=10.0 + spread)})
    assert said.startswith("b is neither faster nor slower than a (-0.1")


def test_collisions_are_said_in_rooms(driven):
    (said,) = verdicts({"a": in_room(driven, 0), "b": in_room(driven, 40)})
    assert "; it collides " in said
    assert said.endswith(" points more often.")
    assert verdicts({"a": in_room(driven, 0), "b": in_room(driven, 0)})[0].endswith("; neither collides.")


def test_policies_are_compared_in_the_same_setting_and_a_single_one_with_its_first(driven):
    names = ("a, clean", "a, rough", "b, clean", "b, rough")
    said = verdicts(dict.fromkeys(names, driven), size=2)
    assert [sentence.partition(" (")[0] for sentence in said] == [
        f"b, {noise} is neither faster nor slower than a, {noise}" for noise in ("clean", "rough")
    ]
    (said,) = verdicts(dict.fromkeys(names[:2], driven), size=2)
    assert said.startswith("a, rough is neither faster nor slower than a, clean")


def test_a_single_one_is_described(driven):
    assert verdicts({"a": driven}) == ["a reaches the goal in 99.0 to 100.0 % of the episodes, in 10.00 to 10.00 s."]
    (said,) = verdicts({"a": in_room(driven, 40)})
    assert said.endswith(", and collides in 7.4 to 13.3 %.")
    none = with_(driven, success=np.zeros(N, np.bool_))
    assert verdicts({"a": none}) == ["a reaches the goal in 0.0 to 1.0 % of the episodes."]

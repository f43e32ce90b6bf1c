"""What happened in a drive: each event in its row, once, and the score that they add up to."""

from dataclasses import replace

import numpy as np
import pytest

from turtlebot_gym.drive import Drive
from turtlebot_gym_agents.evaluation.evaluate import evaluate
from turtlebot_gym_view import record_episode
from turtlebot_gym_view.events import all_events_of, events_of, told_outcome

MISSIONS = "turtlebot_gym/TurtleBotMissions-v0"
EXPECTED = [(20, "arrival"), (30, "fix"), (50, "contact"), (60, "guard"), (70, "lost")]


def eventful():
    """Return a drive in which one thing happens after the other."""
    rows = np.arange(100)
    true_state, estimate = np.zeros((100, 5)), np.zeros((100, 5))
    true_state[:, 0] = estimate[:, 0] = 0.1 * rows
    estimate[70:75, 1] = 0.6
    reference = np.tile([2.0, 0.0, 0.0], (100, 1))
    reference[20:, 0] = 9.0
    clearance, level, fix = np.ones(100), np.zeros(100), np.zeros(100)
    clearance[50:52], level[60:], fix[30] = -0.01, 2.0, 1.0
    return Drive(
        time=0.1 * rows,
        true_state=true_state,
        estimate=estimate,
        odometry=true_state[:, :3],
        reference=reference,
        command=np.zeros((100, 2)),
        clearance=clearance,
        level=level,
        fix=fix,
        outcome="success after 9.9 s",
    )


def test_each_event_stands_in_its_row():
    assert events_of(eventful()) == EXPECTED
    assert all_events_of(eventful()) == [*EXPECTED, (99, "arrival")]
    ended = replace(eventful(), outcome="collision after 9.9 s", clearance=np.where(np.arange(100) == 99, -0.1, 1.0))
    assert [event for event in all_events_of(ended) if event[1] == "contact"] == [(99, "contact")]  # once


def test_a_goal_that_is_given_up_is_not_reached():
    drive = eventful()
    far = replace(drive, true_state=np.add(drive.true_state, [0.0, 5.0, 0.0, 0.0, 0.0]), outcome="")
    assert "arrival" not in [kind for _, kind in all_events_of(far)]


def test_nothing_is_known_of_an_empty_recording():
    assert events_of(Drive(time=0.1 * np.arange(5))) == []
    assert told_outcome(Drive(time=0.1 * np.arange(5))) == ""


def test_an_outcome_after_several_goals_has_their_number():
    drive = eventful()
    for outcome in ("time is up after 9.9 s", "success after 9.9 s", ""):
        assert told_outcome(replace(drive, outcome=outcome)) == outcome  # one goal, or all of them
    twice = replace(drive, reference=np.where(np.arange(100)[:, None] < 88, drive.reference, [[20.0, 0.0, 0.0]]))
    assert told_outcome(replace(twice, outcome="time is up after 9.9 s")) == "2 goals in 9.9 s"
    assert told_outcome(replace(twice, outcome="collision after 9.9 s")) == "2 goals in 9.9 s, then collision"


@pytest.mark.slow
def test_a_mission_ends_with_its_number_of_goals():
    drive = record_episode("vfh", env=MISSIONS, seed=3)
    goals = [kind for _, kind in all_events_of(drive)].count("arrival")
    measured = evaluate("vfh", env=MISSIONS, seed=3, episodes=1).episodes
    assert goals == measured.arrivals[0] > 10
    assert told_outcome(drive) == f"{goals} goals in 600.0 s"
    assert told_outcome(replace(drive, outcome="collision after 600.0 s")) == f"{goals} goals in 600.0 s, then collision"
    one = record_episode("bearing", seed=5)
    assert told_outcome(one) == one.outcome

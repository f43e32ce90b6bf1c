"""The guard of the benchmark is in force: without it, a robot that is driven ahead blindly touches something."""

import pytest

from turtlebot_gym.values import Command

pytest.importorskip("rclpy", reason="needs the extra [ros]")
as_robot = pytest.importorskip("as_robot")


def least_clearance(make, speaks_as):
    """Return the least clearance of a robot that is driven ahead for 8 s, m."""
    robot = make(make.Params(world="dense", seed=1, speaks_as=speaks_as, own_clock=False))
    period = robot.trigger.period
    sent = [robot.step(period, Command(0.2, 0.0)) for _ in range(round(8.0 / period))]
    return min(answer["clearance"].distance for answer in sent)


@pytest.mark.parametrize("speaks_as", ["none", "turtlebot3"])
def test_a_robot_behind_the_guard_touches_nothing(speaks_as):
    assert least_clearance(as_robot.TurtlebotSimulator, speaks_as) < 0.0 < least_clearance(as_robot.Guarded, speaks_as)


def test_differences_are_those_of_the_same_rooms():
    ends = ((1.0, 1.0, 0.0), (1.0, 0.0, 0.0), (1.0, 1.0, 1.0), (1.0, 1.0, 1.0))
    rows = [
        {
            "speaks": speaks, "guarded": guarded, "live": False, "seed": seed, "goal reached": goal, "collision": 1.0 - goal,
            "end of the episode": 9.0, "least clearance": goal - 0.5, "verdicts": {},
        }
        for (speaks, guarded), goals in zip(as_robot.ARMS, ends, strict=True)
        for seed, goal in reversed(list(enumerate(goals)))
    ]  # fmt: skip
    live = [{**row, "live": True} for row in rows[:3]]
    live[1] = {**live[1], "end of the episode": 9.1}
    summary = as_robot.summary(rows + live)
    assert summary["live"] == {"drives": 3, "same end": 2}
    assert summary["difference, bare"]["value"] == pytest.approx(-1.0 / 3.0)
    assert summary["difference, monitor"]["value"] == 0.0
    assert (summary["robot, bare"]["contacts"], summary["robot, monitor"]["contacts"]) == (2, 0)
    assert [row["seed"] for row in summary["robot, bare"]["lost"]] == [1, 2]
    assert "plain, monitor" not in as_robot.summary([row for row in rows if not row["guarded"]])

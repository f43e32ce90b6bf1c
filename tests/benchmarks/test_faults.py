"""The judge of the injected faults, on what it has heard of a guard that was suspended while it wrote a motion."""

import math

import pytest

pytest.importorskip("rclpy", reason="needs the extra [ros]")

from faults import AGE, REVIVED
from faults_robot import Robot

SUSPENDED, CONTINUED = 10.0, 12.0


def judge(*heard: tuple[float, float, float]) -> Robot:
    """Return a judge that has heard commands, each with its source time, its arrival, and v."""
    robot = Robot.__new__(Robot)
    robot.measured = [(SUSPENDED, SUSPENDED)]
    robot.heard = [(sent, v, 0.0) for sent, _, v in heard]
    robot.arrived = [(arrived, v != 0.0) for _, arrived, v in heard]
    return robot


STANDBY = (SUSPENDED + 0.2, SUSPENDED + 0.2, 0.0)
BEGUN = (SUSPENDED + 0.01, CONTINUED, 0.1)


@pytest.mark.parametrize(("pause", "lasts"), [(0.001, 0.001), (0.3, 0.3), (None, math.inf)])
def test_a_motion_that_comes_out_after_a_suspension_lasts_until_the_next_zero(pause, lasts):
    after = [] if pause is None else [(CONTINUED + pause, CONTINUED + pause, 0.0)]
    robot = judge(STANDBY, BEGUN, *after)
    assert robot.lag(0.0) == pytest.approx(0.01)  # by its source time it is early, and looks safe
    assert robot.revived(0.0, AGE) == pytest.approx(lasts)
    assert (robot.revived(0.0, AGE) > REVIVED) == (lasts > REVIVED)


def test_the_standby_ends_the_motion_that_a_suspended_guard_had_sent_before():
    moved = (SUSPENDED, SUSPENDED, 0.1)
    assert judge(moved, STANDBY, BEGUN, (CONTINUED, CONTINUED, 0.0)).hold(0.0) == pytest.approx(0.2)

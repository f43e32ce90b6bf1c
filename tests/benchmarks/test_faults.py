"""The judge of the injected faults: of a guard that was suspended while it wrote a motion, and of the time until a stop."""

import math

import pytest

pytest.importorskip("rclpy", reason="needs the extra [ros]")

from faults import AGE, REVIVED
from faults_record import Record

SUSPENDED, CONTINUED = 10.0, 12.0


def judge(*heard: tuple[float, float, float]) -> Record:
    """Return a judge that has heard commands, each with its source time, its arrival, and v."""
    record = Record()
    record.measured = [(SUSPENDED, SUSPENDED)]
    record.heard = [(sent, v, 0.0) for sent, _, v in heard]
    record.arrived = [(arrived, v != 0.0) for _, arrived, v in heard]
    return record


STANDBY = (SUSPENDED + 0.2, SUSPENDED + 0.2, 0.0)
BEGUN = (SUSPENDED + 0.01, CONTINUED, 0.1)


@pytest.mark.parametrize(("pause", "lasts"), [(0.001, 0.001), (0.3, 0.3), (None, math.inf)])
def test_a_motion_that_comes_out_after_a_suspension_lasts_until_the_next_zero(pause, lasts):
    after = [] if pause is None else [(CONTINUED + pause, CONTINUED + pause, 0.0)]
    record = judge(STANDBY, BEGUN, *after)
    assert record.lag(0.0) == pytest.approx(0.01)  # by its source time it is early, and looks safe
    assert record.revived(0.0, AGE) == pytest.approx(lasts)
    assert (record.revived(0.0, AGE) > REVIVED) == (lasts > REVIVED)


def test_the_standby_ends_the_motion_that_a_suspended_guard_had_sent_before():
    moved = (SUSPENDED, SUSPENDED, 0.1)
    assert judge(moved, STANDBY, BEGUN, (CONTINUED, CONTINUED, 0.0)).hold(0.0) == pytest.approx(0.2)


@pytest.mark.parametrize(
    ("heard", "moves", "stop"), [((), True, math.inf), ((STANDBY,), False, 0.2), ((BEGUN, STANDBY), False, 0.2)]
)
def test_a_robot_moves_until_the_next_zero_and_one_that_stood_did_not(heard, moves, stop):
    moved = (SUSPENDED - 0.1, SUSPENDED - 0.1, 0.1)
    record, stood = judge(moved, *heard), judge((*moved[:2], 0.0), *heard)
    record.began = stood.began = SUSPENDED
    assert record.moves(SUSPENDED + 0.3) is moves
    assert record.stop() == pytest.approx(stop)
    assert (stood.moves(SUSPENDED + 0.3), stood.stop()) == (False, 0.0)

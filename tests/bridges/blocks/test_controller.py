"""The controller: the environment's observation, the policy's action, a command within the robot's limits."""

from dataclasses import replace

import numpy as np
import own_parts
import pytest
from std_msgs.msg import Bool

from turtlebot_gym.estimation.ekf import Estimate
from turtlebot_gym.robots import ROBOTS
from turtlebot_gym.values import Belief, Covariance, Pose, State
from turtlebot_gym_agents.policies.bundle import term_on
from turtlebot_gym_ros.blocks import VelocityController
from turtlebot_gym_ros.blocks.controller import _input_of

REFERENCE = Pose(2.0, 0.0, 0.0)
VARIANCES = dict.fromkeys(Covariance._fields, 0.0) | {"xx": 0.03, "yy": 0.01, "tt": 0.04}


def at(x, y, theta=0.0, **variances):
    covariance = Covariance(**{**VARIANCES, **variances})
    return Estimate(Belief(State(x, y, theta, 0.1, -0.2), covariance), 1.5, 0.0)


def controller(drive=None, **parameters):
    node = VelocityController(VelocityController.Params(**parameters))
    if drive is not None:
        node.driver._policy = drive
    return node


def ahead(observation):
    return np.array([1.0, 0.0], np.float32)


def test_a_policy_is_given_the_environments_observation():
    given = []
    node = controller(lambda observation: given.append(observation) or np.zeros(2))
    node.step(0.1, at(0.0, 0.0), REFERENCE, Pose(0.0, 2.0, 0.0))
    (observation,) = given
    robot = ROBOTS["burger"]
    assert observation.dtype == np.float32
    expected = [2.0, 1.0, 0.0, 1.0, 0.0, 0.1 / robot.max_linear, -0.2 / robot.max_angular, 0.2, 0.2, 1.5, 2.0, 0.0, 1.0]
    assert observation == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("answer", [[np.nan, 0.0], [0.0, np.inf], [0.0], [[0.0, 0.0]], "stop", None])
def test_an_answer_that_is_no_action_is_an_error(answer):
    with pytest.raises((ValueError, TypeError)):
        controller(lambda observation: answer).step(0.1, at(0.0, 0.0), REFERENCE, None)


def test_at_the_last_waypoint_it_is_done_until_there_is_another():
    node = controller(ahead)
    assert node.step(0.1, at(1.89, 0.0), REFERENCE, REFERENCE)  # within 0.15 m, but not by the margin
    assert node.step(0.1, at(1.91, 0.0), REFERENCE, REFERENCE) == {}
    assert node.step(0.1, at(1.7, 0.0), REFERENCE, REFERENCE) == {}  # noise does not wake it
    assert node.step(0.1, at(1.91, 0.0), REFERENCE, Pose(0.0, 0.0, 0.0))  # not the last one
    assert node.step(0.1, at(1.91, 0.0), REFERENCE, None) == {}
    assert node.step(0.1, at(1.91, 0.0), Pose(0.0, 0.0, 0.0), None)


def test_a_variance_of_zero_is_given_a_floor_and_a_warning_once(caplog):
    node = controller(ahead)
    for _ in range(2):
        node.step(0.1, at(0.0, 0.0, xx=0.0, yy=0.0, tt=0.0), REFERENCE, None)
    assert node.driver.observation[7:9] == pytest.approx([np.sqrt(2e-6), 1e-3])
    assert len(caplog.records) == 1
    node = controller(ahead)
    node.step(0.1, at(0.0, 0.0), REFERENCE, None)
    assert len(caplog.records) == 1


def test_who_sees_needs_a_scan_of_the_last_half_second_and_nobody_else_hears_one():
    scan = controller(policy="vfh").inputs["scan"]
    assert (scan.topic, scan.required, scan.max_age) == ("scan", True, 0.5)
    assert "scan" not in controller().inputs


def bundle_term(name, low, high, source=""):
    """Return a term as a bundle's card has it."""
    return term_on({"name": name, "low": low, "high": high, "source": source})


NAMED = {term.name: replace(term, source=f"own_parts:{term.name.upper()}") for term in (own_parts.BUMPER, own_parts.GAPS)}


def test_a_bundles_term_is_brought_by_the_topic_that_a_person_names():
    source = _input_of(bundle_term("bumper", [0.0], [1.0]), NAMED)
    assert (source.topic, source.message, source.max_age, source.lasts) == ("bumper", "std_msgs/msg/Bool", 0.5, 0.0)
    assert source.read(Bool(data=True)) == (1.0,)
    slow = _input_of(replace(own_parts.BUMPER, lasts=3.0), {})
    assert (slow.max_age, slow.lasts) == (0.5, 2.5)

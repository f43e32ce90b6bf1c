"""Parameters of all nodes: what they are by default, their rules, and what is refused."""

import re
from dataclasses import fields

import pytest

from cmd_vel_guard import parameters
from turtlebot_gym.config import rules
from turtlebot_gym.docstrings import texts_of
from turtlebot_gym_ros.__main__ import main
from turtlebot_gym_ros.nodes import BLOCKS, load
from turtlebot_gym_ros.recording.logger import Parameters as LoggerParameters

BLOCK = {name: load(name) for name in BLOCKS}
OTHERS = {"data_logger": LoggerParameters, "cmd_vel_guard": parameters.Parameters}
CLASSES = {name: block.Params for name, block in BLOCK.items()} | OTHERS
RULES = {name: rules(kind) for name, kind in CLASSES.items()}


@pytest.mark.parametrize("node", CLASSES)
def test_every_float_has_a_rule_and_every_parameter_a_description(node):
    """How they become ROS parameters, the guard's tests show."""
    assert texts_of(CLASSES[node]).keys() == {item.name for item in fields(CLASSES[node])}
    assert {item.name for item in fields(CLASSES[node]) if isinstance(item.default, float)} <= RULES[node].keys()


REFUSED = [
    ("velocity_controller", {"policy": "clever"}, "clever"),
    ("velocity_controller", {"goal_tolerance": 0.005}, "goal_tolerance must be 0, or at least 0.01 m"),
    ("kalman_filter", {"filter": "gyro"}, "filter 'gyro' reads the sensor 'imu'"),
    ("kalman_filter", {"max_gap": 0.05}, "period must be at most max_gap, 0.05 s, got 0.1"),
    ("turtlebot_simulator", {"goals": 2}, "goals must be 0 without a world"),
    ("turtlebot_simulator", {"world": "dense", "lidar": "ideal", "period": 0.2}, "at most one scan in a control interval"),
    ("waypoint_generator", {"waypoints": "/nowhere.yaml"}, "got '/nowhere.yaml'"),
]


@pytest.mark.parametrize(("node", "given", "said"), REFUSED)
def test_what_a_block_cannot_do_is_refused(node, given, said):
    with pytest.raises(ValueError, match=re.escape(said)):
        BLOCK[node](CLASSES[node](**given))


@pytest.mark.parametrize(
    ("argv", "said"),
    [
        (["flight_controller"], "there is no node 'flight_controller'"),
        (["velocity_controller", "--ros-args", "-p", "polcy:=bearing"], "Did you mean 'policy'?"),
        (["kalman_filter", "--ros-args", "-p", "lock_step:=true", "-p", "twist:=commanded"], "lock_step must be false"),
        (["kalman_filter", "filter:=matched"], "unknown argument 'filter:=matched'"),
        (["bringup", "--policy", "nope.onnx"], "No such file or directory: 'nope.onnx'"),
    ],
)
def test_what_is_wrong_is_one_clear_line_and_exit_code_2(capsys, argv, said):
    assert main(argv) == 2
    captured = capsys.readouterr()
    (line,) = captured.err.splitlines()
    assert line.startswith("error: ")
    assert said in line
    assert not captured.out

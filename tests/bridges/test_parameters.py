"""Parameters of all nodes: what they are by default, what is refused with which words, and what ROS shows of them."""

import re
from dataclasses import fields

import pytest
from rclpy.node import Node
from rclpy.parameter import Parameter

from cmd_vel_guard.declare import declare
from turtlebot_gym.config import rules
from turtlebot_gym_ros.__main__ import main
from turtlebot_gym_ros.base.frames import Common
from turtlebot_gym_ros.nodes import BLOCKS, load
from turtlebot_gym_ros.recording.logger import Parameters as LoggerParameters

BLOCK = {name: load(name) for name in BLOCKS}
CLASSES = {name: block.Params for name, block in BLOCK.items()} | {"data_logger": LoggerParameters}
RULES = {name: rules(kind) for name, kind in CLASSES.items()}


@pytest.mark.parametrize("node", CLASSES)
def test_every_float_has_a_rule(node):
    assert {item.name for item in fields(CLASSES[node]) if isinstance(item.default, float)} <= RULES[node].keys()


REFUSED = [
    ("velocity_controller", {"policy": "clever"}, "clever"),
    ("velocity_controller", {"policy": "no_such_module:drive"}, "no_such_module"),
    ("velocity_controller", {"goal_tolerance": 0.005}, "goal_tolerance must be 0, or at least 0.01 m"),
    ("kalman_filter", {"filter": "kalman"}, "filter must be one of"),
    ("kalman_filter", {"filter": "gyro"}, "filter 'gyro' reads the sensor 'imu'"),
    ("kalman_filter", {"twist": "guessed"}, "twist must be one of"),
    ("kalman_filter", {"max_gap": 0.05}, "period must be at most max_gap, 0.05 s, got 0.1"),
    ("turtlebot_simulator", {"goals": 2}, "goals must be 0 without a world"),
    ("turtlebot_simulator", {"world": "jungle"}, "world must be one of"),
    ("turtlebot_simulator", {"world": "dense", "random_start": True}, "random_start must be false"),
    ("turtlebot_simulator", {"world": "dense", "lidar": "ideal", "period": 0.2}, "at most one scan in a control interval"),
    ("waypoint_generator", {"switch": "never"}, "switch must be one of"),
    ("waypoint_generator", {"waypoints": "/nowhere.yaml"}, "got '/nowhere.yaml'"),
]


@pytest.mark.parametrize(("node", "given", "said"), REFUSED)
def test_what_a_block_cannot_do_is_refused(node, given, said):
    with pytest.raises(ValueError, match=re.escape(said)):
        BLOCK[node](CLASSES[node](**given))


# As parameters of a ROS node.


@pytest.fixture
def node_with(runner):
    nodes = []

    def make(**given):
        node = Node(
            "node",
            context=runner.context,
            parameter_overrides=[Parameter(name, value=value) for name, value in given.items()],
            automatically_declare_parameters_from_overrides=True,
        )
        nodes.append(node)
        return node

    yield make
    for node in nodes:
        node.destroy_node()


@pytest.mark.parametrize("name", CLASSES)
def test_every_parameter_is_described_with_its_rule_and_read_only(node_with, name):
    classes = (Common, CLASSES[name]) if name in BLOCK else (CLASSES[name],)
    node = node_with()
    assert declare(node, *classes)[-1] == CLASSES[name]()
    for item in (item for declaration in classes for item in fields(declaration)):
        described = node.describe_parameter(item.name)
        assert len(described.description) > 15, item.name
        assert "\n" not in described.description
        assert described.read_only
        rule = RULES[name].get(item.name)
        assert described.additional_constraints == ("" if rule is None else str(rule))


@pytest.mark.parametrize(
    ("argv", "said"),
    [
        (["flight_controller"], "there is no node 'flight_controller'"),
        (["velocity_controller", "--ros-args", "-p", "polcy:=bearing"], "Did you mean 'policy'?"),
        (["turtlebot_simulator", "--ros-args", "-p", "speed:=0"], "speed must be 1"),
        (["simulated_teleop", "--ros-args", "-p", "lock_step:=true"], "lock_step must be false"),
        (["kalman_filter", "--ros-args", "-p", "lock_step:=true", "-p", "twist:=commanded"], "lock_step must be false"),
        (["kalman_filter", "filter:=matched"], "unknown argument 'filter:=matched'"),
        (["bringup", "--policy", "nope.onnx"], "No such file or directory: 'nope.onnx'"),
        (["bringup", "--seed", "-1"], "--seed must be a whole number from 0 to"),
        (["bringup", "--figure", "drive.jpg"], "drive.jpg: its name must end with .png or .pdf or .svg"),
    ],
)
def test_what_is_wrong_is_one_clear_line_and_exit_code_2(capsys, argv, said):
    assert main(argv) == 2
    captured = capsys.readouterr()
    (line,) = captured.err.splitlines()
    assert line.startswith("error: ")
    assert said in line
    assert not captured.out

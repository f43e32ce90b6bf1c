"""Parameters of all nodes: what they are by default, what is refused with which words, and what ROS shows of them."""

import re
from dataclasses import dataclass, fields

import pytest
from rclpy.node import Node
from rclpy.parameter import Parameter

from cmd_vel_guard.declare import declare
from turtlebot_gym.config import rules
from turtlebot_gym_ros.base.frames import Common
from turtlebot_gym_ros.nodes import BLOCKS, load
from turtlebot_gym_ros.recording.logger import Parameters as LoggerParameters

BLOCK = {name: load(name) for name in BLOCKS}
CLASSES = {name: block.Params for name, block in BLOCK.items()} | {
    "data_logger": LoggerParameters,
}
RULES = {name: rules(kind) for name, kind in CLASSES.items()}


@pytest.mark.parametrize("node", CLASSES)
def test_every_float_has_a_rule(node):
    assert {item.name for item in fields(CLASSES[node]) if isinstance(item.default, float)} <= RULES[node].keys()


REFUSED = [
    ("velocity_controller", {"policy": "clever"}, "clever"),
    ("velocity_controller", {"policy": "no_such_module:drive"}, "no_such_module"),
    ("velocity_controller", {"goal_tolerance": 0.005}, "goal_tolerance must be 0, or at least 0.01 m"),
    ("velocity_controller", {"robot": "turtle"}, "robot must be one of"),
    ("kalman_filter", {"filter": "kalman"}, "filter must be one of"),
    ("kalman_filter", {"filter": "gyro"}, "filter 'gyro' reads the sensor 'imu'"),
    ("kalman_filter", {"twist": "guessed"}, "twist must be one of"),
    ("kalman_filter", {"noise": "none"}, "noise must be one of"),
    ("kalman_filter", {"robot": "turtle"}, "robot must be one of"),
    ("kalman_filter", {"max_gap": 0.05}, "period must be at most max_gap, 0.05 s, got 0.1"),
    ("turtlebot_simulator", {"robot": "turtle"}, "robot must be one of"),
    ("turtlebot_simulator", {"noise": "none"}, "noise must be one of"),
    ("turtlebot_simulator", {"integrator": "rk4"}, "integrator must be one of"),
    ("turtlebot_simulator", {"goals": 2}, "goals must be 0 without a world"),
    ("turtlebot_simulator", {"world": "jungle"}, "world must be one of"),
    ("turtlebot_simulator", {"world": "no_such.world"}, "no_such.world"),
    ("turtlebot_simulator", {"world": "dense", "lidar": "sonar"}, "lidar must be one of"),
    ("turtlebot_simulator", {"world": "dense", "random_start": True}, "random_start must be false"),
    (
        "turtlebot_simulator",
        {"world": "dense", "lidar": "ideal", "period": 0.2},
        "at most one scan in a control interval",
    ),
    ("waypoint_generator", {"switch": "never"}, "switch must be one of"),
    ("waypoint_generator", {"waypoints": "/nowhere.yaml"}, "cannot read '/nowhere.yaml'"),
]


@pytest.mark.parametrize(("node", "given", "said"), REFUSED)
def test_what_a_block_cannot_do_is_refused(node, given, said):
    with pytest.raises(ValueError, match=re.escape(said)):
        BLOCK[node](CLASSES[node](**given))


# As parameters of a ROS node.


@dataclass(frozen=True, kw_only=True)
class Params:
    """Parameters of a test."""

    gain: float = 1.5
    steps: int = 3
    name: str = "square"
    start_enabled: bool = True

    def __post_init__(self):
        if not self.gain > 0.0:
            raise ValueError(f"gain must be positive, got {self.gain!r}.")


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


def test_defaults_are_declared_and_those_of_the_later_class_count(node_with):
    node = node_with()
    common, params = declare(node, Common, Params)
    assert params == Params()
    assert common == Common(start_enabled=True)
    assert node.get_parameter("gain").value == 1.5
    assert node.get_parameter("frame").value == "odom"


def test_given_values_are_taken_and_an_integer_will_do_for_a_float(node_with):
    given = {"use_sim_time": True, "qos_overrides./odom.subscription.depth": 1}  # parameters of ROS itself are left to it
    node = node_with(gain=2, steps=7, name="a.csv", start_enabled=False, **given)
    common, params = declare(node, Common, Params)
    assert params == Params(gain=2.0, steps=7, name="a.csv", start_enabled=False)
    assert isinstance(params.gain, float)
    assert isinstance(node.get_parameter("gain").value, float)
    assert node.get_parameter("use_sim_time").value
    assert not common.start_enabled


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"gian": 2.0}, "node has no parameter 'gian': did you mean gain"),
        ({"frequency_of_everything": 2.0}, "there are body_frame, enable_stamped_cmd_vel, frame, frame_prefix, gain"),
        ({"gain": "high"}, "gain must be of type float, got 'high'"),
        ({"gain": True}, "gain must be of type float, got True"),
        ({"steps": 2.5}, "steps must be of type int, got 2.5"),
        ({"start_enabled": 1}, "start_enabled must be of type bool, got 1"),
        ({"name": 7}, "name must be of type str, got 7"),
        ({"gain": -1.0}, "gain must be positive"),
        ({"lock_step": True, "enable_stamped_cmd_vel": False}, "lock_step needs enable_stamped_cmd_vel"),
    ],
)
def test_wrong_names_types_and_values_are_refused(node_with, given, said):
    with pytest.raises(ValueError, match=said):
        declare(node_with(**given), Common, Params)


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

"""Parameters: what is refused, and what is taken for what."""

from dataclasses import dataclass

import pytest
from rclpy.node import Node
from rclpy.parameter import Parameter

from turtlebot_gym_ros.node.parameters import Common, declare


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


def test_defaults_are_declared_and_those_of_the_block_count(node_with):
    node = node_with()
    common, params = declare(node, Common, Params)
    assert params == Params()
    assert common == Common(start_enabled=True)
    assert node.get_parameter("gain").value == 1.5
    assert node.get_parameter("frame").value == "odom"


def test_given_values_are_taken_and_an_integer_will_do_for_a_float(node_with):
    node = node_with(gain=2, steps=7, name="a.csv", start_enabled=False)
    common, params = declare(node, Common, Params)
    assert params == Params(gain=2.0, steps=7, name="a.csv", start_enabled=False)
    assert isinstance(params.gain, float)
    assert isinstance(node.get_parameter("gain").value, float)
    assert not common.start_enabled


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"gian": 2.0}, "no parameter 'gian': did you mean gain"),
        ({"frequency_of_everything": 2.0}, "there are body_frame, enable_stamped_cmd_vel, frame, gain"),
        ({"gain": "high"}, "gain must be of type float, got 'high'"),
        ({"gain": True}, "gain must be of type float, got True"),
        ({"steps": 2.5}, "steps must be of type int, got 2.5"),
        ({"start_enabled": 1}, "start_enabled must be of type bool, got 1"),
        ({"name": 7}, "name must be of type str, got 7"),
        ({"gain": -1.0}, "gain must be positive"),
        ({"gain": float("nan")}, "gain must be positive"),
    ],
)
def test_wrong_ones_are_refused(node_with, given, said):
    with pytest.raises(ValueError, match=said):
        declare(node_with(**given), Common, Params)


def test_rclpy_alone_would_not_have_noticed(runner):
    overrides = [Parameter("gian", value=2.0)]
    node = Node("careless", context=runner.context, parameter_overrides=overrides)
    assert node.declare_parameter("gain", 1.5).value == 1.5
    node.destroy_node()


def test_parameters_of_ros_itself_are_left_to_it(node_with):
    node = node_with(**{"use_sim_time": True, "qos_overrides./odom.subscription.depth": 1})
    declare(node, Common, Params)
    assert node.get_parameter("use_sim_time").value

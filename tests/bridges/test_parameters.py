"""Parameters: what is refused, and what is taken for what."""

from dataclasses import dataclass, fields

import pytest
from rclpy.node import Node
from rclpy.parameter import Parameter

from turtlebot_gym_ros.blocks import (
    CalibrationDrive,
    KalmanFilter,
    SimulatedTeleop,
    TurtlebotSimulator,
    VelocityController,
    WaypointGenerator,
)
from turtlebot_gym_ros.blocks.visualization import Visualization
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
        ({"frequency_of_everything": 2.0}, "there are body_frame, enable_stamped_cmd_vel, frame, frame_prefix, gain"),
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


NODES = (
    CalibrationDrive,
    KalmanFilter,
    TurtlebotSimulator,
    VelocityController,
    WaypointGenerator,
    SimulatedTeleop,
    Visualization,
)


@pytest.mark.parametrize("block", NODES, ids=lambda block: block.__name__)
def test_every_parameter_of_every_node_is_described(node_with, block):
    node = node_with()
    _, params = declare(node, Common, block.Params)
    for item in (*fields(Common), *fields(block.Params)):
        told = node.describe_parameter(item.name)
        assert len(told.description) > 15, item.name
        assert "\n" not in told.description
        assert told.read_only
        if isinstance(item.default, float):
            assert told.floating_point_range or item.name == "lidar_yaw", item.name
            assert told.additional_constraints or item.name == "lidar_yaw", item.name
    assert params == block.Params()


def test_ranges_are_told_and_the_nodes_own_error_comes_first(node_with):
    node = node_with()
    declare(node, Common, VelocityController.Params)
    period = node.describe_parameter("period")
    assert period.description == "Period for which the policy was made, s. Slower estimates are an error."
    assert period.additional_constraints == "in [0.001, 10] s"
    (told,) = period.floating_point_range
    assert (told.from_value, told.to_value) == (0.001, 10.0)
    node = node_with()
    declare(node, Common, TurtlebotSimulator.Params)
    (told,) = node.describe_parameter("seed").integer_range
    assert (told.from_value, told.to_value) == (0, 2**63 - 1)
    with pytest.raises(ValueError, match=r"period must be in \[0.001, 10\] s, got 11.0"):
        declare(node_with(period=11.0), Common, VelocityController.Params)

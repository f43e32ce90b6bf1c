"""The guard's parameters: what is refused, what ROS shows of them, and those of the robots of this project."""

import math
import re
from dataclasses import fields
from pathlib import Path

import pytest
import yaml
from burger import NUMBERS, Parameters
from rcl_interfaces.srv import SetParameters
from rclpy.node import Node
from rclpy.parameter import Parameter

from cmd_vel_guard import parameters
from cmd_vel_guard.arbiter import Arbiter
from cmd_vel_guard.collision import Footprint
from cmd_vel_guard.declare import declare
from cmd_vel_guard.standby import CmdVelStandby
from cmd_vel_guard.values import Mount
from turtlebot_gym.config import Range, rules
from turtlebot_gym.docstrings import texts_of
from turtlebot_gym.robots import ROBOTS

KIND = parameters.Parameters
RULES = rules(KIND)


@pytest.mark.parametrize("name", RULES)
def test_what_breaks_a_rule_is_refused_by_its_words(name):
    rule, bad = RULES[name], ["none of them"]
    if isinstance(rule, Range):
        beyond = (math.nextafter(rule.low, -9e9), math.nextafter(rule.high, 9e9))
        bad = [math.nan, math.inf, True, *beyond, *([rule.low] if rule.open_low else [])]
    for value in bad:
        with pytest.raises(ValueError, match=re.escape(f"{name} must be {rule}, got {value!r}.")):
            Parameters(**{name: value})


def make_node(runner, **given):
    overrides = [Parameter(name, value=value) for name, value in given.items()]
    options = {"parameter_overrides": overrides, "automatically_declare_parameters_from_overrides": True}
    node = Node("declared", context=runner.context, **options)
    runner.add(node)
    return node


def test_parameters_are_declared_with_their_rules_and_read_only(runner):
    node = make_node(runner, **NUMBERS, rate=100, collision_monitor=True)  # an integer will do for a float
    (declared,) = declare(node, KIND)
    assert declared == Parameters(rate=100.0, collision_monitor=True)
    Arbiter(declared, 100.0)
    for item in fields(KIND):
        descriptor = node.describe_parameter(item.name)
        assert node.get_parameter(item.name).value == getattr(declared, item.name)
        assert descriptor.read_only
        assert descriptor.description == texts_of(KIND)[item.name]
        assert descriptor.additional_constraints == str(RULES.get(item.name, ""))


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"rat": 50.0}, "declared has no parameter 'rat'. Did you mean 'rate'?"),
        ({"rate": "fast"}, "rate must be of type float, got 'fast' (str)."),
        ({"max_age": 0.6}, "max_age must be a number above 0 and at most 0.5 s, got 0.6."),
    ],
)
def test_wrong_names_types_and_values_are_refused(runner, given, said):
    with pytest.raises(ValueError, match=re.escape(said)):
        declare(make_node(runner, **{**NUMBERS, **given}), KIND)


def test_the_clock_of_a_node_that_runs_cannot_be_changed(runner, peer):
    runner.add(CmdVelStandby(runner.context))
    for value, changes in ((True, True), (False, False)):
        parameter = Parameter("use_sim_time", value=value).to_parameter_msg()
        request = SetParameters.Request(parameters=[parameter])
        (result,) = peer.ask("cmd_vel_standby/set_parameters", SetParameters, request).results
        assert result.successful is not changes
        assert ("read when the node starts" in result.reason) is changes


T = 100.0
CONFIG = Path(__file__).parents[2] / "bridges/cmd_vel_guard/config"
SAFE = {"start_enabled": False, "require_emergency_stop": True, "require_standby": True}


def test_the_footprints_hold_the_bodies():
    """Corners of the bodies and of the wheels in the robots' URDF, m; to a millimetre."""
    corners = {
        "burger": (0.105, [(-0.102, 0.07), (0.038, 0.07), (0.033, 0.089), (-0.033, 0.089)]),
        "waffle": (0.22, [(-0.197, 0.133), (0.069, 0.133), (0.033, 0.153), (-0.033, 0.153)]),
        "turtlebot4": (0.171, [(-0.17, 0.0), (0.17, 0.0), (0.0, 0.17)]),
    }
    for robot, (radius, places) in corners.items():
        assert ROBOTS[robot].radius == radius
        assert all(math.hypot(x - ROBOTS[robot].footprint_x, y) <= radius + 0.001 for x, y in places), robot


def test_the_guards_files_have_the_numbers_of_the_presets():
    for path in CONFIG.glob("*.yaml"):
        known, robot = yaml.safe_load(path.read_text())["/**/cmd_vel_guard"]["ros__parameters"], ROBOTS[path.stem]
        limits = ("max_linear", "max_angular", "max_wheel", "wheel_separation", "radius", "footprint_x")
        mount = {f"scan_{part}": getattr(robot.lidar, part) for part in ("frame", "x", "yaw")}
        assert known == {limit: getattr(robot, limit) for limit in limits} | mount | SAFE
        assert robot.reverse
        assert robot.lidar.y == 0.0
        mount = Mount(robot.lidar.frame, robot.lidar.x, 0.0, robot.lidar.yaw)
        monitor = Arbiter(KIND(**known), T).monitor
        assert monitor._body == Footprint(robot.radius, robot.footprint_x, mount)

"""Whatever a message holds, its conversion returns a value that a block can use, or refuses it with one line; no node ends."""

import itertools
import math
import random
import time

import pytest
from burger import WORDS
from diagnostic_msgs.msg import DiagnosticArray
from hostile_messages import healthy, hostile
from rclpy.qos import DurabilityPolicy, QoSProfile

from cmd_vel_guard.guard import CmdVelGuard
from turtlebot_gym.parameters import is_covariance
from turtlebot_gym.values import Fix, Pose
from turtlebot_gym_ros import Shell
from turtlebot_gym_ros.blocks import KalmanFilter, VelocityController
from turtlebot_gym_ros.node.block import FARTHEST
from turtlebot_gym_ros.node.convert import CONVERSIONS, conversion

KINDS = {kind.__name__: way for kind, way in CONVERSIONS.items()}


def numbers(value):
    """Yield all numbers of a value, without those of arrays, which may be infinite or NaN on purpose."""
    if isinstance(value, tuple):
        for part in value:
            yield from numbers(part)
    elif isinstance(value, float):
        yield value


@pytest.mark.parametrize("number", [100, pytest.param(8000, marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", KINDS)
def test_a_message_is_read_or_refused_in_one_line(name, number):
    way, taken, chance = KINDS[name], 0, random.Random(number)
    for _ in range(number):
        message, began = hostile(lambda: healthy(way.message), chance), time.process_time()
        value, refusal = None, ""
        try:
            value = way.read(message)
        except ValueError as error:
            refusal = str(error)
        if value is None:
            assert 0 < len(refusal) < 600
            assert "\n" not in refusal
        else:
            taken += 1
            assert name in ("Clearance", "Fix", "InitialPose", "Scan", "GridMap") or all(map(math.isfinite, numbers(value)))
            pose = getattr(value, {"Fix": "pose", "GridMap": "origin"}.get(name, ""), value if name == "Pose" else ())
            assert all(abs(number) <= FARTHEST for number in pose)
        assert time.process_time() - began < 1.0
    assert taken or name in ("Located", "Transform", "Obstacles")


@pytest.mark.parametrize("tiny", [5e-324, 1e-320, 1e-170, 1e-16, 1e10, 1e170, 1e308, math.inf, -math.inf, math.nan, 0.0, -0.0])
@pytest.mark.parametrize("at", [0, 7, 35])
def test_a_fix_whose_variance_no_sensor_has_is_refused_for_it(tiny, at):
    message = healthy(conversion(Fix).message)
    message.pose.covariance[at] = tiny
    if at == 35 and (tiny == math.inf or tiny < 0.0):  # the heading was not measured
        assert conversion(Fix).read(message).R[2] == math.inf
        return
    with pytest.raises(ValueError, match="must state"):
        conversion(Fix).read(message)


def test_whether_numbers_are_a_covariance_is_known_for_all_that_a_float_can_hold():
    variances = (5e-324, 1e-170, 1.0, 1e308)
    for xx, yy, share in itertools.product(variances, variances, (-2.0, -0.5, 0.0, 0.5, 2.0, math.inf, math.nan)):
        xy = share * math.sqrt(xx) * math.sqrt(yy)
        if xy == 0.0 or abs(xy) > 1e-300:  # below, a float has no digits left
            is_one = abs(xy) <= math.sqrt(xx) * math.sqrt(yy)
            assert is_covariance((xx, yy, 1.0), (xy, 0.0, 0.0)) is is_one, (xx, yy, share)


@pytest.mark.parametrize("far", [1.0001e5, 3e9, 1e308])
@pytest.mark.parametrize("name", ["Pose", "State", "Odometry", "Estimate", "Fix", "GridMap"])
def test_what_is_farther_than_any_robot_is_refused_and_not_written(name, far):
    message = healthy(KINDS[name].message)
    where = message.info.origin if name == "GridMap" else message.pose
    where = getattr(where, "pose", where)
    where.position.y = -far
    with pytest.raises(ValueError, match="nothing is beyond 100000"):
        KINDS[name].read(message)
    where.position.y = -1e5
    value = KINDS[name].read(message)
    if name == "Pose":
        assert value.y == -1e5
        with pytest.raises(ValueError, match="nothing is beyond 100000"):
            KINDS[name].write(Pose(far, 0.0, 0.0), message.header)


@pytest.mark.slow
def test_no_message_ends_a_node(make_runner, peer, wait_for):
    """Nodes that move a robot, each in a namespace of its own, hear 1,500 messages: on no topic a flood."""
    guard = make_runner("--ros-args", "-r", "__ns:=/a", *WORDS, "-p", "collision_monitor:=true", "-p", "geofence:=3.0")
    blocks = {"/b": (KalmanFilter, {"takes_fixes": True}), "/c": (VelocityController, {"start_enabled": True})}
    nodes, chance, publishers = [CmdVelGuard(guard.context)], random.Random(1500), []
    guard.add(nodes[0])
    for namespace, (block, overrides) in blocks.items():
        runner = make_runner()
        shell = Shell(block, block.Params, namespace=namespace, context=runner.context, overrides=overrides)
        runner.add(shell)
        nodes.append(shell.node)
    qos = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    for node in nodes:
        topics = {topic.topic_name: topic.msg_type for topic in node.subscriptions if "events" not in topic.topic_name}
        assert len(topics) > 1
        publishers += [(kind, peer.speak(topic, kind, qos)) for topic, kind in topics.items()]

    def stamped(kind):
        message = healthy(kind)
        if hasattr(message, "header"):
            message.header.stamp = peer.node.get_clock().now().to_msg()
            message.header.frame_id = chance.choice(("odom", "map"))
        return message

    for _ in range(1500):
        kind, publisher = chance.choice(publishers)
        publisher.publish(hostile(lambda kind=kind: stamped(kind), chance))
        time.sleep(0.0025)
    reports = peer.hear("/diagnostics", DiagnosticArray)
    names = {node.get_fully_qualified_name() for node in nodes}
    wait_for(lambda: names <= {status.name for report in list(reports) for status in report.status})

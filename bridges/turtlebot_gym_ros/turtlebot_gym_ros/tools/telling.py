"""``enable``, ``goal`` and ``button``: what a person tells the graph."""

from __future__ import annotations

import sys
import time
from typing import Any

from geometry_msgs.msg import PoseStamped
from rclpy.node import Node
from std_msgs.msg import Bool, Header
from std_srvs.srv import SetBool

from cmd_vel_guard.qos import STREAM
from turtlebot_gym.values import Pose
from turtlebot_gym_ros.base.names import absolute
from turtlebot_gym_ros.base.process import go_on
from turtlebot_gym_ros.node.geometry import write_pose
from turtlebot_gym_ros.tools.asking import answered, asking, parser_of, remark_if_alone, until

BUTTON_PERIOD = 0.1
"""Time between two messages of `button`, s; as a radio needs it."""


@answered
def enable(argv: Any = None) -> int:
    """Enable nodes in the given order, or disable them, by their services ``enable``."""
    parser = parser_of("enable", "Enable nodes, one after the other: watch the robot. It may move from then on.")
    parser.add_argument("node", nargs="+", help="such as cmd_vel_guard velocity_controller")
    parser.add_argument("--off", action="store_true", help="disable instead")
    options = parser.parse_args(argv)
    with asking() as node:
        for name in options.node:
            _switch(node, absolute(name, "node"), on=not options.off, seconds=options.wait)
    return 0


def _switch(node: Node, name: str, *, on: bool, seconds: float) -> None:
    """Enable or disable a node, and print what it says; raise an error if it does not answer, refuses, or there are several."""
    client = node.create_client(SetBool, f"{name}/enable")
    missing = f"there is no service {name}/enable after {seconds:g} s."
    until(lambda: client.service_is_ready() or None, seconds, lambda: missing + remark_if_alone(node))
    nodes = [f"{space.rstrip('/')}/{other}" for other, space in node.get_node_names_and_namespaces()]
    if nodes.count(name) > 1 and on:
        raise ValueError(f"{nodes.count(name)} nodes are called {name}, and one of them would be enabled: end the others.")
    answer = client.call_async(SetBool.Request(data=on))
    until(lambda: answer.done() or None, seconds, lambda: f"{name} has not answered for {seconds:g} s.")
    response: Any = answer.result()
    if not response.success:
        raise ValueError(f"{name}: {response.message}")
    print(f"{name}: {response.message or ('enabled' if on else 'disabled')}", flush=True)


@answered
def goal(argv: Any = None) -> int:
    """Send a goal on ``/goal_pose``; ``ros2 action send_goal`` awaits the outcome of one, by ``navigate_to_pose``."""
    parser = parser_of("goal", "Send the robot to a place: watch it; `status` says if the goal is refused.")
    parser.add_argument("x", type=float, help="m")
    parser.add_argument("y", type=float, help="m")
    parser.add_argument("heading", type=float, nargs="?", default=0.0, help="rad (default: 0)")
    parser.add_argument("--frame", default="odom", help="frame of the goal: odom, or map with a localizer (default: odom)")
    parser.add_argument("--namespace", default="", help="namespace of the robot, such as robot1")
    options = parser.parse_args(argv)
    topic = f"{absolute(options.namespace).rstrip('/')}/goal_pose"
    with asking() as node:
        pose = PoseStamped(header=Header(stamp=node.get_clock().now().to_msg(), frame_id=options.frame))
        write_pose(pose.pose, Pose(options.x, options.y, options.heading))
        publisher = node.create_publisher(PoseStamped, topic, STREAM)
        missing = f"nobody takes goals on {topic} after {options.wait:g} s: is waypoint_generator there?"
        until(lambda: publisher.get_subscription_count() or None, options.wait, lambda: missing + remark_if_alone(node))
        publisher.publish(pose)
        publisher.wait_for_all_acked()
    print(f"the goal was sent on {topic}.")
    return 0


@answered
def button(argv: Any = None) -> int:
    """Say that an emergency stop is not pressed, again and again; the end of it is a stop."""
    parser = parser_of("button", "Be an emergency stop that is not pressed. Ctrl-C ends it, which stops the robot.")
    parser.add_argument("topic", nargs="?", default="emergency_stop", help="(default: emergency_stop)")
    options = parser.parse_args(argv)
    with asking() as node:
        publisher = node.create_publisher(Bool, absolute(options.topic, "topic"), STREAM)
        print(f"publishes on {publisher.topic_name}; Ctrl-C stops the robot", file=sys.stderr, flush=True)
        due = time.monotonic()
        while True:
            go_on()
            publisher.publish(Bool(data=False))
            due += BUTTON_PERIOD
            time.sleep(max(due - time.monotonic(), 0.0))

"""``goal``: send a robot to a place."""

from __future__ import annotations

import math
import sys
import time
from typing import Any

from action_msgs.msg import GoalStatus
from geometry_msgs.msg import PoseStamped
from rclpy.action.client import ActionClient
from rclpy.node import Node
from std_msgs.msg import Header

from cmd_vel_guard.qos import STREAM
from turtlebot_gym.values import Pose
from turtlebot_gym_ros.base.names import absolute
from turtlebot_gym_ros.base.process import go_on
from turtlebot_gym_ros.node.geometry import write_pose
from turtlebot_gym_ros.node.navigate import NAME
from turtlebot_gym_ros.tools.asking import answered, asking, parser_of, remark_if_alone, result_of, settle


@answered
def goal(argv: Any = None) -> int:
    """Send a goal by the action ``navigate_to_pose`` and await its outcome; where nobody serves it, on ``/goal_pose``."""
    parser = parser_of("goal", "Send the robot to a place, and wait until it is there, if navigate_to_pose is served.")
    parser.add_argument("x", type=float, help="m")
    parser.add_argument("y", type=float, help="m")
    parser.add_argument("heading", type=float, nargs="?", default=0.0, help="rad (default: 0)")
    parser.add_argument("--frame", default="odom", help="frame of the goal: odom, or map with a localizer (default: odom)")
    parser.add_argument("--namespace", default="", help="namespace of the robot, such as robot1")
    options = parser.parse_args(argv)
    if not all(map(math.isfinite, (options.x, options.y, options.heading))):
        raise ValueError(f"a goal must be finite numbers, got {options.x}, {options.y}, {options.heading}.")
    prefix = absolute(options.namespace).rstrip("/")
    with asking() as node:
        header = Header(stamp=node.get_clock().now().to_msg(), frame_id=options.frame)
        pose = PoseStamped(header=header)
        write_pose(pose.pose, Pose(options.x, options.y, options.heading))
        topic, action = f"{prefix}/goal_pose", f"{prefix}/{NAME}"
        publisher = node.create_publisher(PoseStamped, topic, STREAM)
        settle(node, options.wait)
        if f"{action}/_action/send_goal" in dict(node.get_service_names_and_types()):
            try:
                from nav2_msgs.action import NavigateToPose  # type: ignore[import-not-found]
            except ImportError:
                print(f"{action} is served, but nav2_msgs is missing here: the goal goes to /goal_pose.", file=sys.stderr)
            else:
                return _await(node, ActionClient(node, NavigateToPose, action), NavigateToPose.Goal(pose=pose), options.wait)
        if not publisher.get_subscription_count():
            remark = remark_if_alone(node) or " Is waypoint_generator there?"
            raise TimeoutError(f"nobody takes goals on {topic} after {options.wait:g} s.{remark}")
        publisher.publish(pose)
        publisher.wait_for_all_acked()
    print(f"the goal was sent on {topic}, which has no answer: watch the robot; `status` says if the goal is refused.")
    return 0


def _await(node: Node, client: Any, goal: Any, seconds: float) -> int:
    """Send a goal, print the way that is left, and return 0 if the robot arrives; Ctrl-C cancels the goal."""

    def show(message: Any) -> None:
        print(f"{message.feedback.distance_remaining:.2f} m left   ", end="\r", flush=True)

    client.wait_for_server(timeout_sec=seconds)
    handle = result_of(client.send_goal_async(goal, feedback_callback=show), NAME, seconds)
    if not handle.accepted:
        raise ValueError(f"{NAME} refuses the goal.")
    outcome = handle.get_result_async()
    try:
        while not outcome.done():
            go_on()
            time.sleep(0.05)
    except KeyboardInterrupt:
        handle.cancel_goal_async()
        time.sleep(0.3)  # the request must leave before the node ends
        raise
    result = outcome.result()
    if result.status == GoalStatus.STATUS_SUCCEEDED:
        print("reached")
        return 0
    print(f"not reached: {getattr(result.result, 'error_msg', '') or f'status {result.status}'}", file=sys.stderr)
    return 1

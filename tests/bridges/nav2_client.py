"""A client with Nav2's own types in a process of its own, which goes the ways of nav2_simple_commander's BasicNavigator.

It reads a task a line as JSON, and prints each outcome as JSON, with the time of the machine's monotonic clock.

References:
    Nav2 (Jazzy, 1.3), ``nav2_simple_commander/robot_navigator.py``: topics, services, their quality of service, and loops.
"""

import json
import sys
import time

import rclpy
from action_msgs.msg import GoalStatus
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from lifecycle_msgs.srv import GetState
from nav2_msgs.action import NavigateToPose
from rclpy.action import ActionClient
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.qos import DurabilityPolicy, QoSProfile

ENDS = {
    GoalStatus.STATUS_SUCCEEDED: "reached",
    GoalStatus.STATUS_ABORTED: "failed",
    GoalStatus.STATUS_CANCELED: "cancelled",
}


def tell(**told):
    print(json.dumps({"at": time.monotonic(), **told}), flush=True)


class Navigator:
    """Nav2's client, reduced to one goal at a time."""

    def __init__(self):
        self.node = rclpy.create_node("basic_navigator")
        self.incompatible, self.located, self.feedback = 0, False, None
        self.client = ActionClient(self.node, NavigateToPose, "navigate_to_pose")
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        hears = SubscriptionEventCallbacks(incompatible_qos=self.count, use_default_callbacks=False)
        says = PublisherEventCallbacks(incompatible_qos=self.count, use_default_callbacks=False)
        self.node.create_subscription(PoseWithCovarianceStamped, "amcl_pose", self.locate, latched, event_callbacks=hears)
        self.shows = self.node.create_publisher(PoseWithCovarianceStamped, "initialpose", 10, event_callbacks=says)
        self.pose = PoseWithCovarianceStamped()
        self.pose.header.frame_id = "map"

    def count(self, event):
        self.incompatible += 1

    def locate(self, message):
        self.located = True

    def set_pose(self, x, y, z, w):
        """As setInitialPose: no covariance, and the stamp of now also when it is sent again."""
        self.located = False
        self.pose.header.stamp = self.node.get_clock().now().to_msg()
        place = self.pose.pose.pose
        place.position.x, place.position.y, place.orientation.z, place.orientation.w = x, y, z, w
        self.shows.publish(self.pose)

    def wait(self):
        """As waitUntilNav2Active."""
        self.until_active("amcl")
        while not self.located:
            self.shows.publish(self.pose)
            rclpy.spin_once(self.node, timeout_sec=1.0)
        self.until_active("bt_navigator")
        tell(end="active", incompatible=self.incompatible)

    def until_active(self, name):
        client, state = self.node.create_client(GetState, f"{name}/get_state"), ""
        while not client.wait_for_service(timeout_sec=1.0):
            pass
        while state != "active":
            rclpy.spin_until_future_complete(self.node, asked := client.call_async(GetState.Request()))
            state = asked.result().current_state.label
            time.sleep(2.0)

    def hear(self, message):
        self.feedback = message.feedback

    def go(self, x, y, *, frame="map", tree="", cancel=None):
        """As goToPose, then isTaskComplete until it is, cancelTask after a time, and getResult."""
        goal = NavigateToPose.Goal(pose=PoseStamped(), behavior_tree=tree)
        goal.pose.header.frame_id, goal.pose.pose.position.x, goal.pose.pose.position.y = frame, x, y
        while not self.client.wait_for_server(timeout_sec=1.0):
            pass
        self.feedback, begun = None, time.monotonic()
        tell(sent=True)
        rclpy.spin_until_future_complete(self.node, sent := self.client.send_goal_async(goal, self.hear))
        result = sent.result().get_result_async()
        while not result.done():
            rclpy.spin_until_future_complete(self.node, result, timeout_sec=0.1)
            if cancel is not None and time.monotonic() > begun + cancel:
                tell(cancels=True)
                rclpy.spin_until_future_complete(self.node, sent.result().cancel_goal_async())
                cancel = None
        said, end = result.result().result, ENDS[result.result().status]
        heard = self.feedback and {
            "frame": self.feedback.current_pose.header.frame_id,
            "left": self.feedback.distance_remaining,
            "time": self.feedback.navigation_time.sec,
            "recoveries": self.feedback.number_of_recoveries,
        }
        tell(end=end, code=said.error_code, said=said.error_msg, heard=heard, incompatible=self.incompatible)


rclpy.init()
navigator = Navigator()
for line in sys.stdin:
    task = json.loads(line)
    getattr(navigator, task.pop("do"))(**task)

"""Listen to /tf and /amcl_pose for a while, as RViz does, and print them as JSON."""

import json
import math
import sys
import time

import rclpy
from geometry_msgs.msg import PoseWithCovarianceStamped
from tf2_msgs.msg import TFMessage


def tell(name, header, place, q):
    stamp = header.stamp.sec * 10**9 + header.stamp.nanosec
    print(json.dumps([name, header.frame_id, stamp, place.x, place.y, 2.0 * math.atan2(q.z, q.w)]), flush=True)


def hear(message):
    for transform in message.transforms:
        tell(transform.child_frame_id, transform.header, transform.transform.translation, transform.transform.rotation)


rclpy.init()
node = rclpy.create_node("listener")
node.create_subscription(TFMessage, "/tf", hear, 100)
node.create_subscription(
    PoseWithCovarianceStamped,
    "amcl_pose",
    lambda told: tell("pose", told.header, told.pose.pose.position, told.pose.pose.orientation),
    100,
)
until = time.monotonic() + float(sys.argv[1])
while time.monotonic() < until:
    rclpy.spin_once(node, timeout_sec=0.1)

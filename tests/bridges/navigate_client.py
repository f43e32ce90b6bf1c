"""A client of navigate_to_pose, as a user's script is one, in its own process: x, y, frame, and s after which it cancels.

It prints what it hears as JSON, each line with the time of the machine's monotonic clock.
"""

import json
import sys
import time

import rclpy
from nav2_msgs.action import NavigateToPose
from rclpy.action import ActionClient


def tell(**told):
    print(json.dumps({"at": time.monotonic(), **told}), flush=True)


def seconds(duration):
    return duration.sec + 1e-9 * duration.nanosec


def hear(message):
    feedback = message.feedback
    pose, place = feedback.current_pose, feedback.current_pose.pose.position
    times = {name: seconds(getattr(feedback, name)) for name in ("navigation_time", "estimated_time_remaining")}
    recoveries = feedback.number_of_recoveries
    tell(left=feedback.distance_remaining, recoveries=recoveries, frame=pose.header.frame_id, x=place.x, y=place.y, **times)


def main(x, y, frame="map", drive=None):
    rclpy.init()
    node = rclpy.create_node("client")
    client = ActionClient(node, NavigateToPose, "navigate_to_pose")
    client.wait_for_server()
    goal = NavigateToPose.Goal()
    goal.pose.header.frame_id, goal.pose.pose.position.x, goal.pose.pose.position.y = frame, float(x), float(y)
    sent = client.send_goal_async(goal, feedback_callback=hear)
    rclpy.spin_until_future_complete(node, sent)
    handle = sent.result()
    tell(accepted=handle.accepted)
    result = handle.get_result_async()
    if drive:
        rclpy.spin_until_future_complete(node, result, timeout_sec=float(drive))
        tell(cancels=True)
        rclpy.spin_until_future_complete(node, handle.cancel_goal_async())
    rclpy.spin_until_future_complete(node, result)
    tell(status=result.result().status, code=result.result().result.error_code)


main(*sys.argv[1:])

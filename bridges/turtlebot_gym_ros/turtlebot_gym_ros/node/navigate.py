"""The action ``navigate_to_pose``: a second door to a block's goals, beside their topic, for clients that await the outcome."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from geometry_msgs.msg import PoseStamped
from lifecycle_msgs.msg import State
from lifecycle_msgs.srv import GetState
from rclpy.action.server import ActionServer, CancelResponse
from rclpy.duration import Duration
from rclpy.node import Node
from std_msgs.msg import Header

from turtlebot_gym.config import short_repr
from turtlebot_gym.values import Pose
from turtlebot_gym_ros.base.frames import Common
from turtlebot_gym_ros.node.errand import Errand, Failure
from turtlebot_gym_ros.node.feed import Feed
from turtlebot_gym_ros.node.geometry import write_pose

NAME = "navigate_to_pose"
NAVIGATOR = "bt_navigator"
"""Name of Nav2's node that serves it."""


class _ActionServer(ActionServer):
    """An action server whose goals are executed elsewhere, and only end here.

    rclpy would await the outcome in a coroutine that its executor resumes each time it wakes.
    """

    def notify_execute(self, goal_handle: Any, execute_callback: Any) -> None:
        """Do nothing when the execution of a goal begins."""

    def finish(self, goal_handle: Any, end: Callable[[Any], Any]) -> None:
        """Let ``end(goal_handle)`` set the final state of a goal, and send the result that it returns."""
        super().notify_execute(goal_handle, end)


class NavigateToPose:
    """The server of the action, ``nav2_msgs/action/NavigateToPose``.

    A goal that is refused is accepted and aborted at once, since a rejection has no reason: the result carries the code of Nav2
    for it, and the text, which the node logs, too. ``read`` returns the pose of a message, or raises `ValueError`.
    """

    def __init__(self, node: Node, block: Any, read: Callable[[PoseStamped], Pose], frame: str) -> None:
        from nav2_msgs.action import NavigateToPose as Action  # type: ignore[import-not-found]

        self._node, self._block, self._read, self._frame, self._action = node, block, read, frame, Action
        self._open: list[tuple[Any, Errand]] = []
        self._server = _ActionServer(
            node,
            Action,
            NAME,
            execute_callback=lambda handle: None,
            handle_accepted_callback=self._take,
            cancel_callback=self._cancel,
        )
        be_active(node, NAVIGATOR)

    def _take(self, handle: Any) -> None:
        goal = handle.request
        try:
            if goal.behavior_tree:
                tree = short_repr(goal.behavior_tree)
                why = f"behavior_tree must be empty, since a policy drives, got {tree}"
                errand = self._block.refuse(why, Failure.BEHAVIOR_TREE)
            else:
                errand = self._block.send(self._read(goal.pose), awaited=True)
        except ValueError as error:
            errand = self._block.refuse(str(error))
        handle.execute()
        self._open.append((handle, errand))
        self.look()

    def _cancel(self, handle: Any) -> CancelResponse:
        for other, errand in self._open:
            if other is handle:
                self._block.cancel(errand)
        return CancelResponse.ACCEPT

    def look(self) -> None:
        """Tell the clients how far the robot has come, or the outcome, after each step."""
        over = [pair for pair in self._open if not pair[1].is_active]
        self._open = [pair for pair in self._open if pair[1].is_active]
        for handle, errand in over:
            self._server.finish(handle, partial(self._end, errand))
        for handle, errand in self._open:
            if errand.pose is not None:
                handle.publish_feedback(self._feedback(errand, errand.pose))

    def _feedback(self, errand: Errand, pose: Pose) -> Any:
        feedback = self._action.Feedback()
        feedback.current_pose.header = Header(stamp=self._node.get_clock().now().to_msg(), frame_id=self._frame)
        write_pose(feedback.current_pose.pose, pose)
        feedback.navigation_time = Duration(seconds=errand.time).to_msg()
        feedback.distance_remaining = errand.left
        return feedback

    def _end(self, errand: Errand, handle: Any) -> Any:
        {"reached": handle.succeed, "failed": handle.abort, "cancelled": handle.canceled}[errand.state]()
        return self._action.Result(error_code=int(errand.code), error_msg=errand.reason)

    def close(self) -> None:
        """Withdraw the action."""
        self._server.destroy()


def be_active(node: Node, name: str) -> None:
    """Offer the service by which Nav2's clients ask whether its node of that name is active."""

    def answer(request: GetState.Request, response: GetState.Response) -> GetState.Response:
        response.current_state = State(id=State.PRIMARY_STATE_ACTIVE, label="active")
        return response

    node.create_service(GetState, f"{name}/get_state", answer)


def offer(node: Node, block: Any, feeds: Mapping[str, Feed], common: Common) -> NavigateToPose | None:
    """Let a block that takes goals hear of those that are refused, and offer the action if its messages are installed."""
    if not hasattr(block, "send"):
        return None
    feeds["goal"].on_refusal = block.refuse
    try:
        return NavigateToPose(node, block, partial(feeds["goal"].read, frame=common.fixed()), common.fixed())
    except ModuleNotFoundError:
        if not common.lock_step:
            node.get_logger().info(
                f"the action {NAME} is not offered: nav2_msgs is missing (ros-DISTRO-nav2-msgs, or RoboStack)."
            )
        return None

"""The action navigate_to_pose: what its clients hear, with stand-ins and live."""

import sys
from types import ModuleType, SimpleNamespace

import pytest
from geometry_msgs.msg import PoseStamped
from lifecycle_msgs.msg import State
from lifecycle_msgs.srv import GetState
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy

from turtlebot_gym.values import Pose
from turtlebot_gym_ros.blocks import Localizer
from turtlebot_gym_ros.node import navigate
from turtlebot_gym_ros.node.errand import Errand, Failure
from turtlebot_gym_ros.node.shell import Shell


class StandInNavigateToPose:
    """Stands in for nav2_msgs/action/NavigateToPose of Jazzy; the live tests have the real one."""

    class Feedback(SimpleNamespace):
        def __init__(self):
            super().__init__(current_pose=PoseStamped(), number_of_recoveries=0)

    class Result(SimpleNamespace):
        def __init__(self, *, error_code, error_msg):
            super().__init__(error_code=error_code, error_msg=error_msg)


class StandInServer:
    """Stands in for rclpy's action server: it ends goals at once."""

    def __init__(self, node, action, name, *, execute_callback, handle_accepted_callback, cancel_callback):
        self.take, self.cancel, self.results = handle_accepted_callback, cancel_callback, []

    def finish(self, handle, end):
        self.results.append(end(handle))


class StandInHandle(SimpleNamespace):
    """Stands in for the handle of a goal in the map's frame, and notes what is called."""

    def __init__(self, frame="map", tree=""):
        goal = PoseStamped()
        goal.header.frame_id, goal.pose.position.x = frame, 2.0
        super().__init__(request=SimpleNamespace(pose=goal, behavior_tree=tree), heard=[], said=[])

    def __getattr__(self, name):
        return lambda *told: self.said.extend(told) if told else self.heard.append(name)


class Planner:
    """A block that takes any goal."""

    def send(self, goal, *, awaited=False):
        self.errand = Errand(goal=goal, awaited=awaited)
        return self.errand

    def cancel(self, errand):
        errand.end("cancelled")

    def refuse(self, why, code=Failure.NOT_LOCALIZED):
        errand = self.send(Pose(0.0, 0.0, 0.0))
        errand.end("failed", code, why)
        return errand


def read(message):
    if message.header.frame_id != "map":
        raise ValueError(f"its frame is {message.header.frame_id!r} instead of 'map'")
    return Pose(message.pose.position.x, 0.0, 0.0)


@pytest.fixture
def door(runner, monkeypatch):
    module = ModuleType("nav2_msgs.action")
    module.NavigateToPose = StandInNavigateToPose
    monkeypatch.setitem(sys.modules, "nav2_msgs", ModuleType("nav2_msgs"))
    monkeypatch.setitem(sys.modules, "nav2_msgs.action", module)
    monkeypatch.setattr(navigate, "_ActionServer", StandInServer)
    node = Node("planner", context=runner.context)
    yield navigate.NavigateToPose(node, Planner(), read, "map")
    node.destroy_node()


def test_a_client_hears_how_far_the_robot_is_and_that_it_has_arrived(door):
    handle = StandInHandle()
    door._server.take(handle)
    errand = door._block.errand
    assert (errand.goal, errand.awaited) == (Pose(2.0, 0.0, 0.0), True)
    door.look()
    assert not handle.said  # before the robot's pose is known
    errand.time = 3.5
    errand.at(Pose(0.5, 0.0, 0.0))
    door.look()
    (told,) = handle.said
    assert (told.current_pose.header.frame_id, told.current_pose.pose.position.x) == ("map", 0.5)
    assert (told.navigation_time.sec, told.navigation_time.nanosec, told.distance_remaining) == (3, 500_000_000, 1.5)
    errand.end("reached")
    door.look()
    door.look()
    assert handle.heard == ["execute", "succeed"]
    assert [result.error_code for result in door._server.results] == [0]


@pytest.mark.parametrize(
    ("handle", "code", "said"),
    [
        (StandInHandle("odom"), Failure.NOT_LOCALIZED, "its frame is 'odom' instead of 'map'"),
        (
            StandInHandle(tree="mine.xml"),
            Failure.BEHAVIOR_TREE,
            "behavior_tree must be empty, since a policy drives, got 'mine.xml'",
        ),
    ],
    ids=["frame", "behaviour tree"],
)
def test_a_goal_that_cannot_be_understood_is_aborted_at_once(door, handle, code, said):
    door._server.take(handle)
    assert handle.heard == ["execute", "abort"]
    assert [(result.error_code, result.error_msg) for result in door._server.results] == [(code, said)]


def test_a_cancelled_goal_and_one_that_failed_end_as_such_each_with_its_own_client(door):
    first, second = StandInHandle(), StandInHandle()
    door._server.take(first)
    door._block.errand.end("failed", Failure.OTHER, "another goal took its place")
    door._server.take(second)
    door._server.cancel(second)
    door.look()
    assert (first.heard, second.heard) == (["execute", "abort"], ["execute", "canceled"])
    results = [(result.error_code, result.error_msg) for result in door._server.results]
    assert results == [(Failure.OTHER, "another goal took its place"), (0, "")]


def test_nav2s_clients_find_its_nodes_active(runner, peer, door):
    """As nav2_simple_commander's waitUntilNav2Active asks: by the name of Nav2's node, in the client's namespace."""
    runner.add(Shell(Localizer, Localizer.Params, context=runner.context))
    runner.add(door._node)
    for name in ("amcl", "bt_navigator"):
        state = peer.ask(f"{name}/get_state", GetState, GetState.Request()).current_state
        assert (state.id, state.label) == (State.PRIMARY_STATE_ACTIVE, "active")
    (pose,) = peer.node.get_publishers_info_by_topic("amcl_pose")  # as nav2_amcl, ``amcl_node.cpp``
    profile = pose.qos_profile
    assert (profile.reliability, profile.durability) == (ReliabilityPolicy.RELIABLE, DurabilityPolicy.TRANSIENT_LOCAL)

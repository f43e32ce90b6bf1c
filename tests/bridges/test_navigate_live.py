"""The action navigate_to_pose: what its clients hear, with stand-ins and live."""

import json
import math
import sys
import time
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from action_msgs.msg import GoalStatus
from geometry_msgs.msg import PoseStamped, TwistStamped
from lifecycle_msgs.msg import State
from lifecycle_msgs.srv import GetState
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from std_msgs.msg import Header

from turtlebot_gym.values import Pose
from turtlebot_gym_ros import Graph
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


CLIENT = Path(__file__).with_name("navigate_client.py")
SIDE, DOOR = 0.05, 1.0
ROOM = 3.0
"""Length and width of each room, m; a fourth one has no door."""
DOORS = (1.0, 2.0)
"""Places of the doors along the walls between the rooms, m."""


def centre(room):
    """Return the middle of a room, of which 3 has no door."""
    return ROOM * (room + 0.5), 0.5 * ROOM


@pytest.fixture(scope="module")
def building(tmp_path_factory, write_map):
    """The map of four rooms in a row, with a pillar each, as `map_server` takes it."""
    cells = np.zeros((round(ROOM / SIDE), round(4 * ROOM / SIDE)), np.uint8)
    cells[[0, -1]] = cells[:, [0, -1]] = 1
    for wall, door in zip((1, 2, 3), (*DOORS, math.inf), strict=True):
        at = round(wall * ROOM / SIDE)
        cells[:, at - 1 : at + 1] = 1
        if door < math.inf:
            cells[round((door - 0.5 * DOOR) / SIDE) : round((door + 0.5 * DOOR) / SIDE), at - 1 : at + 1] = 0
    for room, (x, y) in enumerate(((0.7, 2.3), (1.2, 0.6), (2.2, 0.7), (1.5, 1.0))):
        row, column = round(y / SIDE), round((room * ROOM + x) / SIDE)
        cells[row - 3 : row + 3, column - 3 - room : column + 3 + room] = 1
    return write_map(tmp_path_factory.mktemp("building"), np.where(cells[::-1] == 1, 0, 254).astype(np.uint8), resolution=SIDE)


@pytest.fixture(params=["vfh", "ppo-rooms"])
def robot(request, building):
    """The graph in real time, in processes; the robot is in the first three rooms."""
    pytest.importorskip("nav2_msgs", reason="needs nav2_msgs, which comes with a ROS installation")
    parameters = {"policy": request.param, "noise": "wheel", "localizer": "match"}
    with Graph(world=str(building), processes=True, speed=1.0, seed=2, **parameters) as graph:
        graph.wait_until(lambda graph: graph.time > 2.0)  # its first reset has been heard
        assert graph.latest["true_state"].x < 3 * ROOM
        yield graph


@pytest.fixture
def send(launch):
    """Run a client to its end, and return what it heard."""

    def sent(*arguments):
        process = launch(str(CLIENT), *map(str, arguments))
        out, err = process.communicate(timeout=240.0)
        assert process.returncode == 0, err
        return [json.loads(line) for line in out.splitlines()]

    return sent


def told(heard, name):
    return [entry[name] for entry in heard if name in entry]


@pytest.mark.nightly
def test_goals_lead_through_three_rooms_or_end_with_the_reason(robot, send, peer, wait_for):
    commands, goals = [], peer.speak("goal_pose", PoseStamped)
    peer.node.create_subscription(
        TwistStamped, "cmd_vel", lambda message: commands.append((time.monotonic(), message.twist)), 100
    )
    ends = sorted((0, 2), key=lambda room: math.dist(robot.latest["true_state"][:2], centre(room)))

    # A goal in another frame is refused, and the robot stays.
    foreign = send(*centre(1), "odom")
    assert (told(foreign, "status"), told(foreign, "code")) == ([GoalStatus.STATUS_ABORTED], [Failure.NOT_LOCALIZED])
    assert math.dist(robot.latest["reference"][:2], robot.latest["true_state"][:2]) < 0.2  # it stays where it is

    # Cancel stops it within 0.5 s.
    cancelled = send(*centre(ends[1]), "map", 5.0)
    assert told(cancelled, "status") == [GoalStatus.STATUS_CANCELED]
    (asked,) = (entry["at"] for entry in cancelled if "cancels" in entry)
    moving = [at for at, twist in commands if twist.linear.x or twist.angular.z]
    assert any(asked - 1.0 < at < asked for at in moving)
    assert max(moving) - asked < 0.5
    assert max(at for at, _ in commands) > asked

    # RViz's goal leads to one end of the building, and the action's from there through all rooms to the other.
    goal = PoseStamped(header=Header(frame_id="map"))
    goal.pose.position.x, goal.pose.position.y = centre(ends[0])
    goals.publish(goal)
    robot.wait_until(lambda graph: math.dist(graph.latest["true_state"][:2], centre(ends[0])) < 0.2, timeout=120.0)
    heard = send(*centre(ends[1]))
    assert told(heard, "status") == [GoalStatus.STATUS_SUCCEEDED]
    assert math.dist(robot.latest["true_state"][:2], centre(ends[1])) < 0.2
    assert {int(x // ROOM) for x in told(heard, "x")} == {0, 1, 2}
    left, times = told(heard, "left"), told(heard, "navigation_time")
    assert left[0] > 2 * ROOM - 0.5 > 1.0 > left[-1]
    assert times == sorted(times)
    assert times[-1] > 20.0
    assert {*told(heard, "recoveries")} == {0}
    assert {*told(heard, "frame")} == {"map"}
    remaining = told(heard, "estimated_time_remaining")
    assert remaining[0] > 20.0 > 5.0 > remaining[-1] > 0.0

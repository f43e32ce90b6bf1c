"""Markers and RViz: what is shown is what is said, and nothing depends on it."""

import math
from pathlib import Path

import numpy as np
import pytest
import yaml
from bench import said_types
from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, QoSCompatibility, QoSProfile, ReliabilityPolicy, qos_check_compatible
from std_msgs.msg import Header
from std_srvs.srv import Trigger
from visualization_msgs.msg import Marker, MarkerArray

from turtlebot_gym.estimation.ekf import Estimate
from turtlebot_gym.tasks import SQUARE_WAYPOINTS
from turtlebot_gym.values import Belief, Covariance, Pose, State
from turtlebot_gym_ros import Graph
from turtlebot_gym_ros.base.names import type_name
from turtlebot_gym_ros.base.qos import LATCHED, SENSOR, STREAM
from turtlebot_gym_ros.blocks import WaypointGenerator
from turtlebot_gym_ros.blocks.simulator import MAP_OUTPUTS, ROOM_OUTPUTS
from turtlebot_gym_ros.graph.markers import LIFETIME, MarkerScene, Visualization
from turtlebot_gym_ros.node.convert import conversion, conversion_of
from turtlebot_gym_ros.node.geometry import _yaw_of
from turtlebot_gym_ros.node.shell import Shell
from turtlebot_gym_ros.nodes import BLOCKS, load

RVIZ = Path(__file__).parents[2] / "bridges" / "turtlebot_gym_ros" / "rviz" / "turtlebot.rviz"
HEADER = Header(frame_id="odom")
GOAL, NEXT = Pose(2.0, 0.0, 0.5), Pose(2.0, 2.0, 1.0)


def estimate(x, y):
    return Estimate(Belief(State(x, y, 0.0, 0.0, 0.0), Covariance(*[0.0] * 15)), 0.0, 0.0)


def message(scene):
    return {marker.ns: marker for marker in conversion(MarkerScene).write(scene, HEADER).markers}


def see(block, x, **others):
    values = {"reference": None, "following": None, "truth": None, **others}
    return block.step(0.2, estimate=estimate(x, 0.0), **values)["scene"]


def test_paths_grow_to_their_length_and_a_reset_forgets_them():
    block = Visualization(Visualization.Params(period=0.2, trail=1.0))
    for k in range(8):
        scene = see(block, float(k), truth=State(k + 0.1, 0.0, 0.0, 0.0, 0.0))
    assert scene.believed == tuple((float(k), 0.0) for k in range(3, 8))
    assert scene.true == tuple((k + 0.1, 0.0) for k in range(3, 8))
    block.reset()
    assert see(block, 9.0) == MarkerScene(None, None, 0.3, ((9.0, 0.0),), ())


def test_a_last_waypoint_has_none_after_it():
    block = Visualization(Visualization.Params())
    assert see(block, 0.0, reference=GOAL, following=NEXT)[:2] == (GOAL, NEXT)
    assert see(block, 0.0, reference=GOAL, following=GOAL)[:2] == (GOAL, None)


def test_a_waypoint_is_a_disc_of_the_arrival_radius_with_an_arrow():
    markers = message(MarkerScene(GOAL, NEXT, 0.3, (), ()))
    assert markers.keys() == {"waypoint", "waypoint_heading", "next_waypoint", "next_waypoint_heading"}
    for name, pose in (("waypoint", GOAL), ("next_waypoint", NEXT)):
        disc, arrow = markers[name], markers[f"{name}_heading"]
        assert (disc.type, arrow.type) == (Marker.CYLINDER, Marker.ARROW)
        assert disc.scale.x == disc.scale.y == pytest.approx(2 * 0.3)
        for marker in (disc, arrow):
            assert (marker.pose.position.x, marker.pose.position.y) == pose[:2]
            assert _yaw_of(marker.pose.orientation) == pytest.approx(pose.theta)
    assert markers["next_waypoint"].color.a < markers["waypoint"].color.a < 1.0  # what lies below can be seen


def test_a_path_is_a_line_in_the_colours_of_the_figures():
    markers = message(MarkerScene(None, None, 0.3, ((0.0, 0.0), (1.0, 2.0)), ((0.0, 0.0), (1.0, 1.9), (2.0, 2.0))))
    believed, true = markers["believed_path"], markers["true_path"]
    assert [(point.x, point.y) for point in believed.points] == [(0.0, 0.0), (1.0, 2.0)]
    assert len(true.points) == 3
    assert believed.type == true.type == Marker.LINE_STRIP
    np.testing.assert_allclose([believed.color.r, believed.color.g, believed.color.b], np.array([213, 94, 0]) / 255, atol=1e-6)
    assert not message(MarkerScene(None, None, 0.3, ((0.0, 0.0),), ()))  # RViz complains of a line of one point


def test_every_marker_is_in_the_world_frame_is_replaced_by_its_successor_and_vanishes_without_one():
    markers = message(MarkerScene(GOAL, NEXT, 0.3, ((0.0, 0.0), (1.0, 0.0)), ((0.0, 0.0), (1.0, 0.0))))
    assert len(markers) == 6  # each name once, so that it is the same marker the next time
    for marker in markers.values():
        assert marker.header == HEADER
        assert (marker.action, marker.id, marker.lifetime) == (Marker.ADD, 0, Duration(seconds=LIFETIME).to_msg())
    with pytest.raises(ValueError, match="no node takes it"):
        conversion(MarkerScene).read(MarkerArray())


def points(array, name):
    return [(point.x, point.y) for marker in array.markers if marker.ns == name for point in marker.points]


def test_it_shows_a_running_graph_and_a_reset_begins_a_new_path(runner, peer, wait_for):
    heard = peer.hear("markers", MarkerArray)
    runner.add(Shell(Visualization, Visualization.Params, context=runner.context))
    with Graph(noise="clean", speed=5.0):
        array = wait_for(lambda: next((message for message in heard if len(points(message, "believed_path")) > 10), None))
        assert {marker.header.frame_id for marker in array.markers} == {"odom"}
        (place,) = (marker.pose.position for marker in array.markers if marker.ns == "waypoint")
        assert (place.x, place.y) == SQUARE_WAYPOINTS[0][:2]
        for name in ("believed_path", "true_path"):
            assert np.abs(points(array, name))[:, 1].max() < 0.05  # straight along the x axis
        seen, length = len(heard), len(points(array, "believed_path"))
        peer.ask("turtlebot_simulator/reset", Trigger, Trigger.Request())
        wait_for(lambda: any(1 < len(points(array, "believed_path")) < length for array in heard[seen:]))


def displays():
    return {display["Name"]: display for display in yaml.safe_load(RVIZ.read_text())["Visualization Manager"]["Displays"]}


CLASSES = {
    "rviz_default_plugins/Odometry": "nav_msgs/msg/Odometry",
    "rviz_default_plugins/MarkerArray": type_name(MarkerArray),
    "rviz_default_plugins/Map": "nav_msgs/msg/OccupancyGrid",
    "rviz_default_plugins/LaserScan": "sensor_msgs/msg/LaserScan",
    "rviz_default_plugins/PoseArray": "geometry_msgs/msg/PoseArray",
}
TOOLS = {
    "rviz_default_plugins/SetGoal": "geometry_msgs/msg/PoseStamped",
    "rviz_default_plugins/SetInitialPose": "geometry_msgs/msg/PoseWithCovarianceStamped",
}
"""What RViz's tools publish: rviz_default_plugins, ``tools/goal_pose`` and ``tools/pose_estimate``."""
IN_A_ROOM = {f"/{output.topic}": output for output in (*ROOM_OUTPUTS.values(), *MAP_OUTPUTS.values())}


def test_rviz_shows_topics_that_exist_with_their_type_in_their_frame():
    said = said_types()
    shown = {display["Topic"]["Value"]: display for display in displays().values() if "Topic" in display}
    assert shown.keys() == {"/markers", "/odom", "/true_state", "/estimate", "/obstacles", "/map", "/scan", "/hypotheses"}
    for topic, display in shown.items():
        assert CLASSES[display["Class"]] == said[topic]
        assert all(display[key] is True for key in ("Enabled", "Value"))
    config = yaml.safe_load(RVIZ.read_text())["Visualization Manager"]
    assert config["Global Options"]["Fixed Frame"] == HEADER.frame_id


def profile_of(topic):
    """Return the quality of service in RViz's words."""
    words = {key: str(value).replace(" ", "_").upper() for key, value in topic.items()}
    return QoSProfile(
        depth=topic["Depth"],
        reliability=ReliabilityPolicy[words["Reliability Policy"]],
        durability=DurabilityPolicy[words["Durability Policy"]],
    )


def test_rviz_speaks_to_nodes_that_understand_it():
    """Each tool's topic is the input of a node, with its type and a quality of service that matches."""
    tools = yaml.safe_load(RVIZ.read_text())["Visualization Manager"]["Tools"]
    spoken = {tool["Class"]: tool["Topic"] for tool in tools if "Topic" in tool}
    assert spoken.keys() == TOOLS.keys()
    heard = [source for name in BLOCKS for source in load(name).inputs.values()]
    for tool, topic in spoken.items():
        listeners = [source for source in heard if f"/{source.topic}" == topic["Value"]]
        assert len(listeners) == {"/goal_pose": 1, "/initialpose": 2}[topic["Value"]]
        for source in listeners:
            assert type_name(conversion_of(source).message) == TOOLS[tool]
            theirs, ours = profile_of(topic), STREAM if source.reliable else SENSOR
            assert qos_check_compatible(theirs, LATCHED if source.latched else ours)[0] != QoSCompatibility.ERROR


def test_rviz_understands_who_speaks():
    for name, display in displays().items():
        if "Topic" not in display:
            continue
        profile = profile_of(display["Topic"])
        latched = getattr(IN_A_ROOM.get(display["Topic"]["Value"]), "latched", False)
        assert qos_check_compatible(LATCHED if latched else STREAM, profile)[0] != QoSCompatibility.ERROR, name
        assert (profile.durability == DurabilityPolicy.TRANSIENT_LOCAL) == latched, name


def test_rviz_draws_the_ellipse_of_95_per_cent():
    """RViz scales by the standard deviation; of 10^5 draws a share outside these bounds has a chance of 10^-4."""
    covariance = displays()["Estimate, 95 %"]["Covariance"]["Position"]
    assert covariance["Value"] is True
    draws = np.random.default_rng(0).normal(size=(100_000, 2))
    share = np.mean(np.hypot(*draws.T) <= covariance["Scale"])
    assert abs(share - 0.95) < 3.9 * math.sqrt(0.95 * 0.05 / 100_000)


def test_the_disc_is_the_one_in_which_the_generator_sees_an_arrival():
    assert Visualization.Params().radius == WaypointGenerator.Params().radius
    for path in (RVIZ.parents[1] / "config").glob("*.yaml"):
        config = yaml.safe_load(path.read_text())
        assert (
            len({config[f"/**/{name}"]["ros__parameters"]["radius"] for name in ("visualization", "waypoint_generator")}) == 1
        )

"""RViz shows what is said, and speaks to nodes that understand it."""

import math
from pathlib import Path

import numpy as np
import yaml
from bench import said_types
from rclpy.qos import DurabilityPolicy, QoSCompatibility, QoSProfile, ReliabilityPolicy, qos_check_compatible
from std_msgs.msg import Header
from visualization_msgs.msg import MarkerArray

from cmd_vel_guard.qos import LATCHED, STREAM
from cmd_vel_guard.sources import type_name
from turtlebot_gym_ros.base.qos import SENSOR
from turtlebot_gym_ros.blocks.simulator import MAP_OUTPUTS, ROOM_OUTPUTS
from turtlebot_gym_ros.node.convert import conversion_of
from turtlebot_gym_ros.nodes import BLOCKS, load

RVIZ = Path(__file__).parents[2] / "bridges" / "turtlebot_gym_ros" / "rviz" / "turtlebot.rviz"
HEADER = Header(frame_id="odom")


def displays():
    return {display["Name"]: display for display in yaml.safe_load(RVIZ.read_text())["Visualization Manager"]["Displays"]}


CLASSES = {
    "rviz_default_plugins/Odometry": "nav_msgs/msg/Odometry",
    "rviz_default_plugins/MarkerArray": type_name(MarkerArray),
    "rviz_default_plugins/Pose": "geometry_msgs/msg/PoseStamped",
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
    assert shown.keys() == {"/reference", "/odom", "/true_state", "/estimate", "/obstacles", "/map", "/scan"}
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

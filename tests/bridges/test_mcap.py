"""A recorded MCAP log as other people's readers see it: MCAP's own library, and its decoder of ROS 2 messages.

Foxglove and PlotJuggler read schemas, times and latched topics from the file alone, without a ROS installation.
"""

import signal
import sys
from collections import defaultdict

import pytest
import yaml
from nav_msgs.msg import Odometry
from rclpy.serialization import serialize_message
from std_msgs.msg import String

from turtlebot_gym_ros import Graph, Shell
from turtlebot_gym_ros.nodes import load
from turtlebot_gym_ros.recording.bag import Bag

mcap_reader = pytest.importorskip("mcap.reader", reason="needs mcap")
decoder = pytest.importorskip("mcap_ros2.decoder", reason="needs mcap-ros2-support")

NOW = 1_800_000_000_000_000_000  # ns


class Log:
    """An MCAP file, read by MCAP's own library."""

    def __init__(self, folder):
        (path,) = folder.glob("*.mcap")
        with path.open("rb") as file:
            reader = mcap_reader.make_reader(file, validate_crcs=True, decoder_factories=[decoder.DecoderFactory()])
            self.profile, summary = reader.get_header().profile, reader.get_summary()
            assert summary is not None  # a file without its end would have none
            self.summary = summary
            self.channels = {each.topic: each for each in summary.channels.values()}
            self.schemas = {topic: summary.schemas[each.schema_id] for topic, each in self.channels.items()}
            self.messages, self.times = defaultdict(list), []
            for _, channel, message, decoded in reader.iter_decoded_messages(log_time_order=False):  # as they lie in the file
                self.messages[channel.topic].append(decoded)
                self.times.append((message.log_time, message.publish_time))

    def is_latched(self, topic):
        profiles = yaml.safe_load(self.channels[topic].metadata.get("offered_qos_profiles") or "[]")
        return any(profile["durability"] in ("transient_local", 1) for profile in profiles)

    def require_form(self):
        """Check what every log has to have."""
        assert self.profile == "ros2"
        assert self.summary.statistics.message_count == len(self.times) > 0
        for topic, channel in self.channels.items():
            schema = self.schemas[topic]
            assert channel.message_encoding == "cdr", topic
            assert schema.encoding == "ros2msg", topic
            assert schema.name.count("/") == 2, topic
            assert schema.data.strip() or schema.name == "std_msgs/msg/Empty", topic  # which has no fields
        assert self.times == sorted(self.times)
        assert self.summary.statistics.message_start_time == self.times[0][0]
        assert self.summary.statistics.message_end_time == self.times[-1][0]


def test_a_log_is_read_by_mcaps_own_library(tmp_path):
    bag = Bag(tmp_path / "run")
    odom = bag.add("/odom", "nav_msgs/msg/Odometry", latched=False)
    state = bag.add("/velocity_controller/state", "std_msgs/msg/String", latched=True)
    bag.write(state, NOW, serialize_message(String(data="active")))
    for k in (0, 2, 1):  # messages of several publishers are handed over as they are collected
        message = Odometry()
        message.header.stamp.sec, message.pose.pose.position.x = k, 0.5 * k
        bag.write(odom, NOW + 1000 * (1 + k), serialize_message(message))
    bag.close("mcap")
    log = Log(tmp_path / "run")
    log.require_form()
    assert [message.pose.pose.position.x for message in log.messages["/odom"]] == [0.0, 0.5, 1.0]
    assert [message.data for message in log.messages["/velocity_controller/state"]] == ["active"]
    assert {topic: log.is_latched(topic) for topic in log.channels} == {"/odom": False, "/velocity_controller/state": True}
    assert log.schemas["/odom"].name == "nav_msgs/msg/Odometry"


@pytest.fixture
def hall(tmp_path, write_map):
    """The path of a map of an empty hall of 6 m by 6 m."""
    return write_map(tmp_path, resolution=0.1, origin=[-3, -3, 0])


def test_a_recorded_drive_opens_by_the_book(runner, peer, wait_for, launch, hall, tmp_path, monkeypatch):
    monkeypatch.setenv("AMENT_PREFIX_PATH", sys.prefix)
    folder = tmp_path / "run"
    process = launch("-m", "turtlebot_gym_ros", "data_logger", "--ros-args", "-p", f"output:={folder}", "-p", "storage:=mcap")
    picture = load("visualization")
    runner.add(Shell(picture, picture.Params, context=runner.context))
    with Graph(world=str(hall), policy="vfh", speed=1.0) as graph:

        def recorded(topic):
            return any(each.node_name == "data_logger" for each in peer.node.get_subscriptions_info_by_topic(topic))

        wait_for(lambda: all(map(recorded, ("/odom", "/map", "/markers", "/cmd_vel", "/diagnostics"))))
        begun = graph.time
        graph.wait_until(lambda graph: graph.time >= begun + 3.0)
        wait_for(lambda: graph.latest.get("map"))
    process.send_signal(signal.SIGINT)
    _, stderr = process.communicate(timeout=60.0)
    assert process.returncode == 0, stderr
    log = Log(folder)
    log.require_form()
    shown = {"/odom", "/true_state", "/estimate", "/reference", "/cmd_vel", "/nis", "/scan", "/clearance", "/obstacles"}
    assert shown | {"/map", "/markers", "/diagnostics", "/velocity_controller/state"} <= set(log.messages)
    assert log.is_latched("/map")
    assert log.is_latched("/velocity_controller/state")
    assert not any(map(log.is_latched, shown))
    for topic in shown - {"/obstacles"}:
        stamps = [message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec for message in log.messages[topic]]
        assert stamps == sorted(stamps), topic
        assert stamps[-1] > stamps[0], topic
    for topic in ("/odom", "/true_state", "/estimate", "/reference"):  # without transforms, all is drawn in one frame
        assert {message.header.frame_id for message in log.messages[topic]} == {"odom"}, topic
    assert all(float(message.status[0].values[0].value) >= 0.0 for message in log.messages["/nis"])
    (grid,) = {id(each): each for each in log.messages["/map"]}.values()
    assert (grid.info.width, grid.info.height) == (60, 60)
    assert len(grid.data) == 3600

"""The layout for Foxglove shows what there is, and a recorded MCAP log opens for other people's readers."""

import json
import re
import signal
import sys
from collections import defaultdict
from importlib import import_module
from pathlib import Path

import pytest
import yaml
from bench import said_types
from nav_msgs.msg import Odometry
from rclpy.serialization import serialize_message
from scipy.stats import chi2
from std_msgs.msg import Header, String

from turtlebot_gym_ros import Graph
from turtlebot_gym_ros.base.frames import Common
from turtlebot_gym_ros.node.block import Nis
from turtlebot_gym_ros.node.convert import conversion
from turtlebot_gym_ros.recording.bag import Bag

LAYOUT = Path(__file__).parents[2] / "bridges" / "turtlebot_gym_ros" / "layouts" / "foxglove.json"
FOXGLOVE = json.loads(LAYOUT.read_text())
DRAWN_BY_FOXGLOVE = {
    "geometry_msgs/msg/PoseStamped",
    "geometry_msgs/msg/PoseWithCovarianceStamped",
    "nav_msgs/msg/OccupancyGrid",
    "sensor_msgs/msg/LaserScan",
    "visualization_msgs/msg/MarkerArray",
}
"""Types that its 3D panel draws; Odometry is not one of them."""


@pytest.fixture(scope="module")
def types():
    """Types of the graph's topics by name."""
    return said_types() | {
        "/diagnostics": "diagnostic_msgs/msg/DiagnosticArray",
        "/velocity_controller/state": "std_msgs/msg/String",
    }


def field_type(kind, fields):
    """Return the type of a message's field; raises KeyError where there is none."""
    for field in fields:
        package, folder, name = kind.split("/")
        declared = getattr(import_module(f"{package}.{folder}"), name).get_fields_and_field_types()[field.partition("[")[0]]
        element = re.fullmatch(r"sequence<([^,>]+).*>|([^\[]+)\[\d+\]", declared)
        assert ("[" in field) == (element is not None), field
        kind = next(filter(None, element.groups())) if element else declared
        kind = kind if kind.count("/") != 1 else kind.replace("/", "/msg/")
    return kind


def paths(config):
    """Return the message paths of a panel; a number is a line at a height."""
    return [path["value"] for path in config.get("paths", ()) if not re.fullmatch(r"[\d.]+", path["value"])]


@pytest.mark.parametrize("panel", FOXGLOVE["configById"])
def test_foxglove_shows_what_there_is(panel, types):
    config = FOXGLOVE["configById"][panel]
    for topic, shown in config.get("topics", {}).items():
        assert types[topic] in DRAWN_BY_FOXGLOVE
        assert shown["visible"] is True
    for path in paths(config):
        topic, _, fields = path.partition(".")
        assert field_type(types[topic], fields.split(".")) in ("double", "float", "string"), path
    if "topicToRender" in config:
        assert types[config["topicToRender"]] == "diagnostic_msgs/msg/DiagnosticArray"


def test_a_path_that_does_not_exist_is_noticed(types):
    with pytest.raises(KeyError):
        field_type(types["/odom"], ["pose", "position", "x"])
    with pytest.raises(AssertionError):
        field_type(types["/nis"], ["status", "values"])


@pytest.mark.parametrize("panel", FOXGLOVE["configById"])
def test_foxgloves_own_package_knows_each_setting(panel):
    layouts = pytest.importorskip("foxglove.layouts", reason="needs foxglove-sdk")
    series = {"Plot": layouts.PlotSeries(value=""), "StateTransitions": layouts.StateTransitionsSeries(value="")}
    topics = {
        "/map": layouts.BaseRendererRosOccupancyGridTopicSettings,
        "/scan": layouts.BaseRendererLaserScanTopicSettings,
        "/reference": layouts.BaseRendererPoseTopicSettings,
        "/pose_fix": layouts.BaseRendererPoseTopicSettings,
        "/obstacles": layouts.BaseRendererRosMarkerTopicSettings,
    }
    kinds = {
        "3D": layouts.ThreeDeeConfig,
        "Plot": layouts.PlotConfig,
        "StateTransitions": layouts.StateTransitionsConfig,
        "DiagnosticSummary": layouts.DiagnosticsSummaryConfig,
    }
    kind, config = panel.partition("!")[0], FOXGLOVE["configById"][panel]

    def require_known(settings, model):
        assert set(settings) <= set(model._to_dict()) | {"foxglovePanelTitle"}

    require_known(config, kinds[kind]())
    for path in config.get("paths", ()):
        require_known(path, series[kind])
    for topic, shown in config.get("topics", {}).items():
        require_known(shown, topics[topic]())
    if kind == "3D":
        require_known(config["cameraState"], layouts.ThreeDeeCameraState())
        require_known(config["publish"], layouts.ThreeDeePublishSettings())
        for layer in config["layers"].values():
            require_known(layer, layouts.BaseRendererGridLayerSettings())


def test_foxglove_has_a_place_for_each_panel():
    def leaves(node):
        return [node] if isinstance(node, str) else [*leaves(node["first"]), *leaves(node["second"])]

    assert sorted(leaves(FOXGLOVE["layout"])) == sorted(FOXGLOVE["configById"])


def test_foxglove_draws_in_the_world_frame_and_sends_goals_to_the_waypoints():
    (scene,) = (config for name, config in FOXGLOVE["configById"].items() if name.startswith("3D!"))
    assert scene["followTf"] == Common().world
    assert scene["publish"]["poseTopic"] == "/goal_pose"


def test_the_line_of_the_nis_is_that_of_95_per_cent():
    plot = FOXGLOVE["configById"]["Plot!nis"]
    (line,) = (float(path["value"]) for path in plot["paths"] if path["label"] == "95 %")
    assert line == pytest.approx(chi2.ppf(0.95, 3), abs=0.01)
    assert f"{line:.2f}" in plot["foxglovePanelTitle"]
    message = conversion(Nis).write(Nis(1.25), Header())
    assert float(message.status[0].values[0].value) == 1.25


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
            self.channels = {channel.topic: channel for channel in summary.channels.values()}
            self.schemas = {topic: summary.schemas[channel.schema_id] for topic, channel in self.channels.items()}
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
    with Graph(world=str(hall), policy="vfh", speed=1.0) as graph:

        def recorded(topic):
            return any(subscriber.node_name == "data_logger" for subscriber in peer.node.get_subscriptions_info_by_topic(topic))

        wait_for(lambda: all(map(recorded, ("/odom", "/map", "/cmd_vel", "/diagnostics"))))
        begun = graph.time
        graph.wait_until(lambda graph: graph.time >= begun + 3.0)
        wait_for(lambda: graph.latest.get("map"))
    process.send_signal(signal.SIGINT)
    _, stderr = process.communicate(timeout=60.0)
    assert process.returncode == 0, stderr
    log = Log(folder)
    log.require_form()
    shown = {"/odom", "/true_state", "/estimate", "/reference", "/cmd_vel", "/nis", "/scan", "/clearance", "/obstacles"}
    assert shown | {"/map", "/diagnostics", "/velocity_controller/state"} <= set(log.messages)
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
    (grid,) = {id(message): message for message in log.messages["/map"]}.values()
    assert (grid.info.width, grid.info.height) == (60, 60)
    assert len(grid.data) == 3600

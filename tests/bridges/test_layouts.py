"""Layouts for Foxglove and PlotJuggler: each topic exists, each path is a number of its message, each panel has its place."""

import json
import re
from importlib import import_module
from pathlib import Path
from xml.etree import ElementTree

import pytest
from scipy.stats import chi2
from std_msgs.msg import Header

from turtlebot_gym_ros.base.frames import Common
from turtlebot_gym_ros.base.names import type_name
from turtlebot_gym_ros.blocks.simulator import FIX_OUTPUTS, MAP_OUTPUTS, ROOM_OUTPUTS
from turtlebot_gym_ros.graph.diagram import _says
from turtlebot_gym_ros.node.block import Nis
from turtlebot_gym_ros.node.convert import conversion
from turtlebot_gym_ros.nodes import BLOCKS

LAYOUTS = Path(__file__).parents[2] / "bridges" / "turtlebot_gym_ros" / "layouts"
FOXGLOVE = json.loads((LAYOUTS / "foxglove.json").read_text())
PLOTJUGGLER = ElementTree.parse(LAYOUTS / "plotjuggler.xml").getroot()
DRAWN_BY_FOXGLOVE = {
    "geometry_msgs/msg/PoseStamped",
    "geometry_msgs/msg/PoseWithCovarianceStamped",
    "nav_msgs/msg/OccupancyGrid",
    "sensor_msgs/msg/LaserScan",
    "visualization_msgs/msg/MarkerArray",
}
"""Types that its 3D panel draws; Odometry is not one of them, so that paths come from /markers."""


@pytest.fixture(scope="module")
def types():
    """Types of the graph's topics by name."""
    said = {f"/{topic}": kind for name in BLOCKS for topic, kind in _says(name, guarded=False).items()}
    said |= {f"/{each.topic}": each.type for each in (*ROOM_OUTPUTS.values(), *MAP_OUTPUTS.values(), *FIX_OUTPUTS.values())}
    return {topic: type_name(conversion(kind).message) for topic, kind in said.items()} | {
        "/diagnostics": "diagnostic_msgs/msg/DiagnosticArray",
        "/velocity_controller/state": "std_msgs/msg/String",
    }


def field_type(kind, fields):
    """Return the type of a message's field; raises KeyError where there is none."""
    for field in fields:
        package, folder, name = kind.split("/")
        found = getattr(import_module(f"{package}.{folder}"), name).get_fields_and_field_types()[field.partition("[")[0]]
        element = re.fullmatch(r"sequence<([^,>]+).*>|([^\[]+)\[\d+\]", found)
        assert ("[" in field) == (element is not None), field
        kind = next(filter(None, element.groups())) if element else found
        kind = kind if kind.count("/") != 1 else kind.replace("/", "/msg/")
    return kind


def paths(config):
    """Return the message paths of a panel; a number is a line at a height."""
    return [each["value"] for each in config.get("paths", ()) if not re.fullmatch(r"[\d.]+", each["value"])]


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
        "/markers": layouts.BaseRendererRosMarkerTopicSettings,
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
    for each in config.get("paths", ()):
        require_known(each, series[kind])
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
    (line,) = (float(each["value"]) for each in plot["paths"] if each["label"] == "95 %")
    assert line == pytest.approx(chi2.ppf(0.95, 3), abs=0.01)
    assert f"{line:.2f}" in plot["foxglovePanelTitle"]
    message = conversion(Nis).write(Nis(1.25), Header())
    assert float(message.status[0].values[0].value) == 1.25


def test_plotjuggler_plots_what_there_is(types):
    curves = [*PLOTJUGGLER.iter("curve")]
    names = {each.get("curve_x") or each.get("name") for each in curves} | {each.get("curve_y") for each in curves} - {None}
    for name in names:
        _, topic, *fields = name.split("/")
        kind = types[f"/{topic}"]
        if kind == "diagnostic_msgs/msg/DiagnosticArray":  # it names them by hardware, name and key
            (status,) = conversion(Nis).write(Nis(1.0), Header(frame_id=Common().body)).status
            assert fields == [status.hardware_id, status.name, status.values[0].key]
        else:
            assert field_type(kind, fields) in ("double", "float"), name
    assert {"/estimate/pose/pose/position/x", "/cmd_vel/twist/linear/x"} <= names


def test_plotjuggler_shares_out_the_room():
    for splitter in PLOTJUGGLER.iter("DockSplitter"):
        shares = [float(share) for share in splitter.get("sizes", "").split(";")]
        assert len(shares) == int(splitter.get("count", "")) == len(splitter.findall("DockArea"))
        assert sum(shares) == pytest.approx(1.0, abs=1e-5)

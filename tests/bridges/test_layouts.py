"""The layout for Foxglove shows what there is."""

import json
import re
from importlib import import_module
from pathlib import Path

import pytest
from bench import said_types
from scipy.stats import chi2
from std_msgs.msg import Header

from turtlebot_gym_ros.base.frames import Common
from turtlebot_gym_ros.node.block import Nis
from turtlebot_gym_ros.node.convert import conversion

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

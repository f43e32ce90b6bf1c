"""The graph as a picture and its state as a table: what is declared is what is connected, and all can be read."""

import itertools

import pytest
from bench import node
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text
from nav_msgs.msg import Odometry
from rclpy.qos import qos_profile_sensor_data

from turtlebot_gym_ros import Graph
from turtlebot_gym_ros.graph.diagram import PLACES, WORDS, Connection, connected, declared, draw
from turtlebot_gym_ros.graph.status import _table
from turtlebot_gym_ros.nodes import BLOCKS, MODES, NODES

LOOP = MODES["autonomous"]
ODOMETRY = "nav_msgs/msg/Odometry"
GUARDED = (*LOOP, "simulated_teleop", "cmd_vel_guard", "data_logger", "visualization")


def test_a_topic_joins_who_says_it_with_all_who_hear_it():
    loop = declared(LOOP)
    assert {edge.subscriber for edge in loop if edge.topic == "/cmd_vel"} == {"turtlebot_simulator"}
    assert Connection("kalman_filter", "/estimate", ODOMETRY, "velocity_controller") in loop
    assert not [edge for edge in loop if edge.topic == "/true_state"]  # nobody in the loop knows the truth
    twist = {edge.message for edge in declared(LOOP, stamped=False) if edge.topic == "/cmd_vel"}
    assert twist == {"geometry_msgs/msg/Twist"}
    with pytest.raises(ValueError, match=r"names must be .* got 'pilot'"):
        declared(["pilot"])


def looped(connections):
    """Return connections without that by which the filter only compares its odometry with the command in force."""
    return {edge for edge in connections if (edge.topic, edge.subscriber) != ("/cmd_vel", "kalman_filter")}


@pytest.mark.parametrize("stamped", [True, False])
def test_what_is_declared_is_what_is_connected(stamped):
    expected = declared((*LOOP, "bringup"), stamped=stamped)
    with Graph(speed=None if stamped else 1.0, enable_stamped_cmd_vel=stamped):
        assert looped(connected(expected)) == expected


@pytest.mark.nightly
def test_a_guard_stands_between_and_recorder_and_display_change_nothing(launch, tmp_path):
    special = {
        "velocity_controller": ("-r", "cmd_vel:=cmd_vel_in"),
        "simulated_teleop": ("-r", "cmd_vel:=cmd_vel_teleop"),
        "data_logger": ("-p", f"output:={tmp_path / 'bag'}"),
    }
    expected = declared(GUARDED)
    for name in GUARDED:
        launch(*node(name, words=special.get(name, ())))
    assert looped(connected(expected, timeout=30.0)) == expected
    unwatched = {edge for edge in expected if edge.subscriber not in ("data_logger", "visualization")}
    assert unwatched == declared((*LOOP, "simulated_teleop", "cmd_vel_guard"))


def test_connections_are_of_those_who_can_understand_each_other(peer):
    peer.speak("fast", Odometry, qos_profile_sensor_data)
    peer.hear("fast", Odometry, 10)  # reliable: it will never hear a word
    peer.speak("slow", Odometry)
    peer.hear("slow", Odometry, qos_profile_sensor_data)
    assert connected(frozenset([Connection("peer", "/slow", ODOMETRY, "peer")])) == {
        Connection("peer", "/slow", ODOMETRY, "peer")
    }


def test_everything_has_a_place_and_a_word():
    assert {*BLOCKS, "cmd_vel_guard"} - {"visualization"} == PLACES.keys()
    names = (*PLACES, "data_logger", "bringup", "visualization")
    assert {*NODES, *(edge.topic for edge in declared(names))} == WORDS.keys()


def drawn(connections, **options):
    figure = Figure(figsize=(7.5, 5.3), layout="constrained")
    axes = draw(figure.subplots(), connections, **options)
    FigureCanvasAgg(figure).draw()
    return axes, [text for text in axes.findobj(Text) if text.get_text()]


@pytest.mark.parametrize("plain", [True, False])
@pytest.mark.parametrize(
    "names",
    [
        (*LOOP, "bringup"),
        (*LOOP, "cmd_vel_guard", "data_logger"),
        GUARDED,
        (*MODES["teleoperation"], "simulated_teleop", "bringup"),
    ],
    ids=["loop", "guarded", "all", "teleoperation"],
)
def test_no_text_hides_another_or_leaves_its_box(names, plain):
    axes, texts = drawn(declared(names), plain=plain)
    extents = [text.get_window_extent() for text in texts]
    for (one, here), (other, there) in itertools.combinations(zip(texts, extents, strict=True), 2):
        assert not here.overlaps(there), (one.get_text(), other.get_text())
    inside = axes.figure.bbox
    boxes = [patch.get_window_extent() for patch in axes.patches if hasattr(patch, "get_boxstyle")]
    for text, extent in zip(texts, extents, strict=True):
        for frame in [inside, *(box for box in boxes if box.overlaps(extent))]:
            assert frame.x0 <= extent.x0 < extent.x1 <= frame.x1, text.get_text()
    assert len(boxes) == len(names)


def test_a_label_names_topics_and_their_type_or_plain_words():
    _, texts = drawn(declared(LOOP))
    assert "/reference\n/next_reference\nPoseStamped" in [text.get_text() for text in texts]
    _, texts = drawn(declared(LOOP), plain=True)
    assert "waypoint\nnext waypoint" in [text.get_text() for text in texts]


def test_nodes_that_nobody_knows_are_drawn_too():
    own = Connection("my_planner", "/reference", "geometry_msgs/msg/PoseStamped", "velocity_controller")
    far = Connection("talker", "/chatter", "std_msgs/msg/String", "listener")
    for connections, names in (({own}, {"my_planner", "velocity_controller"}), ({far}, {"talker", "listener"})):
        _, texts = drawn(frozenset(connections))
        assert names <= {text.get_text() for text in texts}


LONG = "waits for /reference, for /estimate since 12.5 s, and for a listener on /cmd_vel: no step was answered since 3.25 s"
REPORTS = {"velocity_controller": (1, LONG), "kalman_filter": (0, "ok"), "turtlebot_simulator": (3, "")}


def test_a_pipe_has_a_line_for_each_node():
    lines = _table(REPORTS, width=None)
    assert lines == [
        "node                 level    says",
        f"velocity_controller  warning  {LONG}",
        "kalman_filter        ok       ok",
        "turtlebot_simulator  stale",
    ]


def test_a_narrow_terminal_wraps_between_words():
    lines = _table(REPORTS, width=80)
    assert max(map(len, lines)) <= 80
    assert len(lines) > 4
    assert " ".join(" ".join(lines[1:-2]).split()) == f"velocity_controller warning {LONG}"
    assert all(line.startswith(30 * " ") for line in lines[2:-2])

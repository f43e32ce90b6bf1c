"""pykal's ``ROSNode`` here: its arrays and rules, and the two architectures of its notebook on this package's nodes, live."""

import re
import time
from types import SimpleNamespace

import numpy as np
import pytest
import rclpy
import seed_nodes as seed
from bench import wait_for
from geometry_msgs.msg import PolygonStamped, PoseStamped, Twist
from nav_msgs.msg import Odometry
from rclpy.qos import QoSProfile
from rclpy.time import Time

from turtlebot_gym_ros import ROSNode, Shell
from turtlebot_gym_ros.base.names import message_type
from turtlebot_gym_ros.blocks import KalmanFilter, TurtlebotSimulator
from turtlebot_gym_ros.node import stale
from turtlebot_gym_ros.node.arrays import ARRAYS, read_array, size_of, write_array

INSTALLED = [name for name in ARRAYS if not name.startswith("turtlesim")]
SIZES = {"Pose": 7, "PoseStamped": 8, "TransformStamped": 8, "Twist": 6, "TwistStamped": 7, "Vector3Stamped": 4, "Wrench": 6}
SIZES |= {"Accel": 6, "AccelStamped": 7, "Odometry": 13, "Imu": 10, "Float64": 1}
"""Sizes of pykal's arrays."""


@pytest.mark.parametrize("name", INSTALLED)
def test_an_array_becomes_a_message_and_back(name):
    fields, kind = ARRAYS[name], message_type(name)
    size = size_of(fields)
    assert size == SIZES.get(name.rpartition("/")[2])
    numbers = np.arange(1.0, 1.0 + (size or 4))
    np.testing.assert_array_equal(read_array(write_array(numbers, kind(), fields), fields), numbers)


def test_odometry_is_in_pykals_order():
    message = Odometry()
    message.pose.pose.position.y, message.pose.pose.orientation.w, message.twist.twist.angular.z = 1.0, 2.0, 3.0
    assert read_array(message, ARRAYS["nav_msgs/msg/Odometry"]).nonzero()[0].tolist() == [1, 6, 12]


def node_of(callback, clock, **options):
    """Return a node without ROS, whose clock is a list with the present time, s."""
    node = ROSNode(node_name="node", callback=callback, subscribes_to=[("/a", PoseStamped, "a"), ("/b", Twist, "b")], **options)
    ros = SimpleNamespace(now=lambda: Time(seconds=1000.0 + clock[0]))
    node.shell, node._begun = SimpleNamespace(node=SimpleNamespace(get_clock=lambda: ros)), Time(seconds=1000.0)
    return node


def hear(node, name, kind, stamp=None):
    """Let a message of ones arrive."""
    _, type_name, received = node.received[name]
    numbers = np.ones(size_of(ARRAYS[type_name]))
    if stamp is not None:
        numbers[0] = 1000.0 + stamp
    received.read(write_array(numbers, kind(), ARRAYS[type_name]))


@pytest.fixture
def clock(monkeypatch):
    now = [0.0]
    monkeypatch.setattr(stale.time, "monotonic", lambda: now[0])
    return now


@pytest.mark.parametrize("policy", ["zero", "hold", "drop"])
@pytest.mark.parametrize("by_header", [False, True])
def test_what_is_stale_is_zero_held_or_dropped(policy, by_header, clock):
    seen = []
    node = node_of(
        lambda tk, b, a=None: seen.append((tk, a)),
        clock,
        stale_config={"a": {"after": 0.5, "policy": policy, "use_header_stamp": by_header}},
    )
    hear(node, "b", Twist)
    node.call()
    assert seen.pop()[1] is None  # it has never arrived
    hear(node, "a", PoseStamped, stamp=-0.4)
    for clock[0], is_fresh in ((0.0, True), (0.2, not by_header), (0.6, False)):
        node.call()
        tk, a = seen.pop()
        assert tk == pytest.approx(clock[0])
        expected = 1.0 if is_fresh or policy == "hold" else 0.0
        if policy == "drop" and not is_fresh:
            assert a is None
        else:
            assert a[1:].tolist() == [expected] * 7


def test_a_callback_is_skipped_without_what_it_requires_and_errors_are_told(clock):
    told = []

    def callback(tk, b, a=None):
        raise KeyError("nothing")

    node = node_of(
        callback,
        clock,
        required_topics={"a"},
        error_callback=lambda context, error: told.append((context, type(error).__name__)),
        heartbeat_config={"b": 1.0},
    )
    assert node.call() == ("required_topics: ValueError: waits for a, b", {})
    hear(node, "a", PoseStamped)
    assert node.call()[0] == "required_topics: ValueError: waits for b"  # it has no default
    hear(node, "b", Twist)
    clock[0] = 2.0
    assert node.call()[0] == "callback: KeyError: 'nothing'"
    assert told == [("required_topics", "ValueError")] * 2 + [("heartbeat:b", "TimeoutError"), ("callback", "KeyError")]
    counts = node.get_diagnostics()
    assert (counts["callback_errors"], counts["topics"]["b"]["msg_count"]) == (1, 1)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"subscribes_to": [("/a", PolygonStamped, "a")]}, "There is no array for geometry_msgs/msg/PolygonStamped"),
        ({"subscribes_to": [("/a", "Twist", "a")]}, "must be a class of messages"),
        ({"subscribes_to": [("/a", Twist)]}, "each of subscribes_to must be (topic, message type, argument)"),
        ({"subscribes_to": [("/a", Twist, "a"), ("/a", Twist, "a2")]}, "names /a 2 times"),
        ({"publishes_to": [("x", Twist, "/x"), ("y", Twist, "/x")]}, "publishes_to must name each topic once"),
        ({"required_topics": {"b"}}, "required_topics must be arguments of subscribes_to (a), got 'b'"),
        ({"stale_config": {"b": {"after": 1.0}}}, "stale_config must be arguments"),
        ({"stale_config": {"a": {"after": 1.0, "policy": "zeros"}}}, "Did you mean 'zero'"),
        ({"stale_config": {"a": {"aftr": 1.0}}}, "Did you mean 'after'"),
        ({"rate_hz": 0.0}, "rate_hz must be a positive number"),
        ({"callback": lambda a: {}}, "first argument is tk"),
        ({"callback": lambda tk, c: {}}, "arguments of subscribes_to (a), got 'c'"),
        ({"qos_profile": QoSProfile(depth=1)}, "qos_profile must be None"),
        ({"use_single_threaded_executor": False}, "use_single_threaded_executor must be True"),
    ],
)
def test_what_is_not_supported_is_refused_in_one_line(options, message):
    given = {"node_name": "node", "callback": lambda tk, **arrays: {}, "subscribes_to": [("/a", Twist, "a")], **options}
    with pytest.raises(ValueError, match=re.escape(message)) as caught:
        ROSNode(**given)
    assert "\n" not in str(caught.value)


@pytest.fixture
def live(runner):
    """Run nodes of this package, and then the notebook's, which are stopped at the end."""
    shells, nodes = [], []

    def start(ours, theirs):
        rclpy.init()
        for kind, options in ours.items():
            overrides = {"enable_stamped_cmd_vel": False, "robot": "tutorial", "noise": "tutorial", **options}
            shells.append(Shell(kind, kind.Params, context=runner.context, overrides=overrides))
            runner.add(shells[-1])
        nodes.extend(theirs)
        for node in nodes:
            node.create_node()
        for node in nodes:
            node.start()

    yield start
    for node in nodes:
        node.stop()
    rclpy.shutdown()


def errors(log):
    """Return the mean errors of the estimate and of odometry, m."""
    truth, *others = (np.array(log[name])[:, :2] for name in ("true_state", "estimate", "odom"))
    return [np.hypot(*(other - truth).T).mean() for other in others]


def drive_autonomously(live, duration, waypoints=seed.SQUARE):
    """Return the log of their waypoints and controller on our plant and filter."""
    logger, log = seed.logger_node("reference", "cmd_vel", "true_state", "odom", "estimate")
    controller = seed.controller_node()
    ours = {TurtlebotSimulator: {}, KalmanFilter: {}}
    live(ours, [seed.waypoint_node(waypoints), controller, logger])
    wait_for(lambda: log["time"] and log["time"][-1] - log["time"][0] > duration, duration + 10.0)
    controller.stop()
    wait_for(lambda: not log["cmd_vel"][-1].any())
    return log


def drive_by_hand(live, duration):
    """Return the log of their teleoperation on their simulator with our filter, which must not read their twist."""
    logger, log = seed.logger_node("cmd_vel", "true_state", "odom", "estimate")
    live({KalmanFilter: {"twist": "commanded"}}, [seed.simulator_node(), seed.teleop_node(), logger])
    wait_for(lambda: log["time"] and log["time"][-1] - log["time"][0] > duration, duration + 10.0)
    return log


def test_their_controller_drives_our_plant_and_stops_it(live):
    log = drive_autonomously(live, 3.0, [(1.0, 0.0, 0.0)])
    estimate, odometry = errors(log)
    assert estimate < 0.5 * odometry
    assert 0.4 < log["true_state"][-1][0] < 1.0
    assert max(command[0] for command in log["cmd_vel"]) == 0.22


def test_our_filter_estimates_on_their_simulator(live):
    estimate, odometry = errors(drive_by_hand(live, 4.0))
    assert estimate < 0.6 * odometry


@pytest.mark.nightly
def test_the_first_architecture_of_the_notebook_drives_the_square(live):
    log = drive_autonomously(live, 60.0)
    estimate, odometry = errors(log)
    assert estimate < 0.1 < 0.25 < odometry
    truth = np.array(log["true_state"])[:, :2]
    assert np.hypot(*(truth - [2.0, 0.0]).T).min() < 0.1  # the first waypoint lies ahead
    headings = np.array([seed.heading(*pose[5:7]) for pose in log["true_state"]])
    for k, (_, _, wanted) in enumerate(seed.SQUARE):  # it turns to each, as the tutorial's law does
        at = np.searchsorted(log["time"], 15.0 * k + 12.0)
        assert abs(np.angle(np.exp(1j * (headings[at] - wanted)))) < 0.3


@pytest.mark.nightly
def test_the_second_architecture_of_the_notebook_is_driven_by_hand(live):
    log = drive_by_hand(live, 31.0)
    estimate, odometry = errors(log)
    assert estimate < 0.1 < 0.25 < odometry
    steps = np.diff(np.array(log["true_state"])[:, :2], axis=0)
    assert np.hypot(*steps.T).sum() == pytest.approx(0.15 * 27.0, abs=0.1)


def test_it_starts_again_and_counts(live):
    calls = []
    node = ROSNode(node_name="counter", callback=lambda tk: calls.append(tk), rate_hz=50.0)
    live({}, [node])
    wait_for(lambda: len(calls) > 5)
    node.stop()
    assert not node.is_running()
    before = len(calls)
    time.sleep(0.1)
    assert len(calls) == before
    node.start()
    wait_for(lambda: len(calls) > before + 5)
    assert calls[-1] < 5.0
    assert node.get_diagnostics()["callback_count"] == len(calls)


def test_it_ends_quietly_when_rclpy_is_shut_down_first(launch):
    script = (
        "import time, rclpy, numpy as np\nfrom geometry_msgs.msg import Twist\nfrom turtlebot_gym_ros import ROSNode\n"
        "node = ROSNode(node_name='a', callback=lambda tk: {'c': np.ones(6)}, publishes_to=[('c', Twist, '/cmd_vel')])\n"
        "node.start()\ntime.sleep(0.3)\nrclpy.shutdown()\ntime.sleep(0.3)\nprint(node.is_running())\nnode.stop()\n"
    )
    process = launch("-c", script)
    out, err = process.communicate(timeout=30.0)
    assert (out, process.returncode) == ("False\n", 0)
    assert "Traceback" not in err

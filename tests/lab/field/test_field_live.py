"""The field test as a person runs it, with real nodes: each fault of a robot in turn, and an afternoon without one."""

import json
import math
import signal

import pytest
from geometry_msgs.msg import TwistStamped
from nav_msgs.msg import Odometry
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import LaserScan
from std_msgs.msg import Bool

from turtlebot_gym import read_parameters
from turtlebot_gym.parameters import Noise
from turtlebot_gym_lab.field.findings import FINE, REFUSED, WARNING
from turtlebot_gym_lab.field.measured import MeasuredDrive
from turtlebot_gym_lab.field.session import COMMANDS, Part, TopicListener, _running

QUICK = ["--seconds", "1", "--distance", "0.3", "--turn", "40", "--side", "0.2", "--duration", "0"]


@pytest.mark.nightly
def test_an_afternoon_with_a_robot_that_speaks_as_a_recorded_one(launch, tmp_path):
    """Its wheels turn less than they say; the test finds that, and writes it into the noise file."""
    (tmp_path / "wheels.yaml").write_text("process: {scale: 0.9, alpha1: 0.0003, alpha4: 0.0003}\nodometry: {wheel: true}\n")
    out = tmp_path / "out"
    options = ["--simulate", "turtlebot3", "--noise", str(tmp_path / "wheels.yaml"), "--out", str(out)]
    process = launch("-m", "turtlebot_gym_ros", "field_test", *options, *QUICK)
    said, errors = process.communicate(timeout=180)
    findings = {finding["name"]: finding for finding in json.loads((out / "findings.json").read_text())}
    assert process.returncode == 0, f"{said}\n{errors}"
    assert 0.7 < findings["clock of /odom"]["figures"][0]["value"] < 0.8
    assert findings["a straight"]["verdict"] == WARNING
    scale = {figure["name"]: figure["value"] for figure in findings["by tape"]["figures"]}["scale"]
    assert scale == pytest.approx(0.9, abs=0.01)
    assert read_parameters(Noise, out / "noise.yaml").process.scale < 0.97
    assert findings["a square"]["verdict"] == FINE
    assert findings["calibration drive"]["text"] == "Left out: --duration is 0."
    assert {path.name for path in out.iterdir()} >= {"bag", "report.html", "noise.yaml"}


def test_the_nodes_of_a_drive_are_in_the_context_that_knows_the_emergency_stop(runner):
    """Those of a new one may be deaf to it for seconds."""
    part = Part(MeasuredDrive, "field_drive", {}, COMMANDS)
    with _running(TopicListener(runner), [part], stamped=True) as (shell,):
        assert shell.node.context is runner.context


@pytest.mark.nightly
def test_an_interruption_stops_the_robot_and_leaves_a_report(launch, peer, wait_for, tmp_path):
    wheels = peer.hear("cmd_vel", TwistStamped)
    options = ["--simulate", "turtlebot3", "--out", str(tmp_path / "out"), "--distance", "5", "--seconds", "1"]
    process = launch("-m", "turtlebot_gym_ros", "field_test", *options)
    wait_for(lambda: any(velocity.twist.linear.x > 0.1 for velocity in list(wheels)), patience=90.0)
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=60)
    assert process.returncode == 1
    assert wheels[-1].twist.linear.x == 0.0
    texts = {finding["name"]: finding["text"] for finding in json.loads((tmp_path / "out" / "findings.json").read_text())}
    assert texts["the end"] == "It was interrupted: the robot was stopped."
    assert "a straight" not in texts


@pytest.fixture
def field_test(launch, peer, tmp_path):
    """Run the test on a simulated TurtleBot3 with nodes and a button, and return its verdicts, which hold that none moved."""

    def run(simulator=(), guards=("cmd_vel_guard", "cmd_vel_standby"), has_button=True):
        for node, options in (
            ("turtlebot_simulator", ("-p", "world:=dense", *simulator)),
            *((name, ()) for name in guards),
        ):
            launch("-m", "turtlebot_gym_ros", node, "--ros-args", *options)
        wheels = peer.hear("cmd_vel", TwistStamped)
        if has_button:
            button = peer.speak("emergency_stop", Bool)
            peer.node.create_timer(0.05, lambda: button.publish(Bool()))
        (tmp_path / "answers.yaml").write_text("press: false\n")
        options = ["--yes", "--answers", str(tmp_path / "answers.yaml"), "--out", str(tmp_path / "out"), *QUICK]
        launch("-m", "turtlebot_gym_ros", "field_test", *options).communicate(timeout=120)
        assert all(velocity.twist.linear.x == velocity.twist.angular.z == 0.0 for velocity in wheels)
        return {finding["name"]: finding["verdict"] for finding in json.loads((tmp_path / "out" / "findings.json").read_text())}

    return run


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("fault", "refused"),
    [
        ({"has_button": False}, "emergency stop"),
        ({"simulator": ("-p", "enable_stamped_cmd_vel:=false")}, "wheels"),
        ({"guards": ()}, "guard"),
    ],
)
def test_a_robot_whose_nodes_are_wrong_does_not_move(field_test, fault, refused):
    assert field_test(**fault)[refused] == REFUSED


def ahead(message):
    message.header.stamp.sec += 2


def half_blind(message):
    half = len(message.ranges) // 2
    message.ranges = [math.nan] * half + list(message.ranges[half:])


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("topic", "spoil", "name", "verdict"),
    [("odom", ahead, "clock of /odom", REFUSED), ("scan", half_blind, "scans", WARNING)],
)
def test_a_fault_of_what_a_driver_sends_is_named(field_test, peer, topic, spoil, name, verdict):
    """The messages pass through the peer, which spoils them; every fault: `test_field`."""
    kind = {"odom": Odometry, "scan": LaserScan}[topic]
    speaker = peer.speak(topic, kind, qos_profile_sensor_data if topic == "scan" else 10)

    def pass_on(message):
        spoil(message)
        speaker.publish(message)

    peer.node.create_subscription(kind, f"sound/{topic}", pass_on, qos_profile_sensor_data)
    assert field_test(simulator=("-p", "world:=dense", "-r", f"{topic}:=sound/{topic}"))[name] == verdict

"""The guard as a real process on real DDS; what it decides is tested in test_arbiter and test_collision."""

import math
import signal
import time
from functools import partial

import pytest
from burger import WORDS
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import TwistStamped
from nav_msgs.msg import Odometry
from probe import AHEAD, Probe, laser
from sensor_msgs.msg import LaserScan
from std_msgs.msg import Empty, String

from cmd_vel_guard.qos import LATCHED
from cmd_vel_guard.values import STOP, Command


@pytest.fixture
def probe(peer, wait_for):
    return Probe(peer, wait_for)


@pytest.fixture
def start(launch):
    """Start a guard as a process."""

    def start(*arguments):
        return launch("-m", "cmd_vel_guard", "cmd_vel_guard", "--ros-args", *WORDS, *arguments)

    return start


def sabotaged(change):
    """Return the arguments of a Python that runs a guard with a change to its module."""
    return "-c", f"from cmd_vel_guard import guard\n{change}\nraise SystemExit(guard.main())", "--ros-args", *WORDS


@pytest.mark.parametrize("number", [pytest.param(signal.SIGINT, marks=pytest.mark.slow), signal.SIGTERM])
def test_a_signal_sends_zeros_and_ends_in_order(start, probe, number):
    process = start()
    probe.until_driving()
    process.send_signal(number)
    assert process.wait(timeout=2.0) == 0
    probe.until(lambda: probe.heard[-1] == STOP)


@pytest.mark.parametrize(
    ("change", "topic"),
    [
        ("guard.CmdVelGuard._hear_button = lambda *_, **__: 1 / 0", "/emergency_stop"),  # whichever callback takes the message
        ("guard.Arbiter.hear_odometry = lambda *_, **__: 1 / 0", "/odom"),
    ],
)
def test_a_message_that_causes_an_error_ends_no_guard_and_stops_the_robot(launch, probe, peer, change, topic):
    process = launch(*sabotaged(change))
    probe.until_driving()
    if topic == "/odom":
        peer.speak("odom", Odometry).publish(Odometry())
        probe.node.create_timer(0.1, partial(peer.speak("odom", Odometry).publish, Odometry()))
    else:
        probe.pressed = False
    status = probe.until_standing(f"a message could not be handled: {topic}: ZeroDivisionError")
    assert status.level == DiagnosticStatus.ERROR
    assert process.poll() is None


@pytest.fixture
def driving(start, launch, probe):
    """A guard as on a robot, which must have its standby and a button, and drives."""

    def begin():
        standby = launch("-m", "cmd_vel_guard", "cmd_vel_standby")
        guard = start("-p", "require_standby:=true", "-p", "require_emergency_stop:=true")
        probe.command = AHEAD
        probe.until_standing("no emergency stop is heard")
        assert "no emergency stop is heard" in probe.enable(True).message
        probe.pressed = False
        probe.until_driving()
        return guard, standby

    return begin


SUSPENDS = """
import os, signal
decide = guard.Arbiter.step

def step(self, now):
    command = decide(self, now)
    if command not in (None, guard.STOP) and os.path.exists("suspend"):
        os.remove("suspend")
        os.kill(os.getpid(), signal.SIGSTOP)
    return command

guard.Arbiter.step = step
"""


def test_a_motion_that_was_decided_before_a_suspension_is_not_published_after_it(launch, probe, tmp_path):
    process = launch(*sabotaged(SUSPENDS))
    probe.until_driving()
    (tmp_path / "suspend").touch()
    probe.until(lambda: not (tmp_path / "suspend").exists())
    probe.command = None
    time.sleep(0.6)  # beyond max_age
    probe.heard.clear()
    process.send_signal(signal.SIGCONT)
    probe.until(lambda: probe.heard)
    time.sleep(0.2)
    assert set(probe.heard) == {STOP}


@pytest.mark.parametrize("number", [signal.SIGKILL, pytest.param(signal.SIGSTOP, marks=pytest.mark.slow)])
def test_the_standby_sends_zeros_soon_after_the_last_command_of_a_guard_that_dies(driving, probe, number):
    guard, _ = driving()
    probe.heard.clear()
    probe.sent.clear()
    probe.until(lambda: AHEAD in probe.heard)
    guard.send_signal(number)
    zero = probe.until(lambda: probe.heard.index(STOP) if STOP in probe.heard else 0)
    assert probe.sent[zero] - probe.sent[zero - 1] < 0.5  # 0.2 s where it was measured
    time.sleep(1.5)
    assert set(probe.heard[zero:]) == {STOP}


def test_without_its_standby_the_guard_stands_and_goes_on_with_it(driving, launch, probe):
    _, standby = driving()
    standby.kill()
    probe.until_standing("cmd_vel_standby is not alive")
    launch("-m", "cmd_vel_guard", "cmd_vel_standby")
    probe.until_standing("but has also /cmd_vel_standby")  # DDS takes the killed one for alive, for up to 20 s
    probe.until(lambda: probe.node.count_publishers("cmd_vel_standby/alive") == 1)
    probe.until_driving()


def test_emergency_stop(start, probe):
    start()
    probe.until_driving()
    probe.pressed = True
    probe.until_standing("emergency")
    answer = probe.enable(True)
    assert (answer.success, answer.message) == (False, "the emergency stop is pressed")
    probe.pressed = False
    probe.until(lambda: probe.enable(True).success)
    probe.until_driving()
    for pressed in (True, False):  # however short
        probe.press(pressed)
    probe.until_standing("emergency")
    probe.pressed = None
    assert "~/enable" not in probe.until_standing("emergency").message  # the service is named as one types it


SOURCES = {
    "cmd_vel_in": TwistStamped,
    "cmd_vel_teleop": TwistStamped,
    "cmd_vel_standby/alive": Empty,
    "scan": LaserScan,
    "odom": Odometry,
    "disagreement": String,
}


@pytest.mark.parametrize("topic", [*(pytest.param(each, marks=pytest.mark.slow) for each in SOURCES if each != "scan"), "scan"])
def test_a_second_source_of_an_input_stops_the_robot_until_it_is_gone(start, launch, probe, peer, topic):
    launch("-m", "cmd_vel_guard", "cmd_vel_standby")
    start("-p", "collision_monitor:=true", "-p", "require_standby:=true", "-p", "heed_disagreement:=true")
    qos = LATCHED if topic == "disagreement" else 1
    first = peer.node.create_publisher(SOURCES[topic], topic, qos) if topic in ("odom", "disagreement") else None
    probe.scan = laser()
    probe.until_driving()
    rival = peer.node.create_publisher(SOURCES[topic], topic, qos)  # it need not say anything
    probe.until(lambda: rival.get_subscription_count() > 0)
    found = time.time()
    status = probe.until_standing(f"/{topic} must have one source, so the robot stands: end all but one of ", "/peer")
    assert status.level == DiagnosticStatus.ERROR
    published = zip(reversed(probe.sent), reversed(probe.heard), strict=False)
    assert max((at for at, command in published if command != STOP), default=0.0) < found + 0.5
    peer.node.destroy_publisher(rival)
    probe.until_driving()
    assert first is None or first.get_subscription_count()


@pytest.mark.parametrize(("first", "second"), [("cmd_vel", "cmd_vel_in"), ("cmd_vel_in", "cmd_vel_teleop")])
def test_a_guard_that_would_hear_itself_or_one_source_twice_is_refused(start, first, second):
    process = start("-r", f"{second}:={first}")
    _, stderr = process.communicate(timeout=30.0)
    assert (process.returncode, stderr) == (
        2,
        f"error: {first} and {second} must be different topics, got /{first} for both.\n",
    )


def test_a_disagreement_stops_the_robot_until_it_is_enabled(start, probe, peer):
    start("-p", "heed_disagreement:=true")
    filter_says = peer.node.create_publisher(String, "disagreement", LATCHED)
    filter_says.publish(String(data=""))
    probe.until_driving()
    filter_says.publish(String(data="the twist is in the world's frame"))
    probe.until_standing("the twist is in the world's frame; then: ros2 service call /cmd_vel_guard/enable")
    filter_says.publish(String(data=""))
    probe.until_standing("the twist is in the world's frame")
    assert probe.enable(True).success
    probe.until_driving()


# The collision monitor: scans at 5 Hz, commands from a person and from a program.


@pytest.fixture
def seeing(start):
    return start("-p", "collision_monitor:=true")


def see(probe):
    probe.scan, probe.scan_age = laser(), 0.0
    probe.until_driving()


def test_commands_are_limited_by_what_the_lidar_sees_and_need_its_scans(seeing, probe):
    probe.command, probe.topic = AHEAD, "cmd_vel_teleop"
    assert probe.until_standing("/scan: no scan has arrived").level == DiagnosticStatus.ERROR
    see(probe)
    for probe.topic, who in (("cmd_vel_teleop", "teleop"), ("cmd_vel_in", "program")):
        # 0.24 m from the LiDAR, 0.232 m from the footprint's centre: less the radius, the margin and the error, in one second.
        probe.scan = laser(0.24)
        status = probe.until_reported(f"{who}, collision monitor: slowed down: an obstacle is ahead")
        assert status.level == DiagnosticStatus.WARN
        v, omega = probe.until_told(lambda each: each.v > 0.02)
        assert v <= 0.232 - 0.105 - 0.05 - 0.085 * 0.24 + 1e-6
        assert omega / v == pytest.approx(2.0)
        probe.scan = laser(0.16)
        probe.until_standing("stopped: an obstacle is in the stop zone")
        probe.command = Command(-0.1, 0.0)
        probe.until_told(lambda each: each.v == pytest.approx(-0.05, abs=1e-9))
        assert min(command.v for command in probe.heard) > -0.0501
        see(probe)
    probe.scan = laser(ranges=[math.nan] * 360)
    refused = "collision monitor: /scan: a scan was refused: none of the scan's 360 beams says anything"
    assert "\n" not in probe.until_standing(refused).message
    see(probe)
    probe.scan = None
    probe.until_standing("the last scan is older than 0.4 s; the robot stands")
    see(probe)
    probe.scan_age = 0.7  # by its stamp, which may be that of the first beam, 0.2 s before the last
    probe.until_standing("the last scan is older than 0.4 s")
    probe.scan_age = 0.5
    probe.until_told(lambda each: each != STOP)
    assert seeing.poll() is None

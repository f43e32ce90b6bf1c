"""The guard as a real process on real DDS; what it decides is tested in test_arbiter."""

import signal
import time

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import Twist, TwistStamped
from nav_msgs.msg import Odometry
from rcl_interfaces.srv import DescribeParameters
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import Bool
from std_srvs.srv import SetBool

from turtlebot_gym.values import STOP, Command

AHEAD = Command(0.1, 0.2)


class Probe:
    """The robot, whoever commands it, and whoever reads the diagnostics."""

    def __init__(self, peer, wait_for, stamped=True):
        self.node, self.ask, self.until = peer.node, peer.ask, wait_for
        self.type = TwistStamped if stamped else Twist
        self.heard, self.reports, self.command, self.pressed = [], [], None, None
        self.node.create_subscription(self.type, "cmd_vel", self._hear, 1000)
        self.node.create_subscription(DiagnosticArray, "diagnostics", lambda m: self.reports.extend(m.status), 10)
        self.speaker, self.button = peer.speak("cmd_vel_in", self.type, 1), peer.speak("emergency_stop", Bool, 1)
        self.node.create_timer(0.05, self._speak)

    def _hear(self, message):
        twist = message.twist if self.type is TwistStamped else message
        self.heard.append(Command(twist.linear.x, twist.angular.z))

    def _speak(self):
        if self.command is not None:
            message = self.type()
            twist = message.twist if self.type is TwistStamped else message
            twist.linear.x, twist.angular.z = self.command
            self.speaker.publish(message)
        if self.pressed is not None:
            self.button.publish(Bool(data=self.pressed))

    def until_reported(self, *texts):
        self.reports.clear()
        return self.until(
            lambda: next((each for each in list(self.reports) if all(text in each.message for text in texts)), None)
        )

    def until_driving(self):
        self.heard.clear()
        self.command = AHEAD
        self.until(self._drives)

    def _drives(self):
        if self.pressed is False:
            self.enable(True)  # again, where a busy machine kept the button silent for too long
            time.sleep(0.5)  # an enabled guard has forgotten what was said before
        return AHEAD in self.heard

    def enable(self, on):
        return self.ask("/cmd_vel_guard/enable", SetBool, SetBool.Request(data=on))


@pytest.fixture
def probe(peer, wait_for):
    return Probe(peer, wait_for)


@pytest.fixture
def start(launch):
    """Start a guard as a process."""

    def start(*arguments):
        return launch("-m", "turtlebot_gym_ros", "cmd_vel_guard", "--ros-args", *arguments)

    return start


def sabotaged(change):
    """Return the arguments of a Python that runs a guard with a change to its module."""
    return "-c", f"from turtlebot_gym_ros.robot import guard\n{change}\nraise SystemExit(guard.main())"


def after_driving(heard):
    return heard[max(k for k, command in enumerate(heard) if command != STOP) + 1 :]


def test_passes_then_stops_then_is_silent_without_a_clock(start, probe):
    start("-p", "use_sim_time:=true", "-p", "max_acceleration:=3")  # an integer is accepted for a float
    probe.until(lambda: probe.heard)
    assert set(probe.heard) == {STOP}  # whatever the robot held before
    probe.until_driving()
    probe.command = None
    probe.until_reported("silent")
    stopped = after_driving(probe.heard)
    assert len(stopped) > 10
    assert set(stopped) == {STOP}


def test_unstamped(start, peer, wait_for):
    start("-p", "enable_stamped_cmd_vel:=false")
    Probe(peer, wait_for, stamped=False).until_driving()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_sends_zeros_and_ends_in_order(start, probe, number):
    process = start()
    probe.until_driving()
    process.send_signal(number)
    assert process.wait(timeout=2.0) == 0
    probe.until(lambda: probe.heard[-1] == STOP)
    assert set(after_driving(probe.heard)) == {STOP}


def test_a_signal_without_the_last_zeros_is_noticed(launch, probe):
    process = launch(*sabotaged("guard.CmdVelGuard.close = lambda self: None"))
    probe.until_driving()
    process.send_signal(signal.SIGTERM)
    assert process.wait(timeout=10.0) == 0
    probe.until(lambda: probe.node.count_publishers("cmd_vel") == 0)
    assert probe.heard[-1] == AHEAD


def test_its_death_is_not_covered_but_its_successor_stops_the_robot(start, probe):
    process = start()
    probe.until_driving()
    process.kill()
    process.wait()
    assert probe.heard[-1] == AHEAD  # and nobody takes it back
    probe.command = None
    probe.heard.clear()
    start()
    probe.until(lambda: len(probe.heard) > 10)
    assert set(probe.heard) == {STOP}


def test_emergency_stop(start, probe):
    start()
    probe.until_driving()
    probe.pressed = True
    probe.until_reported("emergency")
    assert set(after_driving(probe.heard)) == {STOP}
    answer = probe.enable(True)
    assert (answer.success, answer.message) == (False, "the emergency stop is pressed")
    probe.pressed = False
    probe.until(lambda: probe.enable(True).success)
    probe.until_driving()
    probe.pressed = None
    assert "~/enable" not in probe.until_reported("emergency").message  # the service is named as one types it
    assert set(after_driving(probe.heard)) == {STOP}


def test_it_can_start_disabled_and_says_whether_it_lets_pass(start, probe, peer):
    start("-p", "start_enabled:=false")
    passing = peer.hear("cmd_vel_guard/enabled", Bool, QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL))
    probe.command = AHEAD
    probe.until_reported("disabled")
    assert set(probe.heard) == {STOP}
    assert probe.enable(True).success
    probe.until_driving()
    probe.until(lambda: len(passing) == 2)
    assert [message.data for message in passing] == [False, True]


@pytest.mark.parametrize("topic", ["odom", "estimate"])
def test_geofence(start, probe, peer, topic):
    start("-p", "geofence:=1.0", "-p", f"geofence_topic:={topic}")
    probe.command = AHEAD
    probe.until_reported("only a person drives")
    assert set(probe.heard) == {STOP}
    pose, speaker = Odometry(), peer.speak(topic, Odometry)
    probe.node.create_timer(0.05, lambda: speaker.publish(pose))
    probe.until_driving()
    pose.pose.pose.position.y = -1.1
    probe.until_reported("only a person drives")
    assert set(after_driving(probe.heard)) == {STOP}


def test_a_second_publisher_is_an_error(start, probe):
    start()
    probe.until_driving()
    probe.node.create_publisher(TwistStamped, "cmd_vel", 1)
    assert probe.until_reported("one publisher", "/peer").level == DiagnosticStatus.ERROR  # names come later than data


def test_it_lives_through_every_change_of_what_it_reports(start, peer, wait_for):
    start()
    reports = []
    peer.node.create_subscription(DiagnosticArray, "diagnostics", lambda m: reports.extend(m.status), 10)

    def until_reported(text):
        reports.clear()
        return wait_for(lambda: next((status for status in list(reports) if text in status.message), None))

    assert until_reported("has no listener").level == DiagnosticStatus.WARN
    listener = peer.node.create_subscription(TwistStamped, "cmd_vel", lambda message: None, 1)
    assert until_reported("silent").level == DiagnosticStatus.OK
    other = peer.node.create_publisher(TwistStamped, "cmd_vel", 1)
    assert until_reported("one publisher").level == DiagnosticStatus.ERROR
    peer.node.destroy_publisher(other)
    assert until_reported("silent").level == DiagnosticStatus.OK
    peer.node.destroy_subscription(listener)
    assert until_reported("has no listener").level == DiagnosticStatus.WARN


def test_the_wrong_type_is_reported_with_what_to_type(start, peer, wait_for):
    start()
    said = ("/peer has geometry_msgs/msg/Twist on /cmd_vel", "-p enable_stamped_cmd_vel:=false")
    assert Probe(peer, wait_for, stamped=False).until_reported(*said).level == DiagnosticStatus.ERROR


@pytest.mark.parametrize(
    ("argument", "text"),
    [
        ("max_agee:=0.3", "cmd_vel_guard has no parameter 'max_agee': did you mean max_age?"),
        ("max_age:=0.6", "max_age must be a number above 0 and at most 0.5 s, got 0.6"),
        ("rate:=fast", "rate must be of type float, got 'fast'"),
        ("robot:=roomba", "robot must be one of burger, "),
    ],
)
def test_wrong_parameters_are_refused_before_anything_is_published(launch, argument, text):
    # Publishing would be an error of its own, and a traceback has more than one line.
    publishes = "guard.CmdVelGuard._publish = lambda *_: guard.math.nope"
    process = launch(*sabotaged(publishes), "--ros-args", "-p", argument)
    _, stderr = process.communicate(timeout=30.0)
    assert process.returncode == 2
    assert stderr.count("\n") == 1
    assert stderr.startswith(f"error: {text}")


def test_two_robots_in_namespaces_do_not_collide(start, peer, wait_for):
    for name in ("left", "right"):
        start("-r", f"__ns:=/{name}", "-p", f"body_frame:={name}/base_footprint")
    told = {name: peer.hear(f"/{name}/cmd_vel", TwistStamped) for name in ("left", "right")}
    reports = peer.hear("/diagnostics", DiagnosticArray)
    wait_for(lambda: {"/left/cmd_vel_guard", "/right/cmd_vel_guard"} <= {each.status[0].name for each in list(reports)})
    speaker = peer.speak("/left/cmd_vel_in", TwistStamped, 1)
    message = TwistStamped()
    message.twist.linear.x = 0.1
    wait_for(lambda: speaker.publish(message) or any(each.twist.linear.x == 0.1 for each in list(told["left"])))
    assert {each.twist.linear.x for each in told["right"]} <= {0.0}
    assert {each.header.frame_id for each in told["left"]} == {"left/base_footprint"}


def test_its_parameters_are_described(start, peer):
    start()
    names = ["max_age", "robot", "speed_scale"]
    answer = peer.ask("/cmd_vel_guard/describe_parameters", DescribeParameters, DescribeParameters.Request(names=names))
    age, robot, scale = answer.descriptors
    assert age.description.startswith("Age from which a command no longer counts, s; at most 0.5.")
    assert (age.floating_point_range[0].from_value, age.floating_point_range[0].to_value) == (0.0, 0.5)
    assert age.read_only
    assert robot.additional_constraints == "one of burger, waffle, turtlebot4, tutorial, or a FILE.yaml"
    assert scale.floating_point_range[0].to_value == 1.0


def test_it_reports_commands_that_are_too_old_and_clocks_that_are_ahead(start, probe, peer):
    start()
    speaker = peer.speak("cmd_vel_teleop", TwistStamped, 1)
    for offset, said in ((-60, "s old by its header's stamp"), (1000, "nobody")):
        message = TwistStamped()
        message.header.stamp.sec = int(time.time()) + offset
        message.twist.linear.x = 0.1
        timer = probe.node.create_timer(0.05, lambda message=message: speaker.publish(message))
        if offset < 0:
            status = probe.until_reported(said)
            assert status.level == DiagnosticStatus.WARN
            assert "/cmd_vel_teleop" in status.message
            assert set(probe.heard) <= {STOP}
        else:  # a stamp of another epoch is none: DDS's own time counts
            probe.until(lambda: Command(0.1, 0.0) in probe.heard)
        probe.node.destroy_timer(timer)

"""The guard: its decisions exhaustively without ROS, then the node as a real process on real DDS."""

import math
import signal

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import Twist, TwistStamped
from nav_msgs.msg import Odometry
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import Bool
from std_srvs.srv import SetBool
from turtlebot_gym_ros.guard import Guard, Parameters

from turtlebot_gym.parameters import STOP, Command
from turtlebot_gym.robots import ROBOTS, Robot

TICK = 0.02
AHEAD = Command(0.1, 0.2)


def new(**parameters):
    return Guard(Parameters(**parameters), now=0.0)


def drive(guard, start, duration, command=None, source="program", every=5):
    """Tick the guard at 50 Hz while a source commands at 10 Hz; return what was published."""
    published = []
    for k in range(round(start / TICK), round((start + duration) / TICK)):
        if command is not None and k % every == 0:
            guard.hear(source, command, k * TICK)
            published.append(guard.step(k * TICK))
        published.append(guard.step(k * TICK))
    return [each for each in published if each is not None]


# A law is a protection; beside it stands the sabotage that switches the protection off, which the law must notice.


def starts_with_zeros(guard):
    published = drive(guard, 0.0, 3.0)
    assert set(published) == {STOP}
    assert drive(guard, 3.0, 1.0) == []


def old_commands_stop(guard):
    assert drive(guard, 0.0, 1.0, AHEAD)[-1] == AHEAD
    silence = drive(guard, 1.0, 0.3)  # the last command came at 0.9 s
    assert set(silence) <= {AHEAD}
    after = drive(guard, 1.32, 3.0)
    assert after
    assert set(after) == {STOP}


def silent_after_zeros(guard):
    drive(guard, 0.0, 1.0, AHEAD)
    assert drive(guard, 1.0, 1.5)[-1] == STOP
    assert drive(guard, 2.5, 5.0) == []  # zeros until 2.3 s


def not_finite_is_zero(guard):
    for bad in (math.nan, math.inf, -math.inf):
        for command in (Command(bad, 0.1), Command(0.1, bad), Command(bad, -bad)):
            drive(guard, 0.0, 0.2, AHEAD)
            after = drive(guard, 0.2, 0.3, command)
            assert after
            assert set(after) == {STOP}
    assert guard.refused == 27


def limits_hold(guard):
    robot, start = ROBOTS["burger"], 0.0
    for v in (-9.0, -0.21, 0.0, 0.2, 1e300):
        for omega in (-99.0, -2.7, 0.0, 2.7, 1e300):
            for out in drive(guard, start, 1.0, Command(v, omega)):
                assert abs(out.v) <= robot.max_linear * (1 + 1e-12)
                assert abs(out.omega) <= robot.max_angular * (1 + 1e-12)
                assert abs(out.v) + abs(out.omega) * robot.wheel_separation / 2 <= robot.max_wheel * (1 + 1e-12)
            start += 1.0


def wheels_accelerate_gently(guard):
    before = STOP
    for k, target in enumerate((Command(0.2, 0.0), Command(-0.2, 0.0), Command(0.0, 2.6), Command(0.1, -1.0))):
        for out in drive(guard, float(k), 1.0, target, every=1):
            wheel = abs(out.v - before.v) + abs(out.omega - before.omega) * 0.08
            assert wheel <= 2.5 * TICK * (1 + 1e-9)
            before = out
        assert before == pytest.approx(target)


def a_start_keeps_its_curvature(guard):
    steps = drive(guard, 0.0, 1.0, Command(0.4, 2.0))  # twice too fast: limits and the ramp both act
    assert len(set(steps)) > 3
    for out in steps:
        assert out.omega == pytest.approx(5.0 * out.v)


def stops_are_not_ramped(guard):
    assert drive(guard, 0.0, 1.0, Command(0.2, 0.0))[-1].v == 0.2
    assert set(drive(guard, 1.0, 0.5, STOP)) == {STOP}


def a_person_wins(guard):
    drive(guard, 0.0, 1.0, AHEAD)
    guard.hear("teleop", Command(-0.05, 0.0), 1.0)
    assert drive(guard, 1.0, 0.38, AHEAD)[-1] == Command(-0.05, 0.0)
    assert drive(guard, 1.42, 1.0, AHEAD)[-1] == AHEAD  # and hands back when fresh no longer


def emergency_stops_and_stays(guard):
    drive(guard, 0.0, 1.0, AHEAD)
    guard.hear_emergency(True, 1.0)
    assert set(drive(guard, 1.0, 0.2, AHEAD)) == {STOP}
    guard.hear_emergency(False, 1.2)
    assert set(drive(guard, 1.2, 0.2, AHEAD)) == {STOP}  # released, but not enabled again
    assert guard.enable(True, 1.4) == ""
    guard.hear_emergency(False, 1.4)
    assert drive(guard, 1.4, 0.4, AHEAD)[-1] == AHEAD


def a_silent_emergency_stop_is_a_stop(guard):
    guard.hear_emergency(False, 0.0)
    assert drive(guard, 0.0, 0.5, AHEAD)[-1] == AHEAD
    after = drive(guard, 0.52, 5.0, AHEAD)
    assert set(after) == {STOP}
    assert guard.enable(True, 5.52) == "the emergency stop is silent"
    assert set(drive(guard, 5.52, 1.0, AHEAD)) == {STOP}


def a_pressed_emergency_stop_refuses(guard):
    guard.hear_emergency(True, 0.0)
    assert guard.enable(True, 0.1) == "the emergency stop is pressed"


def disabled_it_stops(guard):
    drive(guard, 0.0, 1.0, AHEAD)
    assert guard.enable(False, 1.0) == ""
    assert set(drive(guard, 1.0, 0.9, AHEAD)) == {STOP}
    assert drive(guard, 2.1, 1.0, AHEAD) == []
    guard.enable(True, 4.0)
    assert drive(guard, 4.0, 1.0, AHEAD)[-1] == AHEAD


def enabling_forgets_what_was_said_before(guard):
    guard.enable(False, 0.0)
    guard.hear("program", AHEAD, 0.0)
    guard.enable(True, 0.1)
    assert set(drive(guard, 0.1, 1.0)) == {STOP}


def outside_the_fence_only_a_person_drives(guard):
    assert set(drive(guard, 0.0, 1.0, AHEAD)) == {STOP}  # no pose yet
    guard.locate(1.0, 1.0, 1.0)
    assert drive(guard, 1.0, 0.4, AHEAD)[-1] == AHEAD
    guard.locate(1.5, 1.5, 1.4)
    assert set(drive(guard, 1.4, 0.4, AHEAD)) == {STOP}
    assert drive(guard, 1.8, 0.2, AHEAD, "teleop")[-1] == AHEAD
    guard.locate(math.nan, 0.0, 3.0)
    assert set(drive(guard, 3.0, 0.2, AHEAD)) == {STOP}


def a_stale_pose_is_outside(guard):
    guard.locate(0.0, 0.0, 0.0)
    assert drive(guard, 0.0, 0.5, AHEAD)[-1] == AHEAD
    assert set(drive(guard, 0.54, 1.0, AHEAD)) == {STOP}


def speed_is_scaled(guard):
    assert drive(guard, 0.0, 1.0, Command(0.5, 0.0))[-1].v == pytest.approx(0.5 * 0.2097)


def a_suspended_process_does_not_leap(guard):
    guard.step(0.0)
    guard.hear("program", Command(0.2, 0.0), 10.0)
    assert guard.step(10.0).v <= 2.5 * 0.04 + 1e-12


def a_new_robot_is_told_to_stop(guard):
    drive(guard, 0.0, 3.0)
    guard.greet(3.0)
    assert set(drive(guard, 3.0, 0.5)) == {STOP}


def sabotage(name, replacement):
    def apply(guard):
        setattr(guard, name, replacement(guard))

    return apply


def parameter(name, value):
    return lambda guard: object.__setattr__(guard._p, name, value)


def deaf(guard):
    return lambda *_: None


def talks_without_thinking(guard):
    return lambda source, command, now: guard._heard.__setitem__(source, (now, command))


def unlimited(guard):
    return Robot(max_linear=1e301, max_angular=1e301)


def nothing_instead_of_stop(guard):
    step = guard.step
    return lambda now: None if (out := step(now)) == STOP else out


def stop_for_ever(guard):
    step = guard.step
    return lambda now: step(now) or STOP


def ramps_stops(guard):
    return lambda target, dt: Guard._ramp(guard, Command(target.v + 1e-12, target.omega), dt)


def forget_no_command(guard):
    def enable(on, now):
        guard.enabled = on
        return ""

    return enable


LAWS = [
    (starts_with_zeros, {}, sabotage("step", nothing_instead_of_stop)),
    (old_commands_stop, {}, parameter("max_age", 1e6)),
    (silent_after_zeros, {}, sabotage("step", stop_for_ever)),
    (not_finite_is_zero, {}, sabotage("hear", talks_without_thinking)),
    (limits_hold, {}, sabotage("_robot", unlimited)),
    (wheels_accelerate_gently, {}, parameter("max_acceleration", math.inf)),
    (a_start_keeps_its_curvature, {}, parameter("max_acceleration", math.inf)),
    (stops_are_not_ramped, {}, sabotage("_ramp", ramps_stops)),
    (a_person_wins, {}, sabotage("hear", lambda guard: lambda s, c, t: Guard.hear(guard, "program", c, t))),
    (emergency_stops_and_stays, {}, sabotage("hear_emergency", deaf)),
    (a_silent_emergency_stop_is_a_stop, {}, sabotage("hear_emergency", deaf)),
    (a_pressed_emergency_stop_refuses, {}, sabotage("enable", forget_no_command)),
    (disabled_it_stops, {}, sabotage("enable", lambda guard: lambda on, now: "")),
    (enabling_forgets_what_was_said_before, {}, sabotage("enable", forget_no_command)),
    (outside_the_fence_only_a_person_drives, {"geofence": 2.0}, parameter("geofence", 0.0)),
    (a_stale_pose_is_outside, {"geofence": 2.0}, parameter("geofence", 0.0)),
    (speed_is_scaled, {"speed_scale": 0.5}, parameter("speed_scale", 1.0)),
    (a_suspended_process_does_not_leap, {}, parameter("rate", 1.0)),
    (a_new_robot_is_told_to_stop, {}, sabotage("greet", deaf)),
]


@pytest.mark.parametrize(("law", "parameters", "sabotage"), LAWS, ids=[law.__name__ for law, *_ in LAWS])
def test_law(law, parameters, sabotage):
    law(new(**parameters))
    broken = new(**parameters)
    sabotage(broken)
    with pytest.raises(AssertionError):
        law(broken)


def test_start_disabled():
    guard = new(start_enabled=False)
    assert set(drive(guard, 0.0, 2.0, AHEAD)) == {STOP}
    guard.enable(True, 2.0)
    assert drive(guard, 2.0, 1.0, AHEAD)[-1] == AHEAD


# The node: a process of its own, and a robot and a commander in this one, on real DDS.


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

    def until_reported(self, text):
        self.reports.clear()
        return self.until(lambda: next((status for status in list(self.reports) if text in status.message), None))

    def until_driving(self):
        self.heard.clear()
        self.command = AHEAD
        self.until(lambda: AHEAD in self.heard)

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
    return "-c", f"from turtlebot_gym_ros import guard\n{change}\nraise SystemExit(guard.main())"


def after_driving(heard):
    return heard[max(k for k, command in enumerate(heard) if command != STOP) + 1 :]


def test_passes_then_stops_then_is_silent_without_a_clock(start, probe):
    start("-p", "use_sim_time:=true", "-p", "max_acceleration:=3")  # an integer is accepted for a float
    probe.until_driving()
    assert probe.heard[0] == STOP  # whatever the robot held before
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
    status = probe.until_reported("one publisher")
    assert status.level == DiagnosticStatus.ERROR
    assert "/peer" in status.message


def test_the_wrong_type_is_reported_with_what_to_type(start, peer, wait_for):
    start()
    status = Probe(peer, wait_for, stamped=False).until_reported("-p enable_stamped_cmd_vel:=false")
    assert status.level == DiagnosticStatus.ERROR
    assert "/peer has geometry_msgs/msg/Twist on /cmd_vel" in status.message


@pytest.mark.parametrize(
    ("argument", "text"),
    [
        ("max_agee:=0.3", "unknown parameter 'max_agee'"),
        ("max_age:=0.6", "parameter 'max_age' must be in (0, 0.5] s, got 0.6"),
        ("rate:=fast", "parameter 'rate' must be of type float, got 'fast'"),
        ("robot:=roomba", "parameter 'robot' must be one of burger, "),
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

"""The guards of two robots in one graph: button, enabling and commands are one robot's, unless a topic is shared on purpose."""

import signal
import sys
import time

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import TwistStamped
from std_msgs.msg import Bool, String
from std_srvs.srv import SetBool

from turtlebot_gym_ros.robot.arbiter import Arbiter, Parameters
from turtlebot_gym_ros.robot.collision import Scan, points_of

AHEAD = 0.1


class Robot:
    """What stands around one guard: its wheels, a program, a button, and whoever reads the diagnostics."""

    def __init__(self, peer, wait_for, name, *, button="emergency_stop"):
        self.name, self._until, self._peer = name, wait_for, peer
        self.heard = peer.hear(f"/{name}/cmd_vel", TwistStamped)
        self._reports = peer.hear("/diagnostics", DiagnosticArray)
        self._program = peer.speak(f"/{name}/cmd_vel_in", TwistStamped, 1)
        self._button = peer.speak(button if button.startswith("/") else f"/{name}/{button}", Bool, 1)
        self.speed, self.pressed = None, None
        peer.node.create_timer(0.05, self._speak)

    def _speak(self):
        if self.speed is not None:
            message = TwistStamped()
            message.twist.linear.x = self.speed
            self._program.publish(message)
        if self.pressed is not None:
            self._button.publish(Bool(data=self.pressed))

    def until_driving(self):
        self.heard.clear()
        self.speed = AHEAD
        self._until(self._drives)

    def _drives(self):
        if self.pressed is False:
            self.enable(True)  # again, where a busy machine kept the button silent for too long
            time.sleep(0.5)  # an enabled guard has forgotten what was said before
        return any(each.twist.linear.x == AHEAD for each in list(self.heard))

    def until_reported(self, text):
        self._reports.clear()
        name = f"/{self.name}/cmd_vel_guard"

        def find():
            statuses = (each for message in list(self._reports) for each in message.status if each.name == name)
            return next((each for each in statuses if text in each.message), None)

        return self._until(find)

    def enable(self, on):
        return self._peer.ask(f"/{self.name}/cmd_vel_guard/enable", SetBool, SetBool.Request(data=on))


@pytest.fixture
def start(launch):
    """Start the guard of a robot as a process."""

    def start(name, *arguments):
        words = ("-r", f"__ns:=/{name}", "-p", f"frame_prefix:={name}/", *arguments)
        return launch("-m", "turtlebot_gym_ros", "cmd_vel_guard", "--ros-args", *words)

    return start


@pytest.fixture
def robots(peer, wait_for, start):
    """Two robots, each with its guard, that drive."""

    def make(*arguments, button="emergency_stop"):
        for name in ("robot1", "robot2"):
            start(name, *arguments)
        made = [Robot(peer, wait_for, name, button=button) for name in ("robot1", "robot2")]
        for each in made:
            each.until_driving()
        return made

    return make


def test_a_button_stops_its_own_robot_and_its_enable_is_its_own(robots):
    one, two = robots()
    one.pressed = True
    one.until_reported("emergency stop")
    two.heard.clear()
    two.until_driving()  # still
    assert two.until_reported("").hardware_id == "robot2/burger"
    assert two.enable(True).success  # enables robot 2, and robot 1 not
    one.heard.clear()
    status = one.until_reported("/robot1/cmd_vel_guard/enable")
    assert status.hardware_id == "robot1/burger"
    assert {each.twist.linear.x for each in list(one.heard)} <= {0.0}
    one.pressed = False
    two.pressed = False  # another robot's button that is not pressed is no release
    one.until_reported("emergency stop")
    assert all(each.header.frame_id == "robot1/base_footprint" for each in one.heard)


def test_one_button_can_stop_all_robots_and_each_is_enabled_by_itself(robots, wait_for):
    one, two = robots("-r", "emergency_stop:=/emergency_stop", button="/emergency_stop")
    two.pressed = False  # a second button of all robots: for a release each must be heard
    one.pressed = True
    for each in (one, two):
        each.until_reported("emergency stop")
    one.pressed = False
    wait_for(lambda: one.enable(True).success)
    one.until_driving()
    two.heard.clear()
    two.until_reported("emergency stop")
    assert {each.twist.linear.x for each in list(two.heard)} <= {0.0}
    wait_for(lambda: two.enable(True).success)
    two.until_driving()


def test_commands_for_one_robot_move_no_other(peer, wait_for, start):
    start("robot1")
    start("robot2")
    one, two = Robot(peer, wait_for, "robot1"), Robot(peer, wait_for, "robot2")
    one.until_driving()
    two.until_reported("silent")
    assert {each.twist.linear.x for each in list(two.heard)} == {0.0}


def scan(frame):
    return Scan([3.0] * 360, 0.0, 0.0174533, 0.12, 3.5, frame)


def test_with_a_prefix_the_guard_sees_by_its_own_lidar_only():
    with_prefix = "robot1/", ["robot1/base_scan"], ["robot2/base_scan", "base_scan"]
    without = "", ["base_scan", "robot2/base_scan"], ["rplidar"]
    for prefix, good, bad in (with_prefix, without):
        monitor = Arbiter(Parameters(collision_monitor=True, frame_prefix=prefix), 0.0).monitor
        for frame in good:
            points_of(scan(frame), monitor._body, monitor._limits, monitor._reach)
        for frame in bad:
            with pytest.raises(ValueError, match="its frame is"):
                points_of(scan(frame), monitor._body, monitor._limits, monitor._reach)


def test_a_recorder_takes_its_own_robots_topics_and_those_that_all_share(
    launch, peer, wait_for, tmp_path, monkeypatch, read_bag
):
    monkeypatch.setenv("AMENT_PREFIX_PATH", sys.prefix)
    words = ("-r", "__ns:=/robot1")
    process = launch("-m", "turtlebot_gym_ros", "data_logger", "--ros-args", *words)
    own, shared, other = (peer.speak(topic, String) for topic in ("/robot1/note", "/all", "/robot2/note"))
    wait_for(lambda: own.get_subscription_count() and shared.get_subscription_count())
    for publisher in (own, shared, other):
        publisher.publish(String(data="a word"))
        assert publisher.wait_for_all_acked()
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=30.0)
    (folder,) = (tmp_path / "bags" / "robot1").iterdir()
    held = read_bag(folder)
    assert {"/robot1/note", "/all"} <= held.keys()
    assert not any(topic.startswith("/robot2") for topic in held)

"""Faults of the live loop as on a robot: controller -> /cmd_vel_in -> guard -> /cmd_vel, the filter listening behind the guard.

All are real processes; the test is the robot, and the independent listener on ``/cmd_vel``. After each fault that must stop the
robot it hears zeros and nothing else, no other process ends, and once all is well again and enabled, the robot drives on.
"""

import signal
import subprocess
import sys
import threading
import time

import pytest
from bench import odometry
from burger import WORDS
from geometry_msgs.msg import TwistStamped
from nav_msgs.msg import Odometry
from std_srvs.srv import SetBool

COMMANDS = {
    "kalman_filter": ["noise:=clean"],
    "waypoint_generator": ["waypoints:=far.csv"],
    "velocity_controller": ["policy:=bearing"],
    "cmd_vel_guard": WORDS[1::2],
}


class Robot:
    """The processes, a robot that sends odometry at 20 Hz in a thread of its own, and ears on ``/cmd_vel``."""

    def __init__(self, peer, wait_for, folder):
        self.peer, self.wait_for, self.folder = peer, wait_for, folder
        (folder / "far.csv").write_text("1000,0,0\n")
        self.commands = peer.hear("cmd_vel", TwistStamped)
        self.processes = {}
        self.x = 0.0
        self.spoil = lambda message: message
        self._odometry = peer.speak("odom", Odometry)
        self.send = self._odometry.publish
        self.measured = 0.0
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()
        for name in COMMANDS:
            self.start(name)

    def start(self, name, remap="cmd_vel:=cmd_vel_in"):
        parameters = [word for parameter in COMMANDS[name] for word in ("-p", parameter)]
        remapping = ["-r", remap] if name == "velocity_controller" else []
        arguments = [sys.executable, "-m", "turtlebot_gym_ros", name, "--ros-args", *parameters, *remapping]
        self.processes[name] = subprocess.Popen(arguments, cwd=self.folder)

    def _run(self):
        while not self._over.wait(0.05):
            made = time.time()
            speed = self.commands[-1].twist.linear.x if self.commands else 0.0
            self.x += 0.05 * speed
            said = odometry(made, x=self.x)
            said.twist.twist.linear.x = speed
            message = self.spoil(said)
            if message is not None:
                self.measured = made
                self.send(message)

    @property
    def speeds(self):
        return [message.twist.linear.x for message in self.commands]

    def drive(self):
        """Enable the controller, and wait until the robot drives."""
        self.wait_for(lambda: self.peer.ask("velocity_controller/enable", SetBool, SetBool.Request(data=True)).success)
        self.commands.clear()
        self.wait_for(lambda: self.commands and self.speeds[-1] > 0.09)
        del self.commands[:-1]

    def stops(self):
        """Wait until the robot has stopped, and check that it heard zeros and nothing else from then on."""
        self.wait_for(lambda: 0.0 in self.speeds)
        first = self.speeds.index(0.0)
        self.wait_for(lambda: len(self.commands) > first + 5)
        assert set(self.speeds[first:]) == {0.0}

    def check_alive(self, *, but=None):
        assert all(process.poll() is None for name, process in self.processes.items() if name != but)

    def close(self):
        self._over.set()
        self._thread.join()
        for process in self.processes.values():
            process.send_signal(signal.SIGCONT)
            process.terminate()
        assert [process.wait(30) for process in self.processes.values()] == [0] * len(self.processes)


@pytest.fixture(scope="module")
def robot(module_peer, wait_for, tmp_path_factory):
    robot = Robot(module_peer, wait_for, tmp_path_factory.mktemp("robot"))
    yield robot
    robot.close()


class Late:
    """Odometry that comes late, honestly stamped."""

    def __init__(self, delay):
        self.delay, self.waiting = delay, []

    def __call__(self, message):
        self.waiting.append((time.monotonic() + self.delay, message))
        return self.waiting.pop(0)[1] if self.waiting[0][0] <= time.monotonic() else None


@pytest.mark.parametrize("spoil", [lambda message: None, Late(1.0)], ids=["stops", "late"])
def test_invalid_odometry_stops_the_robot(robot, spoil):
    robot.drive()
    robot.spoil = spoil
    try:
        robot.stops()
        robot.check_alive()
    finally:
        robot.spoil = lambda message: message
    robot.wait_for(lambda: robot.speeds[-1] > 0.09)  # it goes on by itself


def moved_at(robot):
    """Return the times at which motion was published from now on: a list that grows."""
    times = []

    def hear(message, info):
        if message.twist.linear.x or message.twist.angular.z:
            times.append(info["source_timestamp"] * 1e-9)

    return times, robot.peer.node.create_subscription(TwistStamped, "cmd_vel", hear, 1000)


@pytest.mark.parametrize(
    ("name", "duration"),
    [
        ("velocity_controller", 1.2),
        pytest.param("velocity_controller", 3.2, marks=pytest.mark.nightly),
        pytest.param("kalman_filter", 1.2, marks=pytest.mark.nightly),
    ],
)
def test_a_node_that_was_suspended_while_its_source_died_moves_nothing_when_it_goes_on(robot, name, duration):
    robot.drive()
    robot.processes[name].send_signal(signal.SIGSTOP)
    try:
        time.sleep(0.5 * duration)
        robot.spoil = lambda message: None
        time.sleep(0.1)
        last = robot.measured
        times, subscription = moved_at(robot)
        time.sleep(0.5 * duration)
        robot.processes[name].send_signal(signal.SIGCONT)
        time.sleep(1.5)
        assert max(times, default=0.0) <= last + 0.6
        assert robot.speeds[-1] == 0.0
        robot.peer.node.destroy_subscription(subscription)
    finally:
        robot.processes[name].send_signal(signal.SIGCONT)
        robot.spoil = lambda message: message
    robot.wait_for(lambda: robot.speeds[-1] > 0.09)


ENDINGS = [
    ("velocity_controller", signal.SIGKILL),
    *(
        pytest.param(name, number, marks=pytest.mark.nightly)
        for name in ("velocity_controller", "kalman_filter", "waypoint_generator")
        for number in (signal.SIGTERM, signal.SIGSTOP)
    ),
]


@pytest.mark.parametrize(("name", "number"), ENDINGS)
def test_the_end_of_any_process_stops_the_robot_and_it_can_start_again(robot, name, number):
    robot.drive()
    robot.processes[name].send_signal(number)
    robot.stops()
    robot.check_alive(but=name)
    if number == signal.SIGSTOP:
        robot.processes[name].send_signal(signal.SIGCONT)
    else:
        assert robot.processes[name].wait(30) == (-signal.SIGKILL if number == signal.SIGKILL else 0)
        robot.start(name)
    robot.drive()

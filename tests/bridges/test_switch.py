"""The switch of a node that moves a robot: its services, its states and its zeros, on fakes; then the buttons on real DDS."""

import time
from types import SimpleNamespace

import pytest
from rclpy.qos import DurabilityPolicy
from std_msgs.msg import Bool, String
from std_srvs.srv import SetBool

from turtlebot_gym_ros.node import switch as module
from turtlebot_gym_ros.node.switch import Switch


class Fakes:
    """A node, its outputs and the clocks, as far as a switch knows them; the time is the test's."""

    def __init__(self):
        self.at, self.system = 100.0, 1_700_000_000.0  # the steady clock, and what the system clock is ahead of it, s
        self.states, self.zeros, self.log, self.publishers, self.restarts = [], [], [], 0, 0

    def make(self, *, enabled=True, sees=False):
        given = {"restart": self.restart, "refusal": lambda: "", "blocked": 0.5, "sees": sees}
        self.switch = Switch(self, self, enabled=enabled, now=lambda: self.at, **given)
        return self.switch

    def restart(self):
        self.restarts += 1

    def read_clocks(self):
        return self.system + self.at, 5000.0 + self.at  # the clock that goes on in sleep has another zero

    def sleep(self, seconds):
        self.at += seconds

    def get_logger(self):
        return SimpleNamespace(warning=self.log.append)

    def create_publisher(self, kind, topic, qos):
        assert (kind, topic, qos.durability) == (String, "~/state", DurabilityPolicy.TRANSIENT_LOCAL)
        return SimpleNamespace(publish=lambda message: self.states.append(message.data))

    def create_service(self, kind, name, serve):
        assert (kind, name) == (SetBool, "~/enable")
        self.serve = serve

    def create_subscription(self, kind, topic, hear, qos, callback_group=None):
        assert (kind, topic) == (Bool, "emergency_stop")
        self.hear = hear
        return SimpleNamespace(get_publisher_count=lambda: self.publishers)

    def publish_stops(self):
        self.zeros.append(self.at)

    def drive(self):
        safety = self.switch.safety
        assert safety.activate(safety.begin(now=self.at))
        safety.end()
        self.switch.watch()

    def watch(self, seconds):
        """Let the time go on, as the watching thread sees it."""
        for _ in range(round(seconds / 0.02)):
            self.at += 0.02
            self.switch.watch()

    def say(self, pressed, number, age=0.0):
        """Let a button's message arrive that was sent some seconds ago."""
        arrival = round((self.system + self.at) * 1e9)
        times = {"source_timestamp": arrival - round(age * 1e9), "received_timestamp": arrival}
        self.hear(Bool(data=pressed), {**times, "publication_sequence_number": number})

    def ask(self, on):
        response = self.serve(SetBool.Request(data=on), SetBool.Response())
        return response.success, response.message


@pytest.fixture
def fakes(monkeypatch):
    fakes = Fakes()
    monkeypatch.setattr(module, "read_clocks", fakes.read_clocks)
    monkeypatch.setattr(module, "time", fakes)
    return fakes


@pytest.mark.parametrize(("sees", "what"), [(False, "no obstacles"), (True, "only the obstacles that its LiDAR sees")])
def test_enabling_begins_anew_is_reported_at_once_and_warns_of_what_it_does_not_see(fakes, sees, what):
    begun = []
    fakes.make(enabled=False, sees=sees)._ages = SimpleNamespace(begin=lambda: begun.append(1))
    assert fakes.states == ["silent: not enabled"]
    warned = f"enabled. It sees {what}: watch the robot while it is enabled."
    assert fakes.ask(True) == (True, warned)
    assert fakes.states == ["silent: not enabled", "silent: no step yet"]
    assert fakes.restarts == 1
    assert fakes.log == [warned]
    fakes.drive()
    assert fakes.ask(True) == (True, warned)  # again: the block goes on
    assert fakes.states[2:] == ["active"]
    assert fakes.restarts == 1
    fakes.switch.stop("waits for /odom")  # perhaps since a clock was set: a person's word begins the comparison of clocks
    assert fakes.ask(True)[0]
    assert fakes.restarts == len(begun) == 2


def test_disabling_stops_at_once_and_leaves_the_robot_to_others_a_second_later(fakes):
    fakes.make()
    fakes.drive()
    assert fakes.zeros == []
    assert fakes.ask(False) == (True, "disabled")
    assert fakes.zeros == [100.0]
    fakes.watch(3.0)
    assert fakes.states == ["silent: no step yet", "active", "stopping: not enabled", "silent: not enabled"]
    assert len(fakes.zeros) in (17, 18)  # every third look of 20 ms
    assert 100.9 < fakes.zeros[-1] < 101.0
    assert not fakes.switch.safety.enabled


@pytest.mark.parametrize(("forth", "back", "age"), [(0.0, 30.0, 0.6), (0.05, 0.05, 0.54)])
def test_a_clock_that_is_set_makes_no_button_younger(fakes, forth, back, age):
    fakes.make()
    fakes.at += 1.0
    fakes.system += forth
    fakes.switch.watch()  # which looks at the clocks: a time between two changes counts, too
    fakes.drive()
    fakes.system -= back
    fakes.at += 0.02
    arrival = round((fakes.system + fakes.at) * 1e9)
    sent = round((fakes.system + back + fakes.at - age) * 1e9)  # before the clock was set back
    info = {"source_timestamp": sent, "received_timestamp": arrival, "publication_sequence_number": 1}
    fakes.hear(Bool(data=False), info)
    assert fakes.states[-1] == "stopping: the emergency stop is silent"


@pytest.mark.parametrize("moving", ["active", "stopping", None])
def test_the_end_of_the_node_stops_what_moves_and_says_nothing_to_a_robot_that_does_not(fakes, moving):
    switch = fakes.make()
    if moving:
        fakes.drive()
    if moving == "stopping":
        switch.stop("/odom is older than 0.5 s")
        fakes.zeros.clear()
    switch.close()
    assert fakes.zeros == (pytest.approx([100.0, 100.03, 100.06]) if moving else [])  # several, since one may be lost
    assert (100.0 < fakes.at < 100.1) if moving else fakes.at == 100.0
    assert fakes.states[-1] == f"{'stopping' if moving else 'silent'}: the node ends"
    assert not switch.safety.enabled


# On real DDS, which numbers the messages.


def speak(bench, *buttons):
    """Let buttons say at 10 Hz, by the bench's clock, what they say; return what tells them."""
    for button in buttons:
        bench.wait_for(button.get_subscription_count)

    def once(*pressed):
        for button, state in zip(buttons, pressed, strict=True):
            button.publish(Bool(data=state))
        time.sleep(0.05)
        bench.advance(0.1)

    return once


def test_a_press_counts_however_short_and_every_button_must_be_released(make_bench):
    bench = make_bench()
    buttons = [bench.peer.speak("emergency_stop", Bool, 1) for _ in range(2)]
    say = speak(bench, *buttons)
    for _ in range(3):
        say(False, False)
    bench.drive()
    buttons[0].publish(Bool(data=True))
    buttons[0].publish(Bool(data=False))
    bench.wait_for(lambda: bench.state == "stopping: emergency stop")
    for _ in range(8):
        say(False, True)
    assert bench.enable().message == "the emergency stop is pressed"
    bench.wait_for(lambda: say(False, False) or bench.enable().success)

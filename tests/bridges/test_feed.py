"""An input as it arrives, told the time by the test: how old it is, what a step is given, what the diagnostics say."""

from dataclasses import replace
from types import SimpleNamespace

import pytest
from bench import odometry
from geometry_msgs.msg import TwistStamped
from rclpy.time import Time
from sensor_msgs.msg import TimeReference
from std_msgs.msg import Header

from cmd_vel_guard.sent import Age, SystemClock
from turtlebot_gym.values import Command, State
from turtlebot_gym_ros.node.block import Input, Stamped
from turtlebot_gym_ros.node.convert import conversion
from turtlebot_gym_ros.node.feed import Feed, resting_on


class FakeNode:
    """A node as far as an input knows it: it notes what is subscribed to, in a namespace."""

    def __init__(self):
        self.hears, self.publishers, self.default_callback_group = {}, 1, None

    def create_subscription(self, kind, topic, hear, qos, *, callback_group, qos_overriding_options=None, raw=False):
        self.kind, self.hear, self.qos = kind, hear, qos
        self.group, self.overridable = callback_group, qos_overriding_options
        self.hears[kind, topic] = hear
        return SimpleNamespace(topic_name=f"/robot/{topic}", get_publisher_count=lambda: self.publishers)


def unconnected(kind=State, *, lock_step=False, headers=True, group=None, mount=lambda frame: None, **options):
    """Return an input on a machine whose system and steady clocks agree."""
    clock = SystemClock()
    clock.look(system=0.0, steady=0.0)
    declared = Input(topic="odom", type=kind, **options)
    return Feed(declared, conversion(kind), lock_step=lock_step, clock=clock, headers=headers, group=group, mount=mount)


def make(*, lock_step=False, **options):
    """Return an input of odometry and the node that it is connected to."""
    feed, node = unconnected(lock_step=lock_step, **options), FakeNode()
    node.endpoint = feed.connect(node, "hear", "told")
    return feed, node


def test_a_message_in_another_frame_is_refused():
    feed, _ = make()
    assert feed.read(odometry(x=1.5), "odom") == (1.5, 0.0, 0.0, 0.0, 0.0)
    for other in ("map", "odom_combined"):
        with pytest.raises(ValueError, match=f"its frame is '{other}' instead of 'odom'"):
            feed.read(odometry(frame=other), "odom")
    assert unconnected(Command).read(TwistStamped(), "odom") == (0.0, 0.0)  # a velocity is stated in the robot's own frame


AWAITED, OLD = "waits for /robot/odom", "/robot/odom is older than {} s"
MEASURED = Age(0.125, 0.25, True, "its header's stamp")


@pytest.mark.parametrize(
    ("options", "age", "before", "fresh", "late", "missing"),
    [
        ({}, None, AWAITED, 100.5, 100.5625, OLD.format(0.5)),
        ({}, MEASURED, AWAITED, 100.25, 100.3125, OLD.format(0.5)),  # a value ages from its measurement
        ({"required": False, "max_age": 2.0}, None, None, 102.0, 102.5, None),
        ({"max_age": None}, None, AWAITED, 1e6, None, None),  # again and again: it is no event
        ({"lock_step": True}, None, AWAITED, 1e6, None, None),
    ],
    ids=["as it is", "measured earlier", "optional", "without an age", "in lock-step"],
)
def test_an_input_is_awaited_then_given_until_it_is_old_and_awaited_again_after_a_reset(
    options, age, before, fresh, late, missing
):
    feed, _ = make(**options)
    assert (feed.missing(100.0), feed.take(100.0, 0), feed.stamp) == (before, None, None)
    feed.accept("here", 100.0, 7, *([age] if age else []))
    for _ in range(2):
        assert (feed.missing(fresh), feed.take(fresh, 0), feed.stamp) == (None, "here", 7)
    if late is not None:
        assert (feed.missing(late), feed.take(late, 0)) == (missing, None)
        feed.accept("there", late, 8)
        assert feed.take(late, 0) == "there"
    feed.forget()
    assert (feed.missing(100.0), feed.stamp) == (before, None)
    latched, _ = make(latched=True, **options)  # what is published once outlasts a reset
    latched.accept("here", 100.0, 1)
    latched.forget()
    assert latched.missing(100.0) is None


def test_where_one_may_publish_two_are_one_too_many():
    feed, node = make(sole=True)
    feed.accept("here", 100.0, 7)
    assert feed.missing(100.0) is None
    node.publishers = 2
    assert feed.missing(100.0) == "2 nodes publish /robot/odom, where one may; a killed one counts for 20 s"


def message(*, sent, measured=None):
    """Return odometry that was sent and measured at times, s, with its info: it arrives at once."""
    nanoseconds = round(sent * 1e9)
    stamp = SimpleNamespace(sec=0, nanosec=0 if measured is None else round(measured * 1e9))
    info = {"source_timestamp": nanoseconds, "received_timestamp": nanoseconds}
    return SimpleNamespace(header=SimpleNamespace(stamp=stamp)), info


@pytest.mark.parametrize(
    ("options", "at", "times", "age"),
    [
        ({}, 100.5, {"sent": 100.0}, 0.5),
        ({}, 100.5625, {"sent": 100.0}, None),  # it waited in a queue
        ({}, 100.0, {"sent": 100.0, "measured": 99.5}, 0.5),
        ({}, 100.0, {"sent": 100.0, "measured": 99.4375}, None),  # it was sent again, or held back
        ({}, 100.0, {"sent": 100.0, "measured": 102.125}, None),  # by a clock that is ahead
        ({"lasts": 0.25}, 100.0, {"sent": 100.0, "measured": 99.25}, 0.5),
        ({"lasts": 0.25}, 100.0, {"sent": 100.0, "measured": 99.125}, None),
        ({"max_age": 2.0}, 100.0, {"sent": 100.0, "measured": 98.0}, 2.0),
        ({"headers": False}, 100.0, {"sent": 100.0, "measured": 40.0}, 0.0),  # simulated time
        ({"max_age": None}, 100.0, {"sent": 40.0}, 0.0),
        ({"lock_step": True}, 100.0, {"sent": 40.0, "measured": 20.0}, 0.0),
    ],
)
def test_a_message_is_judged_by_when_it_was_sent_and_measured_whenever_it_is_handled(options, at, times, age):
    feed = unconnected(**options)
    if age is None:
        with pytest.raises(ValueError, match=r"synchronize both clocks \(chrony\)"):
            feed.age(*message(**times), at)
    else:
        assert feed.age(*message(**times), at).since(feed.declared.lasts) == age


def test_a_command_rests_on_the_oldest_of_the_newest_required_measurements():
    estimate, scan, other = unconnected(), unconnected(lasts=0.25), unconnected(required=False)
    reference = unconnected(measured=False)
    feeds = (estimate, scan, other, reference)
    assert resting_on(feeds, 99) == 99
    for feed in (other, reference):
        feed.accept("there", 10.0, 1)
    estimate.accept("here", 10.0, 9_000_000_000)
    assert resting_on(feeds, 99) == 9_000_000_000
    for at, measured, rests in ((8.5, 1.5, 8.75), (8.5, 0.125, 8.625), (8.9, 1.1, 9.0)):  # it lasts until now at most
        scan.accept("wall", 10.0, round(at * 1e9), Age(0.0, measured, True, "its header's stamp"))
        assert resting_on(feeds, 99) == rests * 1e9
    estimate.accept("here", 10.0, 0, sent=7_500_000_000)  # without a stamp
    assert resting_on(feeds, 99) == 7_500_000_000


def test_an_aged_value_comes_with_the_difference_of_the_stamps():
    feed, _ = make(aged=True)
    assert feed.take(100.0, 5) is None
    feed.accept("here", 100.0, 2_000_000_000)
    assert feed.take(100.0, 2_300_000_000) == Stamped("here", 0.3)
    assert feed.take(100.5, 1_900_000_000) == Stamped("here", -0.1)  # from after the step
    assert feed.take(100.5625, 2_300_000_000) is None  # old by the steady clock, whatever the stamps say


def test_a_value_belongs_to_the_step_of_its_stamp_and_a_rare_one_to_the_step_that_names_it():
    feed, _ = make()
    feed.accept("here", 0.0, 7)
    assert feed.step == 7
    rare, node, steps = unconnected(State, lock_step=True), FakeNode(), []
    rare.declared = replace(rare.declared, lock_step="newest")
    rare.connect(node, "hear", lambda: steps.append(rare.step))
    assert rare.step is None
    rare.accept("here", 0.0, 7)
    assert rare.step is None
    for newest, step in ((7, 10), (7, 11), (9, None)):
        header = Header(stamp=Time(nanoseconds=step or 12).to_msg())
        node.hears[TimeReference, "odom/newest"](TimeReference(header=header, time_ref=Time(nanoseconds=newest).to_msg()))
        assert rare.step == step
    assert steps == [10, 11, None]
    rare.accept("there", 0.0, 9)
    assert rare.step == 12
    rare.forget()
    assert rare.step is None

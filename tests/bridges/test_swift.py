"""The executor of the nodes goes on whatever other threads do to its entities."""

import threading
import time
from contextlib import nullcontext
from types import SimpleNamespace

from rclpy.impl.implementation_singleton import rclpy_implementation
from std_msgs.msg import String

from turtlebot_gym_ros.base.swift import MOST, Swift, Unawaited, take


def test_an_entity_that_is_destroyed_while_it_is_waited_for_does_not_end_it(peer, wait_for):
    """The moment is too short to be met on purpose: an event of a subscription says once what rclpy then says."""
    subscription = peer.node.create_subscription(String, "short_lived", lambda message: None, 1)
    event, met = subscription.event_handlers[0], threading.Event()
    wait = event.add_to_wait_set

    def gone(wait_set):
        if met.is_set():
            return wait(wait_set)
        met.set()
        raise rclpy_implementation.InvalidHandle("cannot use Destroyable because destruction was requested")

    event.add_to_wait_set = gone
    heard, publisher = peer.hear("after_all", String), peer.speak("after_all", String)
    wait_for(lambda: publisher.publish(String(data="there")) or (met.is_set() and heard))


def test_a_topic_that_nobody_waits_for_is_heard_when_it_is_taken(peer, another_runner, wait_for):
    heard = []
    subscription = peer.node.create_subscription(
        String, "polled", lambda message, info: heard.append(info["source_timestamp"]), 10, callback_group=Unawaited()
    )
    publisher, others = peer.speak("polled", String), peer.hear("others", String)
    talker = peer.speak("others", String)
    wait_for(publisher.get_subscription_count)
    publisher.publish(String(data="there"))
    wait_for(lambda: talker.publish(String(data="there")) or len(others) > 5)
    assert heard == []
    wait_for(lambda: take(subscription) or heard)


def test_swift_entities_that_are_destroyed_during_the_wait_do_not_end_the_process(peer, wait_for):
    for k in range(60):
        topics = [f"swift_{k}_{n}" for n in range(3)]
        make = peer.node.create_subscription
        ended = [make(String, topic, lambda message: None, 1, callback_group=Swift()) for topic in topics]
        time.sleep(0.003 * (k % 20))
        for subscription in ended:
            peer.node.destroy_subscription(subscription)
    heard, publisher = peer.hear("after_all", String), peer.speak("after_all", String)
    wait_for(lambda: publisher.publish(String(data="there")) or heard)


class Endless(nullcontext):
    """The handle of a subscription whose messages come faster than they can be taken."""

    def take_message(self, kind, raw):
        return "again", None


def test_a_flood_takes_its_turn():
    heard = []
    take(SimpleNamespace(handle=Endless(), msg_type=String, raw=False, callback=heard.append, _callback_type=None))
    assert len(heard) == MOST

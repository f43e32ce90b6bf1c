"""The executor of the nodes goes on whatever other threads do to its entities."""

import threading

from rclpy.impl.implementation_singleton import rclpy_implementation
from std_msgs.msg import String


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

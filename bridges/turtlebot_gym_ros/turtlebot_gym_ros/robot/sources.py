"""The sources of the guard's inputs: one for each, and never the guard itself."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import combinations

from rclpy.subscription import Subscription

BUTTONS = "emergency_stop"
"""The input that may have many sources."""
COMMANDS = "cmd_vel", "cmd_vel_in", "cmd_vel_teleop"
"""The guard's output, and its inputs of the same type."""


def check_topics(resolve: Callable[[str], str]) -> None:
    """Refuse remappings by which the guard would obey itself, or take one source for two.

    Args:
        resolve: Returns the full name of a topic, as remapped.

    Raises:
        ValueError: With one line.
    """
    for first, second in combinations(COMMANDS, 2):
        if (topic := resolve(first)) == resolve(second):
            why = "obey its own commands" if first == COMMANDS[0] else "take a program for a person"
            raise ValueError(
                f"{first} and {second} must be different topics, got {topic} for both: the guard would {why}; remap one."
            )


def rivals(subscriptions: Mapping[str, Subscription]) -> str:
    """Return which input has more than one source, or an empty text."""
    counts = {topic: subscription.get_publisher_count() for topic, subscription in subscriptions.items() if topic != BUTTONS}
    return next((f"{count} nodes publish {topic}" for topic, count in counts.items() if count > 1), "")

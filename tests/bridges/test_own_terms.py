"""A policy that reads a bumper drives at a live node while the bumper's topic speaks, and stands when that says nothing."""

from dataclasses import replace

import own_terms
from std_msgs.msg import Bool

from turtlebot_gym_agents.policies.bundle import term_on
from turtlebot_gym_ros.blocks.controller import _input_of


def bundle_term(name, low, high, source=""):
    """Return a term as a bundle's card has it."""
    return term_on("a.onnx", {"name": name, "low": low, "high": high, "source": source})


NAMED = {term.name: replace(term, source=f"own_terms:{term.name.upper()}") for term in (own_terms.BUMPER, own_terms.GAPS)}


def test_a_bundles_term_is_brought_by_the_topic_that_a_person_names():
    source = _input_of(bundle_term("bumper", [0.0], [1.0]), NAMED)
    assert (source.topic, source.message, source.max_age, source.lasts) == ("bumper", "std_msgs/msg/Bool", 0.5, 0.0)
    assert source.read(Bool(data=True)) == (1.0,)
    slow = _input_of(replace(own_terms.BUMPER, lasts=3.0), {})
    assert (slow.max_age, slow.lasts) == (0.5, 2.5)

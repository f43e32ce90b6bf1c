"""Quality-of-service profiles by name, of the guard and of all other nodes."""

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

STREAM = QoSProfile(depth=10)
"""Reliable and volatile: lost messages are sent again; late joiners do not receive earlier ones."""
LATEST = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
"""Best effort; only the last message counts."""
EVERY = QoSProfile(depth=1000)
"""Reliable; no message is dropped, for example the press of a button: lost ones are sent again. Of a publisher that offers
best effort only nothing is heard, which the subscription reports."""
PROMPT = QoSProfile(depth=1000, reliability=ReliabilityPolicy.BEST_EFFORT)
"""Best effort; every message that is not lost, without waiting for those that are."""
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""Late joiners receive the last value."""
STATIC = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""Late joiners receive the values of many publishers: the quality of service of tf2's listener to ``/tf_static``."""
SENSOR = QoSProfile(depth=50, reliability=ReliabilityPolicy.BEST_EFFORT)
"""Best effort: a subscription with it matches reliable and best-effort publishers."""
LOCK_STEP = QoSProfile(depth=10_000)
"""Reliable, with long histories: in lock-step every message counts, and a recorder may be suspended for seconds."""

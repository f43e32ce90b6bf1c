"""Quality of service by name; every topic's can be overridden by ROS parameters (``qos_overrides...``)."""

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions

STREAM = QoSProfile(depth=10)
"""Reliable and volatile: what is lost is sent again, what was sent before somebody listened is gone."""
LOCK_STEP = QoSProfile(depth=10_000)
"""Reliable, with long histories: in lock-step every message counts, and a recorder may be suspended for seconds meanwhile."""
SENSOR = QoSProfile(depth=50, reliability=ReliabilityPolicy.BEST_EFFORT)
"""A subscription with it understands reliable and best-effort publishers."""
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""Late joiners receive the last value."""


def overridable() -> QoSOverridingOptions:
    """Return the option that lets parameters override a profile's history, depth and reliability."""
    return QoSOverridingOptions.with_default_policies()

"""Further quality-of-service profiles; ROS parameters can override that of every topic (``qos_overrides...``)."""

from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions

LOCK_STEP = QoSProfile(depth=10_000)
"""Reliable, with long histories: in lock-step every message counts, and a recorder may be suspended for seconds."""
SENSOR = QoSProfile(depth=50, reliability=ReliabilityPolicy.BEST_EFFORT)
"""Best effort: a subscription with it matches reliable and best-effort publishers."""


def overridable() -> QoSOverridingOptions:
    """Return the option that lets parameters override a profile's history, depth and reliability."""
    return QoSOverridingOptions.with_default_policies()

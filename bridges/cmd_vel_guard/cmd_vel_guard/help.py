"""The ``--help`` of guard and standby, without making a node."""

from __future__ import annotations

from importlib import import_module

from cmd_vel_guard.explain import Topic, explain, parameters_of

VELOCITY, TRANSFORMS, BOOL = "geometry_msgs/msg/TwistStamped", "tf2_msgs/msg/TFMessage", "std_msgs/msg/Bool"
DIAGNOSTICS = Topic("publishes", "/diagnostics", "diagnostic_msgs/msg/DiagnosticArray", "reliable", "at 1 Hz")
TOPICS = {
    "cmd_vel_guard": (
        Topic("subscribes", "cmd_vel_teleop", VELOCITY, "best effort", "a person's: wins while fresh"),
        Topic("subscribes", "cmd_vel_in", VELOCITY, "best effort", "a program's"),
        Topic("subscribes", "emergency_stop", BOOL, "reliable", "any number, at 5 Hz or more"),
        Topic("subscribes", "cmd_vel_standby/alive", "std_msgs/msg/Empty", "best effort", "with require_standby"),
        Topic("subscribes", "odom", "nav_msgs/msg/Odometry", "best effort", "with motion_check or geofence"),
        Topic("subscribes", "estimate", "nav_msgs/msg/Odometry", "best effort", "with geofence_topic estimate"),
        Topic("subscribes", "disagreement", "std_msgs/msg/String", "latched", "with heed_disagreement"),
        Topic("subscribes", "scan", "sensor_msgs/msg/LaserScan", "best effort", "unless collision_monitor is false"),
        Topic("subscribes", "/tf_static", TRANSFORMS, "latched", "unless collision_monitor is false"),
        Topic("publishes", "cmd_vel", VELOCITY, "reliable", "to the wheels"),
        Topic("publishes", "~/enabled", BOOL, "latched", "whether commands pass"),
        DIAGNOSTICS,
        Topic("serves", "~/enable", "std_srvs/srv/SetBool", note="let commands pass, or not"),
    ),
    "cmd_vel_standby": (
        Topic("subscribes", "cmd_vel", VELOCITY, "reliable", "of the guard"),
        Topic("publishes", "cmd_vel", VELOCITY, "reliable", "zeros, if the guard falls silent"),
        Topic("publishes", "~/alive", "std_msgs/msg/Empty", "reliable", "at 10 Hz, while a guard is there"),
        DIAGNOSTICS,
    ),
}
"""The topics and services of each node."""
MODULES = {"cmd_vel_guard": ("guard", 2), "cmd_vel_standby": ("standby", 1)}
"""The module of each node, and how many paragraphs of its docstring say what the node does."""


def help_of(name: str, program: str) -> str:
    """Return the help of a node, which ``program`` starts: "python -m cmd_vel_guard"."""
    place, number = MODULES[name]
    module = import_module(f"cmd_vel_guard.{place}")
    summary = " ".join((module.__doc__ or "").split("\n\n")[:number])
    return explain(f"{program} {name}", summary, TOPICS[name], parameters_of(module.Parameters))

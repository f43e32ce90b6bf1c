"""The guard's reports: its gravest problem in ``/diagnostics``, and in the log if it is new."""

from __future__ import annotations

import math
from collections import Counter

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node

from cmd_vel_guard.arbiter import Arbiter
from cmd_vel_guard.emergency import NONE_HEARD
from cmd_vel_guard.moved import STALE
from cmd_vel_guard.parameters import Parameters
from cmd_vel_guard.reports import ERROR, OK, WARN, log, report
from cmd_vel_guard.sent import Age
from cmd_vel_guard.sources import node_name, type_name

STANDBY = "cmd_vel_standby"
"""Name of the node that may publish commands too, if the guard dies."""
RECENT = 2.0
"""Time for which a problem with a message's time is reported, s."""


class Report:
    """The diagnostics of the guard's node and decisions; ``velocity`` is the message type of its commands."""

    def __init__(self, node: Node, arbiter: Arbiter, parameters: Parameters, velocity: type) -> None:
        self._node, self._arbiter, self._p, self._type = node, arbiter, parameters, velocity
        self._said = ""
        self._failed, self._failures = (-math.inf, ""), 0
        self._times: dict[str, tuple[float, str]] = {}
        self._ages: dict[str, str] = {}

    def note(self, topic: str, age: Age, now: float, clock: str) -> None:
        """Record the age of a topic's message at its arrival, and the lead of its clock."""
        self._ages[topic] = f"{age.measured:.2f} s old{clock}"
        if why := age.complaint(self._p.measured_age, sent=self._p.max_age):
            self._times[topic] = now, f"{topic}: {why}"

    def fail(self, why: str, now: float) -> None:
        """Record an error that a message caused; the robot stands until it is enabled."""
        self._failed, self._failures = (now, f"a message could not be handled: {why}"), self._failures + 1
        self._arbiter.halt(self._failed[1])

    def message(self, now: float, *, robots: int) -> DiagnosticArray:
        """Return the diagnostics of this second, and log new problems; ``robots`` listen to the commands."""
        node = self._node
        level, text = self._problem(now, robots)
        if text != self._said:
            log(node, level, text)
        self._said = text
        values = {f"refused, {why}": count for why, count in self._arbiter.refused.items()} | self._ages
        values |= {
            "messages that caused an error": self._failures,
            "motion check": self._motion_check(now),
            "collision monitor": "on" if self._p.monitors else "off: it does not see obstacles",
        }
        return report(node, level, text, hardware=node.get_namespace().strip("/") or "cmd_vel_guard", values=values)

    def _problem(self, now: float, robots: int) -> tuple[bytes, str]:
        """Return the level and the text of the gravest problem, or of the state."""
        node = self._node
        topics = [node.resolve_topic_name(name) for name in ("cmd_vel", "cmd_vel_teleop", "cmd_vel_in")]
        speakers = [node_name(info) for info in node.get_publishers_info_by_topic(topics[0])]
        mine = [node.get_fully_qualified_name(), f"{node.get_namespace().rstrip('/')}/{STANDBY}"]
        rivals = sorted((Counter(speakers) - Counter(mine)).elements())
        if rivals:
            return ERROR, f"{topics[0]} must have one publisher, the guard, and its standby, but has also {', '.join(rivals)}"
        if mismatch := self._mismatch(topics):
            return ERROR, mismatch
        if self._arbiter.emergency:
            service = node.resolve_service_name("~/enable")
            why = self._arbiter.buttons.trouble(now) or self._arbiter.why
            return ERROR, (f'emergency stop: {why}; then: ros2 service call {service} std_srvs/srv/SetBool "{{data: true}}"')
        if now - self._failed[0] <= RECENT:
            return ERROR, self._failed[1]
        if why := self._arbiter.buttons.trouble(now):
            return ERROR, f"{why}, so the robot stands"
        if self._arbiter.lacks_standby(now):
            return ERROR, f"{STANDBY} is not alive, so the robot stands: start it, or set require_standby to false"
        if why := self._arbiter.rivals:
            topic = node.resolve_topic_name(why.rpartition(" ")[2])
            sources = ", ".join(sorted(node_name(info) for info in node.get_publishers_info_by_topic(topic)))
            return ERROR, f"{topic} must have one source, so the robot stands: end all but one of {sources}"
        if self._arbiter.moved.lacks(now):
            return ERROR, f"{self._motion_check(now)}, so the robot stands"
        if self._p.require_emergency_stop and not self._arbiter.enabled and not self._arbiter.buttons.heard:
            return WARN, NONE_HEARD
        if self._arbiter.outside(now):
            why = f" ({self._p.geofence_topic}: {self._arbiter.lost})" if self._arbiter.lost else ""
            return WARN, f"not known to be within {self._p.geofence} m of the origin{why}: only a person drives"
        monitor = self._arbiter.monitor
        if monitor and (why := monitor.trouble(now)):
            topic = node.resolve_topic_name("scan")
            return ERROR, f"collision monitor: {topic}: {why}; the robot stands, unless collision_monitor is false"
        if monitor and monitor.state:
            return WARN, f"{self._arbiter.state}, collision monitor: {monitor.state}"
        for heard, why in self._times.values():
            if now - heard <= RECENT:
                return WARN, why
        if robots == 0:
            return WARN, f"{topics[0]} has no listener"
        if monitor and monitor.remark:
            return WARN, f"{self._arbiter.state}, collision monitor: {monitor.remark}"
        if "nothing checks" in (why := self._motion_check(now)) and self._arbiter.state in ("teleop", "program"):
            return WARN, f"{self._arbiter.state}, {why}"
        return OK, self._arbiter.state

    def _motion_check(self, now: float) -> str:
        """Return whether it is checked that the robot moves as commanded."""
        moved, topic = self._arbiter.moved, self._node.resolve_topic_name("odom")
        if self._p.motion_check and moved.at == -math.inf:
            return f"no odometry was heard on {topic}: nothing checks whether the robot moves as commanded"
        return f"{topic} is older than {STALE:g} s" if moved.lacks(now) else "on" if self._p.motion_check else "off"

    def _mismatch(self, topics: list[str]) -> str:
        """Return which node uses the other type of command, and what to type; or an empty text."""
        node, stamped = self._node, self._p.enable_stamped_cmd_vel
        for topic in topics:
            for info in (*node.get_publishers_info_by_topic(topic), *node.get_subscriptions_info_by_topic(topic)):
                if info.topic_type != type_name(self._type):
                    mine, other = (f"-p enable_stamped_cmd_vel:={str(value).lower()}" for value in (stamped, not stamped))
                    return (
                        f"{node_name(info)} has {info.topic_type} on {topic}, the guard {self._type.__name__}: start the guard "
                        f"with {other}, or that node with {mine}"
                    )
        return ""

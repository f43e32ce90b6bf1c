"""What a field test finds, judged from what was heard and measured. Does not depend on ROS.

Each function judges one matter and returns a `Finding`. Times are by the clock of the computer that listens.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from turtlebot_gym.beams import gaps_of
from turtlebot_gym.rooms.scan import Scan, beams_in
from turtlebot_gym_ros.base.sent import BOUND, JUMP, SYNCHRONIZE

FINE, WARNING, REFUSED, SKIPPED = "fine", "warning", "refused", "skipped"
"""Verdicts: as it should be; usable, with a remark; not usable; not tried."""
GAP = 0.5
"""Gap in a topic from which nodes stop the robot, s."""
SLOWEST = 5.0
"""Least rate of odometry, scans and buttons, Hz."""
USED = 0.99
"""Share of the scans that must be readable."""
BLIND = math.radians(20.0)
"""Angle without a beam from which a policy sees an unknown sector, rad."""
WITHIN = 0.02
"""Error of odometry that is as good as wheels are, as a share."""
QUICK = 0.2
"""Age of a measurement at its command that leaves the guard a margin, s; it refuses from 0.5 s on."""


class Figure(NamedTuple):
    """A number of a finding, with its 95 % interval where it has one."""

    name: str
    value: float
    unit: str = ""
    low: float = math.nan
    high: float = math.nan


class Finding(NamedTuple):
    """What one step has found."""

    name: str
    verdict: str
    text: str
    """One sentence."""
    figures: tuple[Figure, ...] = ()
    advice: str = ""
    """What to do about it; empty if nothing."""


class End(NamedTuple):
    """A publisher or a subscriber of a topic."""

    node: str
    kind: str
    """Type of its messages, such as "nav_msgs/msg/Odometry"."""
    reliable: bool


class Topic(NamedTuple):
    """A topic and what was heard on it."""

    name: str
    publishers: tuple[End, ...]
    subscribers: tuple[End, ...] = ()
    arrivals: NDArray[np.float64] = np.empty(0)
    """Times of arrival, shape (n,), s."""
    stamps: NDArray[np.float64] = np.empty(0)
    """Stamps in the headers, shape (n,), s."""


def _nobody(topic: Topic, kind: str, *, needed: bool, advice: str) -> Finding | None:
    """Return the finding of a topic that cannot be heard; None if it can."""
    verdict = REFUSED if needed else WARNING
    if not topic.publishers:
        return Finding(topic.name, verdict, f"Nobody publishes {topic.name}.", (), advice)
    if wrong := sorted({end.kind for end in topic.publishers} - {kind}):
        return Finding(topic.name, verdict, f"It is published as {' and '.join(wrong)}, not as {kind}.", (), advice)
    if len(topic.arrivals) < 2:
        text = f"{topic.publishers[0].node} announces it, but {len(topic.arrivals)} messages came."
        return Finding(topic.name, verdict, text, (), "Are both computers in one ROS domain, and does the network pass UDP?")
    return None


def judge_topic(topic: Topic, kind: str, *, needed: bool, advice: str) -> Finding:
    """Judge the publishers, the type, the rate and the gaps of a topic that must be fresh.

    Args:
        topic: The topic.
        kind: Type of message that nodes read.
        needed: Whether nothing drives without it.
        advice: What to do if it is missing.
    """
    if missing := _nobody(topic, kind, needed=needed, advice=advice):
        return missing
    between = np.diff(topic.arrivals)
    rate, longest = 1.0 / float(np.mean(between)), float(between.max())
    how = "reliable" if topic.publishers[0].reliable else "best effort"
    figures = (Figure("rate", rate, "Hz"), Figure("longest gap", longest, "s"), Figure("messages", len(topic.arrivals)))
    text = f"{kind}, {how}, from {', '.join(sorted(end.node for end in topic.publishers))}."
    if len(topic.publishers) > 1:
        return Finding(topic.name, REFUSED, text, figures, "Two nodes publish it, and nodes refuse it then: end one of them.")
    if longest > GAP:
        advice = f"A gap of more than {GAP:g} s stops the robot: is the network or the robot's processor busy?"
        return Finding(topic.name, WARNING, text, figures, advice)
    if rate < SLOWEST:
        advice = f"At less than {SLOWEST:g} Hz a robot drives too far between two messages."
        return Finding(topic.name, WARNING, text, figures, advice)
    return Finding(topic.name, FINE, text, figures)


def judge_clock(name: str, arrivals: ArrayLike, stamps: ArrayLike) -> Finding:
    """Judge the clock of a sender by its stamps.

    The largest lead of a stamp before its arrival, that of the least delayed message, is the lead of the clock minus the least
    delay; how far a stamp's lead falls short of it is that message's further delay.
    """
    arrived, stamped = np.asarray(arrivals, np.float64), np.asarray(stamps, np.float64)
    name = f"clock of {name}"
    if not len(arrived):
        return Finding(name, SKIPPED, "No message with a stamp came.")
    if not stamped.all():
        return Finding(name, REFUSED, "Messages have no stamp.", (), "Nodes cannot tell how old they are: mend the driver.")
    leads = stamped - arrived
    lead, late = float(leads.max()), float(np.percentile(leads.max() - leads, 99.0))
    figures = (Figure("lead", lead, "s"), Figure("delay beyond the least, 99 %", late, "s"))
    side = "ahead of" if lead > 0.0 else "behind"
    text = f"Its clock is {abs(lead):.3f} s {side} this computer's, or its messages are that late."
    if lead > BOUND or lead < -GAP:
        return Finding(name, REFUSED, text, figures, f"Nodes refuse its messages: {SYNCHRONIZE}.")
    if abs(lead) > JUMP:
        advice = f"Run the guard on the robot; a lead of up to {BOUND:g} s is made up for, but {SYNCHRONIZE}."
        return Finding(name, WARNING, text, figures, advice)
    return Finding(name, FINE, text, figures)


def judge_odometry(variances: ArrayLike, twists: ArrayLike) -> Finding:
    """Judge what odometry says about itself.

    Args:
        variances: Variances of x, y and heading, shape (n, 3).
        twists: Speed and turning rate, shape (n, 2), at rest.
    """
    variances, twists = np.asarray(variances, np.float64), np.asarray(twists, np.float64)
    if not (np.isfinite(variances).all() and np.isfinite(twists).all()):
        return Finding("odometry", REFUSED, "It has values that are not finite.", (), "Nodes refuse them: mend the driver.")
    fastest = abs(twists).max(axis=0).tolist()
    figures = (Figure("speed at rest", fastest[0], "m/s"), Figure("turning rate at rest", fastest[1], "rad/s"))
    if not variances.any():
        advice = "So the filter's noise says how good it is: calibrate, as below."
        return Finding("odometry", WARNING, "All its covariances are 0, as TurtleBot3s send.", figures, advice)
    return Finding("odometry", FINE, "It states covariances.", figures)


def judge_scans(scans: Sequence[Scan]) -> Finding:
    """Judge scans as their driver sends them."""
    widths, lost, nothing, blind, refused = [], [], [], [], ""
    for scan in scans:
        try:
            beams = beams_in(scan)
        except ValueError as error:
            refused = str(error)
            continue
        widths.append(len(beams.ranges))
        lost.append(np.isnan(beams.ranges).mean())
        nothing.append(np.isinf(beams.ranges).mean())
        blind.append(float(gaps_of(beams)[:, 2].max(initial=beams.spacing)))
    share = len(widths) / len(scans) if scans else 0.0
    if not widths:
        text = f"None can be read: {refused or 'there is none'}."
        return Finding("scans", REFUSED if scans else SKIPPED, text, (), "Policies for rooms need them.")
    figures = (
        Figure("read", 100.0 * share, "%"),
        Figure("fewest beams", min(widths)),
        Figure("most beams", max(widths)),
        Figure("missing beams", 100.0 * float(np.mean(lost)), "%"),
        Figure("beams without a return", 100.0 * float(np.mean(nothing)), "%"),
        Figure("widest gap", math.degrees(max(blind)), "degrees"),
    )
    text = f"{len(widths)} of {len(scans)} can be read."
    if share < USED:
        return Finding("scans", REFUSED, text, figures, f"The others: {refused}.")
    if max(blind) > BLIND:
        advice = "Sectors without a beam are unknown to policies, and the collision monitor slows down towards them."
        return Finding("scans", WARNING, text, figures, advice)
    return Finding("scans", FINE, text, figures)


OURS = ("cmd_vel_guard", "cmd_vel_standby")
"""The nodes that may publish what the wheels obey."""


def judge_wheels(topic: Topic, *, kinds: Sequence[str]) -> Finding:
    """Judge who listens to commands and who sends them; ``kinds`` are the types of a velocity."""
    name, ours = "wheels", {end.node for end in topic.publishers if end.node in OURS}
    listeners = {end.kind for end in topic.subscribers}
    if not topic.subscribers:
        return Finding(name, REFUSED, f"Nobody listens to {topic.name}.", (), "Start the robot's bring-up.")
    if len(listeners) > 1 or not listeners <= set(kinds):
        text = f"{topic.name} is heard as {' and '.join(sorted(listeners))}."
        return Finding(name, REFUSED, text, (), "One of its listeners will hear nothing: give all the same type.")
    if wrong := sorted({end.kind for end in topic.publishers} - listeners):
        text = f"The robot hears {listeners.pop()}, but {' and '.join(wrong)} is sent: it would hear nothing."
        return Finding(name, REFUSED, text, (), "Set enable_stamped_cmd_vel of guard and standby to what the robot hears.")
    if others := sorted({end.node for end in topic.publishers} - ours):
        text = f"Besides the guard, {', '.join(others)} sends commands to the wheels."
        return Finding(name, REFUSED, text, (), "End it, or remap its cmd_vel to cmd_vel_teleop: the guard then decides.")
    return Finding(name, FINE, f"They hear {listeners.pop()}.")


def judge_guard(topic: Topic) -> Finding:
    """Judge who keeps the wheels, by the publishers of their commands."""
    nodes = {end.node for end in topic.publishers}
    if missing := [name for name in OURS if name not in nodes]:
        advice = "Start both on the robot: ros2 launch turtlebot_gym_ros robot.launch.xml, or here with --with-guard."
        return Finding("guard", REFUSED, f"Missing: {' and '.join(missing)}.", (), advice)
    return Finding("guard", FINE, "Guard and standby run.")


def judge_button(topic: Topic, *, pressed: bool) -> Finding:
    """Judge the emergency stop before it is tried."""
    advice = 'Start one within reach: ros2 topic pub --rate 10 /emergency_stop std_msgs/msg/Bool "{data: false}"'
    if deaf := [end.node for end in topic.publishers if not end.reliable]:
        text = f"{', '.join(deaf)} publishes best effort: the guard hears nothing of it."
        return Finding("emergency stop", REFUSED, text, (), "Publish it reliably.")
    if missing := _nobody(topic, "std_msgs/msg/Bool", needed=True, advice=advice):
        return missing._replace(name="emergency stop")
    rate = 1.0 / float(np.mean(np.diff(topic.arrivals)))
    figures = (Figure("rate", rate, "Hz"), Figure("buttons", len(topic.publishers)))
    if rate < SLOWEST:
        return Finding("emergency stop", REFUSED, "It speaks too rarely.", figures, f"Publish at {SLOWEST:g} Hz or more.")
    if pressed:
        return Finding("emergency stop", REFUSED, "It is pressed.", figures, "Release it.")
    return Finding("emergency stop", FINE, "It is alive and released.", figures)


def judge_press(delay: float | None) -> Finding:
    """Judge a press of the emergency stop by the time until the guard said that it stopped, s; None if it did not."""
    if delay is None:
        text = "The guard did not stop when the emergency stop was pressed, or nobody pressed it."
        return Finding("a press", REFUSED, text, (), "Do not drive. Does it publish on the guard's emergency_stop?")
    figures = (Figure("from press to stop", delay, "s"),)
    return Finding("a press", FINE, "The guard stops, and says so.", figures)


def judge_measure(name: str, unit: str, *, by_odometry: float, measured: float | None, uncertainty: float) -> Finding:
    """Compare a motion by odometry with what a person has measured.

    Args:
        name: What was driven.
        unit: Its unit.
        by_odometry: What odometry says.
        measured: What the person measured; None if nothing.
        uncertainty: Half of the 95 % interval of that measurement.
    """
    odometry = Figure("by odometry", by_odometry, unit)
    if measured is None:
        return Finding(name, SKIPPED, "Nobody measured it.", (odometry,))
    if abs(by_odometry) <= 10.0 * uncertainty:
        text = f"By odometry the robot moved by {by_odometry:.3g} {unit}: too little to compare."
        return Finding(name, REFUSED, text, (odometry,), "Did the wheels turn? Does the guard let commands pass?")
    share, off = measured / by_odometry, uncertainty / abs(by_odometry)
    figures = (
        odometry,
        Figure("measured", measured, unit, measured - uncertainty, measured + uncertainty),
        Figure("measured over odometry", share, "", share - off, share + off),
    )
    if abs(share - 1.0) > WITHIN + off:
        advice = "Odometry is off by more than wheels are: the noise file below corrects it for the filter `calibrated`."
        return Finding(name, WARNING, f"The robot moved {100.0 * share:.1f} % of what odometry says.", figures, advice)
    return Finding(name, FINE, "Odometry agrees.", figures)


def judge_latency(ages: ArrayLike) -> Finding:
    """Judge the times from the arrival of odometry to that of the command that rests on it, s."""
    ages = np.asarray(ages, np.float64)
    if not len(ages):
        return Finding("latency", SKIPPED, "No command was found with the stamp of its odometry.")
    median, most = float(np.median(ages)), float(np.percentile(ages, 99.0))
    figures = (Figure("median", 1e3 * median, "ms"), Figure("99 %", 1e3 * most, "ms"), Figure("commands", len(ages)))
    if most > QUICK:
        advice = "The guard refuses commands that rest on older measurements than 0.5 s: is this computer busy?"
        return Finding("latency", WARNING, "From odometry to the command that rests on it.", figures, advice)
    return Finding("latency", FINE, "From odometry to the command that rests on it.", figures)


def passed(findings: Sequence[Finding]) -> bool:
    """Return whether nothing was refused."""
    return all(finding.verdict != REFUSED for finding in findings)

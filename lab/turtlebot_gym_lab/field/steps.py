"""The steps of a field test, in order: each returns its findings. Steps that move the robot wait for a person's word."""

from __future__ import annotations

import math
import re
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from turtlebot_gym import Noise, write_parameters
from turtlebot_gym.rooms.scan import scan_of
from turtlebot_gym_lab.calibration import CalibrationEstimate, Leg, calibrate_by_tape
from turtlebot_gym_lab.calibration.fit import Z
from turtlebot_gym_lab.field import findings
from turtlebot_gym_lab.field.findings import FINE, REFUSED, SKIPPED, WARNING, Figure, Finding
from turtlebot_gym_lab.field.measured import MeasuredDrive
from turtlebot_gym_lab.field.session import COMMANDS, VELOCITIES, Part, drive, enable, wait_for
from turtlebot_gym_lab.field.shared import QUIET, Field, drive_since, ends_of, poses_since, relative, turned
from turtlebot_gym_ros.base.process import go_on, processes
from turtlebot_gym_ros.blocks import CalibrationDrive, KalmanFilter, VelocityController, WaypointGenerator

NOISE = "noise.yaml"
"""Name of the noise file."""
STARTING, PRESSING = 15.0, 30.0
"""Longest wait for the first messages, and for a press of the emergency stop, s."""


def hear(at: Field) -> list[Finding]:
    """Listen to odometry, scans and clocks, without any motion."""
    listener = at.listener
    wait_for(lambda: all(len(listener.heard[topic]) for topic in ("odom", "scan", "emergency_stop")), STARTING)
    time.sleep(at.seconds)
    odometry, scans = listener.topic("odom"), listener.topic("scan")
    up = "Start the robot's bring-up; on another computer, set ROS_DOMAIN_ID and ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET."
    seen = [findings.judge_topic(odometry, "nav_msgs/msg/Odometry", needed=True, advice=up)]
    without = "Without a LiDAR there are no policies for rooms and no collision monitor."
    seen.append(findings.judge_topic(scans, "sensor_msgs/msg/LaserScan", needed=False, advice=without))
    seen += [findings.judge_clock(stream.name, stream.arrivals, stream.stamps) for stream in (odometry, scans)]
    messages = [odometry.message for odometry in list(listener.heard["odom"])]
    if messages:
        variances = [[message.pose.covariance[n] for n in (0, 7, 35)] for message in messages]
        twists = [[message.twist.twist.linear.x, message.twist.twist.angular.z] for message in messages]
        seen.append(findings.judge_odometry(variances, twists))
    sent = [scan_of(scan.message) for scan in list(listener.heard["scan"])]
    seen.append(findings.judge_scans(sent))
    if sent and seen[-1].verdict != REFUSED:
        at.scan = ends_of(sent[-1])
    return seen


def meet_the_wheels(at: Field) -> list[Finding]:
    """Find out what the wheels hear, who keeps them, and who else speaks to them."""
    topic = at.listener.topic("cmd_vel")
    robot = replace_ends(topic, findings.OURS)
    at.stamped = "geometry_msgs/msg/Twist" not in {end.kind for end in robot.subscribers}
    at.listener.hear("cmd_vel_in", VELOCITIES[f"geometry_msgs/msg/Twist{'Stamped' * at.stamped}"])
    return [findings.judge_wheels(robot, kinds=list(VELOCITIES)), findings.judge_guard(topic)]


def replace_ends(topic: findings.Topic, ours: Sequence[str]) -> findings.Topic:
    """Return a topic without the subscriptions of our own nodes: the standby hears what the guard sends."""
    return topic._replace(subscribers=tuple(end for end in topic.subscribers if end.node not in ours))


def find_the_button(at: Field) -> list[Finding]:
    """Look whether an emergency stop is alive."""
    pressed = at.listener.said("emergency_stop", True)
    return [findings.judge_button(at.listener.topic("emergency_stop"), pressed=pressed)]


def try_the_button(at: Field) -> list[Finding]:
    """Have a person press the emergency stop, and time the guard; nothing moves."""
    listener, enabled = at.listener, "cmd_vel_guard/enabled"
    if why := enable(listener, "cmd_vel_guard"):
        return [Finding("a press", REFUSED, f"The guard refuses: {why}.")]
    wait_for(lambda: listener.said(enabled, True))
    first = len(listener.heard["emergency_stop"])
    if not at.person.confirm(
        "press", "Press the emergency stop for a second and release it, or end its program and start it again"
    ):
        return [Finding("a press", SKIPPED, "Nobody pressed the emergency stop.")]
    if not wait_for(lambda: listener.said(enabled, False), PRESSING):
        return [findings.judge_press(None)]
    stopped = listener.heard[enabled][-1].arrival
    messages = [message for message in listener.heard["emergency_stop"][first:] if message.arrival <= stopped]
    presses = [message for message in messages if message.message.data] or messages[-1:]  # or its silence
    wait_for(lambda: listener.said("emergency_stop", False), PRESSING)
    return [findings.judge_press(stopped - presses[0].arrival if presses else None)]


def record(at: Field) -> list[Finding]:
    """Start the recorder: everything from here on is in the bag."""
    folder = at.folder / "bag"
    at.recording.enter_context(processes([("data_logger", {"output": str(folder)})], QUIET))
    if not wait_for(lambda: "data_logger" in at.listener.node.get_node_names(), STARTING):
        return [Finding("recording", WARNING, "The recorder does not run.", (), "python -m turtlebot_gym_ros data_logger")]
    return [Finding("recording", FINE, f"Everything that is sent is recorded in {folder.name}/, beside this page.")]


def drive_straight(at: Field) -> list[Finding]:
    """Drive a straight, and have it measured."""
    ask = f"How far did it drive? Measure in m, or leave it empty (odometry's target: {at.distance:g} m)"
    return _measured(at, "a straight", "m", at.distance, turns=False, uncertainty=at.tape, ask=ask)


def turn_round(at: Field) -> list[Finding]:
    """Turn on the spot, and have it measured."""
    ask = f"By how much did it turn in all? In degrees, or leave it empty (odometry's target: {at.turn:g})"
    return _measured(at, "a turn", "degrees", at.turn, turns=True, uncertainty=at.protractor, ask=ask)


def _measured(at: Field, name: str, unit: str, amount: float, *, turns: bool, uncertainty: float, ask: str) -> list[Finding]:
    scale = math.pi / 180.0 if turns else 1.0
    speed = {"speed": 0.8} if turns else {}
    part = Part(MeasuredDrive, "field_drive", {"robot": at.robot, "turns": turns, "amount": amount * scale, **speed}, COMMANDS)
    if why := _drive(at, [part], timeout=60.0 + 20.0 * amount * scale):
        return [Finding(name, REFUSED, f"The drive ended early: {why}.")]
    poses = poses_since(at, at.begun)
    by_odometry = turned(poses) / scale if turns else math.hypot(poses[-1].x - poses[0].x, poses[-1].y - poses[0].y)
    measured = at.person.number(name.replace(" ", "_"), ask)
    judged = findings.judge_measure(name, unit, by_odometry=by_odometry, measured=measured, uncertainty=uncertainty)
    if judged.verdict in (FINE, WARNING) and measured is not None:
        deviations = {"place_deviation": at.tape / Z, "heading_deviation": math.radians(at.protractor) / Z}
        size: dict[str, float] = {"turn" if turns else "distance": measured * scale}
        at.measured.append(Leg(drive=drive_since(at, at.begun), **size, **deviations))
    return [judged]


def drive_for_calibration(at: Field) -> list[Finding]:
    """Drive the calibration's script."""
    parameters = {"robot": at.robot, "duration": at.duration, "radius": 1.0}
    part = Part(CalibrationDrive, "field_calibration", parameters, COMMANDS)
    if why := _drive(at, [part], timeout=at.duration + 60.0):
        return [Finding("calibration drive", REFUSED, f"It ended early: {why}.")]
    return [Finding("calibration drive", FINE, "It was driven to its end.", (Figure("length", at.duration, "s"),))]


def drive_a_square(at: Field) -> list[Finding]:
    """Drive a square with filter, policy and guard, and time it."""
    topics = {name: f"field_test/{name}" for name in ("estimate", "nis", "reference", "next_reference", "goal_pose")}
    side, begun = at.side, time.monotonic()
    corners = [[side, 0.0, 0.0], [side, side, 0.5 * math.pi], [0.0, side, -math.pi], [0.0, 0.0, -0.5 * math.pi]]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "square.csv"
        path.write_text("\n".join(",".join(map(str, corner)) for corner in corners))
        course = {"waypoints": str(path), "relative": True, "radius": 0.15}
        parts = [
            Part(KalmanFilter, "field_filter", {"robot": at.robot, "noise": "wheel"}, topics),
            Part(WaypointGenerator, "field_waypoints", course, topics),
            Part(VelocityController, "field_controller", {"robot": at.robot, "policy": "bearing"}, {**topics, **COMMANDS}),
        ]
        why = _drive(at, parts, timeout=60.0 + 60.0 * side)
    poses = poses_since(at, at.begun)
    at.paths["odometry"] = relative(poses)
    at.paths["the square"] = np.array([[0.0, 0.0], *([x, y] for x, y, _ in corners)])
    if why:
        return [Finding("a square", REFUSED, f"The drive ended early: {why}.")]
    figures = [Figure("time", time.monotonic() - begun, "s")]
    figures.append(Figure("from the start, by odometry", math.dist(poses[-1][:2], poses[0][:2]), "m"))
    if (off := at.person.number("square", "How far is it from the mark at the start? In m, or leave it empty")) is not None:
        figures.append(Figure("from the start, measured", off, "m", max(off - at.tape, 0.0), off + at.tape))
    return [Finding("a square", FINE, "It came round, through the guard.", tuple(figures))]


def time_the_chain(at: Field) -> list[Finding]:
    """Time odometry to the command that rests on it, which has its stamp."""
    arrivals = {odometry.stamp: odometry.arrival for odometry in at.listener.heard["odom"]}
    commands = at.listener.heard.get("cmd_vel_in", [])
    ages = [command.arrival - arrivals[command.stamp] for command in commands if command.stamp and command.stamp in arrivals]
    return [findings.judge_latency(ages)]


def calibrate(at: Field) -> list[Finding]:
    """Fit a noise model to the bag; without a truth, use what was measured."""
    at.recording.close()
    noise, seen = _by_tape(at)
    try:
        from turtlebot_gym_lab.calibration import calibrate as fit
        from turtlebot_gym_lab.drives import read

        fitted = fit(read(at.folder / "bag"), kind="wheel")
    except (ValueError, OSError, ImportError) as error:
        seen.append(Finding("calibration", SKIPPED, f"{' '.join(str(error).split())}".rstrip(".") + "."))
    else:
        verdict, text = FINE if fitted.verdict.is_good else WARNING, f"Fitted to the recorded truth. {fitted.verdict.text}"
        seen.append(Finding("calibration", verdict, text, _figures(fitted.estimates), "; ".join(fitted.remarks)))
        noise = fitted.noise if fitted.verdict.is_good else noise
    if noise:
        write_parameters(noise, at.folder / NOISE, comment="By a field test: --noise takes it.")
        last = seen[-1] if seen[-1].verdict == FINE else seen[0]
        seen[seen.index(last)] = last._replace(text=f"{last.text} {NOISE}, beside this page, holds them.")
    return seen


def _by_tape(at: Field) -> tuple[Noise | None, list[Finding]]:
    """Return the preset ``wheel`` with the wheels that were measured, if any were."""
    if not at.measured:
        return None, []
    try:
        fitted = calibrate_by_tape(at.measured)
    except ValueError as error:
        return None, [Finding("by tape", SKIPPED, str(error))]
    estimates = {name: estimate for name, estimate in fitted.estimates.items() if estimate.is_determined}
    text = "The wheels' scales, for the preset `wheel`."
    return fitted.noise, [Finding("by tape", FINE, text, _figures(estimates))]


def _figures(estimates: Mapping[str, CalibrationEstimate]) -> tuple[Figure, ...]:
    return tuple(Figure(name, fit.value, fit.unit, fit.low, fit.high) for name, fit in estimates.items())


def _drive(at: Field, parts: Sequence[Part], *, timeout: float) -> str:
    """Drive, and again where it ended early and the person agrees; return why it was not done, or an empty text."""
    for last in (False, False, True):
        at.begun = max(len(at.listener.heard["odom"]) - 1, 0)
        why = drive(at.listener, parts, stamped=at.stamped, timeout=timeout)
        if not why or last or not at.person.confirm("again", f"The drive ended early: {why}. Put it back, and try again"):
            break
    return why


class FieldStep(NamedTuple):
    """A step of the test."""

    name: str
    run: Callable[[Field], list[Finding]]
    asks: str = ""
    """What the person must agree to before the robot moves; empty for a step without motion."""
    amount: str = ""
    """Field that says how much to drive; with 0 the step is left out."""
    needs_robot: bool = True
    """Whether it is left out where something essential was refused."""
    essential: tuple[str, ...] = ()
    """Findings of this step without which nothing moves later; topics without their namespace."""


STEPS = (
    FieldStep("listening", hear, needs_robot=False, essential=("/odom", "clock of /odom", "odometry")),
    FieldStep("wheels", meet_the_wheels, needs_robot=False, essential=("wheels", "guard")),
    FieldStep("emergency stop", find_the_button, needs_robot=False, essential=("emergency stop",)),
    FieldStep("a press", try_the_button, essential=("a press",)),
    FieldStep("recording", record),
    FieldStep("a straight", drive_straight, "The robot will drive {distance:g} m straight ahead. Mark its place", "distance"),
    FieldStep("a turn", turn_round, "The robot will turn by {turn:g} degrees on the spot. Mark its heading", "turn"),
    FieldStep("calibration drive", drive_for_calibration, "The robot will drive for {duration:g} s, within 1 m", "duration"),
    FieldStep("a square", drive_a_square, "The robot will drive a square of {side:g} m to the left. Mark its place", "side"),
    FieldStep("latency", time_the_chain),
    FieldStep("calibration", calibrate),
)
"""The steps in order."""


def walk(at: Field, seen: list[Finding], report: Callable[[Finding], Any] = lambda finding: None) -> None:
    """Take all steps, and add their findings to ``seen`` as they come; on an interruption they stay there."""
    needed: list[str] = []
    for step in STEPS:
        go_on()
        if step.amount and not getattr(at, step.amount):
            new = [Finding(step.name, SKIPPED, f"Left out: --{step.amount} is 0.")]
        elif step.needs_robot and (missing := _missing(needed, seen)):
            new = [Finding(step.name, SKIPPED, f"Left out without: {', '.join(missing)}.")]
        elif step.asks and not at.person.confirm(step.name.replace(" ", "_"), step.asks.format(**vars(at))):
            new = [Finding(step.name, SKIPPED, "The person did not agree.")]
        else:
            new = step.run(at)
        for finding in new:
            seen.append(finding)
            report(finding)
        needed += step.essential


def _missing(needed: Sequence[str], seen: Sequence[Finding]) -> list[str]:
    """Return the essential findings that did not come, or are not as they must be."""
    verdicts = {re.sub("/.*/", "/", finding.name): finding.verdict for finding in seen}
    return [name for name in needed if verdicts.get(name) not in (FINE, WARNING)]

"""Lies of a driver that lives: what it says instead of the truth, by name; without ROS.

Each maker takes a generator, which chooses among the members of its class, and returns a new lie.
"""

from __future__ import annotations

import math
import random
from collections import deque
from collections.abc import Callable

from faults_driver import Lie, Said

Maker = Callable[[random.Random], Lie]
"""Makes a lie."""


def changed(change: Callable[[Said], Said]) -> Maker:
    """Return the maker of a lie that depends on one message only."""
    return lambda rng: lambda said, now: change(said)


def frozen(*fields: str) -> Maker:
    """Return the maker of a lie in which fields keep their first values, to the bit or with a noise of 0.1 mm and mrad."""

    def make(rng: random.Random) -> Lie:
        kept: list[Said] = []
        noise = rng.choice([0.0, 1e-4])

        def lie(said: Said, now: float) -> Said:
            kept.append(said)
            return said._replace(**{name: getattr(kept[0], name) + rng.gauss(0.0, noise) for name in fields})

        return lie

    return make


def scaled(lengths: float = 1.0, *, heading: float = 1.0, turning: float = 1.0) -> Callable[[Said], Said]:
    """Return the change by which lengths and speeds, headings and turning rates are multiplied."""

    def change(said: Said) -> Said:
        x, y, v = (lengths * length for length in (said.x, said.y, said.v))
        return said._replace(x=x, y=y, v=v, theta=heading * said.theta, omega=turning * said.omega)

    return change


def degrees(rng: random.Random) -> Lie:
    """Heading, turning rate or both are in degrees."""
    heading, turning = rng.choice([(True, False), (False, True), (True, True)])
    factor = math.degrees(1.0)
    return lambda said, now: scaled(heading=factor if heading else 1.0, turning=factor if turning else 1.0)(said)


def wrong_scale(rng: random.Random) -> Lie:
    """The driver takes the wheels for 1.5 to 3 times as large as they are; or only its speed is wrong, not its way."""
    factor = rng.uniform(1.5, 3.0)
    change = rng.choice([scaled(factor), lambda said: said._replace(v=factor * said.v)])
    return lambda said, now: change(said)


def late_heading(rng: random.Random) -> Lie:
    """The heading is that of 0.3 to 0.5 s ago, as by a slow IMU."""
    late, kept = rng.uniform(0.3, 0.5), deque[tuple[float, Said]]()

    def lie(said: Said, now: float) -> Said:
        kept.append((now, said))
        while len(kept) > 1 and kept[1][0] <= now - late:
            kept.popleft()
        return said._replace(theta=kept[0][1].theta)

    return lie


def reset_at(distance: float) -> Maker:
    """Return the maker of a lie by which the odometry begins anew once, when it states a distance from its start, m."""

    def make(rng: random.Random) -> Lie:
        first: list[Said] = []
        zero: list[Said] = []

        def lie(said: Said, now: float) -> Said:
            first.append(said)
            if not zero and math.hypot(said.x - first[0].x, said.y - first[0].y) > distance:
                zero.append(said)
            return _moved_to_zero(said, zero[0]) if zero else said

        return lie

    return make


def _moved_to_zero(said: Said, zero: Said) -> Said:
    """Return what is said from a pose that counts as zero; its heading is not reset, as it comes from the IMU."""
    return said._replace(x=said.x - zero.x, y=said.y - zero.y)


def leap(rng: random.Random) -> Lie:
    """The pose leaps once by 0.1 to 3 m, as when an odometry far from its start is reset."""
    distance, direction = rng.choice([0.1, 0.2, 0.35, 0.5, 0.8, 1.25, 2.0, 3.0]), rng.uniform(-math.pi, math.pi)
    dx, dy = distance * math.cos(direction), distance * math.sin(direction)
    return lambda said, now: said._replace(x=said.x + dx, y=said.y + dy)


def heading_leaps(rng: random.Random) -> Lie:
    """The heading leaps once by 0.4 to 3.1 rad."""
    turn = rng.choice([-1.0, 1.0]) * rng.uniform(0.4, math.pi)
    return lambda said, now: said._replace(theta=said.theta + turn)


def replayed(rng: random.Random) -> Lie:
    """The messages of the last second or two are said again and again, with fresh stamps."""
    length, kept = rng.randrange(20, 40), list[Said]()
    calls = iter(range(10**9))

    def lie(said: Said, now: float) -> Said:
        if len(kept) < length:
            kept.append(said)
            return said
        return kept[next(calls) % length]

    return lie


def two_robots(rng: random.Random) -> Lie:
    """One node says in turn where two robots are, which are 0.3 to 2 m apart."""
    away, turn = rng.uniform(0.3, 2.0), iter(range(10**9))
    return lambda said, now: said._replace(y=said.y + away) if next(turn) % 2 else said


def in_the_world(said: Said) -> Said:
    """The twist is in the frame of the pose, as a tutorial's."""
    return said._replace(v=said.v * math.cos(said.theta), across=said.v * math.sin(said.theta))


def another_frame(rng: random.Random) -> Lie:
    """The pose is in another frame, or is that of another body."""
    other = rng.choice([{"frame": "map"}, {"frame": ""}, {"frame": "robot2/odom"}])
    return lambda said, now: said._replace(**other)


FROM_THEN_ON: dict[str, Maker] = {
    "pose frozen": frozen("x", "y", "theta"),
    "twist frozen": frozen("v", "omega"),
    "pose and twist frozen": frozen("x", "y", "theta", "v", "omega"),
    "position frozen": frozen("x", "y"),
    "heading frozen": frozen("theta"),
    "twist zero": changed(lambda said: said._replace(v=0.0, omega=0.0)),
    "pose zero": changed(lambda said: said._replace(x=0.0, y=0.0, theta=0.0)),
    "odometry reset": leap,
    "heading leaps": heading_leaps,
    "old odometry with fresh stamps": replayed,
    "odometry of another frame": another_frame,
    "odometry of two robots by one node": two_robots,
}
"""Lies of a driver that breaks while it drives."""
FROM_THE_START: dict[str, Maker] = {
    "turning rate of wrong sign": changed(lambda said: said._replace(omega=-said.omega)),
    "speed of wrong sign": changed(lambda said: said._replace(v=-said.v)),
    "heading of wrong sign": changed(lambda said: said._replace(theta=-said.theta)),
    "odometry in mm": changed(scaled(1000.0)),
    "odometry in cm": changed(scaled(100.0)),
    "degrees instead of radians": degrees,
    "twist in the world's frame": changed(in_the_world),
    "x and y swapped": changed(lambda said: said._replace(x=said.y, y=said.x)),
    "late heading": late_heading,
    "wrong scale": wrong_scale,
}
"""Lies of a driver that was set up wrongly."""
TURNING = frozenset(
    {
        "twist frozen",
        "heading frozen",
        "turning rate of wrong sign",
        "heading of wrong sign",
        "degrees instead of radians",
        "twist in the world's frame",
        "late heading",
    }
)
"""Lies that show only while the robot turns."""

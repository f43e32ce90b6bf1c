"""Which beams speak for a pose, which against it: those that pass through a surface of the map. The unknown says nothing.

A beam that ends before the surface that it should meet may have met what moves, or what is not on the map; it says little about
the place, whether that is right or wrong. A beam that goes on behind a wall cannot be explained like that.
"""

from __future__ import annotations

from typing import Any

from turtlebot_gym.kernel import kernel, sqrt
from turtlebot_gym.localization.information import Guess, ScanPoints
from turtlebot_gym.localization.points import DX, DY, LENGTH, X, Y
from turtlebot_gym.localization.tuning import LocalizerTuning
from turtlebot_gym.models.angles import sincos
from turtlebot_gym.rooms.field import at_cell

ON_SURFACE = 0.75
"""Distance within which a beam is at a surface, in cells."""
BEGIN = 0.1
"""Distance from the LiDAR from which on a beam is followed, m: the robot itself may stand close to a wall."""
SILENT_BEAMS = 0.2
"""Share of a scan's beams that may end in the unknown without a loss: a pose of which the map knows little is not confirmed."""
AGAINST = 0.1
"""Share of beams that must speak against a pose to contradict it."""
BLIND_STEP = 4.0
"""Step of a beam through the unknown, in cells."""


@kernel
def distance_at(field: Any, frame: Any, x: float, y: float) -> float:
    """Return the distance of the cell at a point, m; NaN in the unknown and beside the map."""
    rows, columns = field.shape
    dx, dy, per_cell = x - float(frame[0]), y - float(frame[1]), 1.0 / float(frame[4])
    across = (dx * float(frame[2]) + dy * float(frame[3])) * per_cell
    up = (dy * float(frame[2]) - dx * float(frame[3])) * per_cell
    inside = (across >= 0.0) & (up >= 0.0) & (across < columns) & (up < rows)
    return at_cell(field, int(up), int(across)) if inside else float("nan")


@kernel
def verdict(sight: ScanPoints, at: Guess, q: LocalizerTuning) -> tuple[float, float, float]:
    """Return the shares of a scan's beams that speak for a pose, against it, and not at all.

    For it are ends near a surface, against it beams through a surface, and `short` of those that end short.
    """
    field, frame, points, number = sight
    sine, cosine = sincos(at.theta)
    side, fit, against, silent = float(frame[4]), 0.0, 0.0, 0.0
    for k in range(number):
        length, dx, dy = float(points[LENGTH, k]), float(points[DX, k]), float(points[DY, k])
        end_x, end_y = float(points[X, k]), float(points[Y, k])
        x, y = at.x + cosine * end_x - sine * end_y, at.y + sine * end_x + cosine * end_y
        ux, uy = cosine * dx - sine * dy, sine * dx + cosine * dy
        deviation = max(q.deviation, q.deviation_share * length)
        near = max(q.near, q.gate * sqrt(deviation * deviation + q.grain * q.grain))
        d = distance_at(field, frame, x, y)
        if d == d and abs(d) < near:
            fit += 1.0
            continue
        passes, back = False, length - BEGIN
        while back > near and not passes:
            before = distance_at(field, frame, x - back * ux, y - back * uy)
            passes = before < ON_SURFACE * side
            back -= max(before - 0.5 * side, side) if before == before else BLIND_STEP * side
        against += 1.0 if passes else (q.short if d == d else 0.0)
        silent += 0.0 if passes or d == d else 1.0
    return fit / max(number, 1), against / max(number, 1), silent / max(number, 1)


@kernel
def agreeing(sight: ScanPoints, at: Guess, q: LocalizerTuning) -> float:
    """Return the share of the beams that speak for a pose among those that speak; too many silent ones count as against it."""
    fit, against, silent = verdict(sight, at, q)
    return fit / max(fit + against + max(silent - SILENT_BEAMS, 0.0), 1e-9)

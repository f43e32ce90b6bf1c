"""Scan against scan: the motion between two scans by the distance of the points of one from lines through those of the other.

A line goes through the points of the first scan around each of its points. A point of the second scan is as far from the first
as from the line of the nearest point. Gauss-Newton steps bring it there, with weights for what only one of the scans sees.

References:
    Censi, "An ICP variant using a point-to-line metric", ICRA (2008).
    Censi, "An accurate closed-form estimate of ICP's covariance", ICRA (2007): the information of a match.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from turtlebot_gym.kernel import kernel, sqrt
from turtlebot_gym.localization.points import LENGTH, X, Y
from turtlebot_gym.models.angles import sincos
from turtlebot_gym.values import Pose

CX, CY, NX, NY, SPREAD, GOOD = range(6)
"""Rows of an array of lines, shape (6, n): a point on each, m, its normal, the standard deviation of a point from it, m, and
whether there is one, 1 or 0."""
NEAR, SPACING = 0.2, 4.0
"""Radius around a point whose points make its line, m, or as a number of the distances between two beams if that is more."""
FEWEST = 5
"""Fewest points of a line."""
FLAT = 0.3
"""Largest ratio of a line's variances across and along it."""
WIDE, TIGHT = 0.6, 0.15
"""Distance to the nearest point beyond which a point has no line, m: in the first step, and in the last ones."""
NOISE, SHARE = 0.005, 0.005
"""Least standard deviation of a point from its line, m, and as a share of its range."""
GATE = 3.0
"""Standard deviations at which a point's weight has fallen to a quarter."""
SEEN = 0.3
"""Least share of a scan's points that must be near a line of the other one."""
STEPS, SETTLED = 25, 3e-5
"""Most Gauss-Newton steps, and the change, m and rad, at which they end."""
WHOLE, BESIDE = 4, 12
"""Steps in which the nearest point is sought in the whole scan; then only so many beams beside the last one."""
WEAK = 25.0
"""Information of the start, 1/m^2 and 1/rad^2: 0.2 m and 0.2 rad. It keeps an endless corridor solvable."""


@kernel
def lines_of(points: Any, number: int, spacing: float, lines: Any) -> None:
    """Write the line around each point of a scan.

    Args:
        points: The scan, see `localization.points.to_points`.
        number: Number of points.
        spacing: Angle between two of them, rad.
        lines: Output, shape (6, n), see `CX`.
    """
    for i in range(number):
        x, y = points[X, i], points[Y, i]
        reach = max(NEAR, SPACING * spacing * points[LENGTH, i])
        count = mx = my = xx = xy = yy = 0.0
        for k in range(number):
            dx, dy = points[X, k] - x, points[Y, k] - y
            if dx * dx + dy * dy < reach * reach:
                count, mx, my = count + 1.0, mx + dx, my + dy
                xx, xy, yy = xx + dx * dx, xy + dx * dy, yy + dy * dy
        lines[GOOD, i] = 0.0
        if count >= FEWEST:
            mx, my = mx / count, my / count
            xx, xy, yy = xx / count - mx * mx, xy / count - mx * my, yy / count - my * my
            half, off = 0.5 * (xx - yy), sqrt(0.25 * (xx - yy) * (xx - yy) + xy * xy)
            least, most = max(0.5 * (xx + yy) - off, 0.0), 0.5 * (xx + yy) + off
            # The eigenvector of the smaller variance, by the larger one of two forms.
            nx, ny = (xy, -half - off) if half > 0.0 else (-(off - half), xy)
            size = sqrt(nx * nx + ny * ny)
            if size > 0.0 and least < FLAT * most:
                lines[CX, i], lines[CY, i], lines[NX, i], lines[NY, i] = x + mx, y + my, nx / size, ny / size
                lines[SPREAD, i], lines[GOOD, i] = sqrt(least * count / (count - 2.0)), 1.0


@kernel
def match(reference: Any, lines: Any, n: int, points: Any, number: int, start: Pose, information: Any) -> tuple[Pose, float]:
    """Return the pose of a scan in the frame of another one, and the share that fits of its points that have a line.

    The share is 0 where fewer than `SEEN` of the points have one.

    Args:
        reference: Points of the other one.
        lines: Its lines.
        n: Number of its points.
        points: The scan.
        number: Number of its points.
        start: Where to begin.
        information: Output, that of the pose, shape (3, 3); 1/m^2, 1/m, 1/rad^2.
    """
    at, fits, seen, A, g = start, 0.0, 0.0, np.zeros((3, 3)), np.zeros(3)
    near = np.full(number, -1)
    for step in range(STEPS):
        sine, cosine = sincos(at.theta)
        gate = max(WIDE * 0.6**step, TIGHT)
        A[:, :] = 0.0
        g[:] = 0.0
        fits = seen = 0.0
        for k in range(number):
            rx, ry = cosine * points[X, k] - sine * points[Y, k], sine * points[X, k] + cosine * points[Y, k]
            x, y, best, nearest = at.x + rx, at.y + ry, gate * gate, -1
            whole = step < WHOLE or near[k] < 0
            for j in range(n if whole else 2 * BESIDE + 1):
                i = j if whole else (near[k] - BESIDE + j) % n
                dx, dy = reference[X, i] - x, reference[Y, i] - y
                d = dx * dx + dy * dy
                if d < best:
                    best, nearest = d, i
            near[k] = nearest
            if nearest >= 0 and lines[GOOD, nearest] > 0.0:
                nx, ny = lines[NX, nearest], lines[NY, nearest]
                off = nx * (x - lines[CX, nearest]) + ny * (y - lines[CY, nearest])
                deviation = max(lines[SPREAD, nearest], max(NOISE, SHARE * points[LENGTH, k]))
                R = deviation * deviation
                weight = 1.0 / (1.0 + off * off / (GATE * GATE * R))
                seen += 1.0
                fits += 1.0 if off * off < GATE * GATE * R else 0.0
                weight = weight * weight / R
                nt = ny * rx - nx * ry
                A[0, 0] += weight * nx * nx
                A[0, 1] += weight * nx * ny
                A[0, 2] += weight * nx * nt
                A[1, 1] += weight * ny * ny
                A[1, 2] += weight * ny * nt
                A[2, 2] += weight * nt * nt
                g[0] += weight * nx * off
                g[1] += weight * ny * off
                g[2] += weight * nt * off
        # The inverse of the symmetric matrix, with the start's information, by its cofactors.
        a, b, c, d, e, f = A[0, 0] + WEAK, A[0, 1], A[0, 2], A[1, 1] + WEAK, A[1, 2], A[2, 2] + WEAK
        gx, gy, gt = g[0] + WEAK * (at.x - start.x), g[1] + WEAK * (at.y - start.y), g[2] + WEAK * (at.theta - start.theta)
        xx, xy, xt = d * f - e * e, c * e - b * f, b * e - c * d
        yy, yt, tt = a * f - c * c, b * c - a * e, a * d - b * b
        by = 1.0 / (a * xx + b * xy + c * xt)
        dx, dy, turn = (
            (xx * gx + xy * gy + xt * gt) * by,
            (xy * gx + yy * gy + yt * gt) * by,
            (xt * gx + yt * gy + tt * gt) * by,
        )
        at = Pose(at.x - dx, at.y - dy, at.theta - turn)
        if gate == TIGHT and abs(dx) + abs(dy) + abs(turn) < SETTLED:
            break
    for i in range(3):
        for j in range(3):
            information[i, j] = A[min(i, j), max(i, j)]
    return at, fits / seen if seen >= max(SEEN * number, 1.0) else 0.0


@kernel
def smoothed(points: Any, lines: Any, number: int, out: Any) -> int:
    """Write the points on the lines of a scan, which a line of another scan meets without an offset where a surface is curved.

    Args:
        points: The scan.
        lines: Its lines.
        number: Number of its points.
        out: Output, as the points.

    Returns:
        Their number.
    """
    count = 0
    for k in range(number):
        if lines[GOOD, k] > 0.0:
            out[X, count], out[Y, count], out[LENGTH, count] = lines[CX, k], lines[CY, k], points[LENGTH, k]
            count += 1
    return count


@kernel
def match_both(
    first: Any, n: int, second: Any, number: int, spacing: float, start: Pose, scratch: Any, information: Any
) -> tuple[Pose, float]:
    """Return the pose of a scan in the frame of another one, and the share that fits, as the mean of two matches.

    One matches the second scan with the lines of the first, the other one the first with those of the second: what pulls a
    match to one side because only one scan is smoothed pulls the two in opposite directions.

    Args:
        first: Points of the first scan.
        n: Their number.
        second: Points of the second one.
        number: Their number.
        spacing: Angle between two points, rad.
        start: Where to begin.
        scratch: Room for lines and points, shape (4, 6, most points).
        information: Output, see `match`.
    """
    lines_of(first, n, spacing, scratch[0])
    lines_of(second, number, spacing, scratch[1])
    n_smooth = smoothed(first, scratch[0], n, scratch[2])
    number_smooth = smoothed(second, scratch[1], number, scratch[3])
    there, fits = match(first, scratch[0], n, scratch[3], number_smooth, start, information)
    sine, cosine = sincos(there.theta)
    begin = Pose(-cosine * there.x - sine * there.y, sine * there.x - cosine * there.y, -there.theta)
    back, fits_back = match(second, scratch[1], number, scratch[2], n_smooth, begin, np.empty((3, 3)))
    sine, cosine = sincos(back.theta)
    x, y = -cosine * back.x - sine * back.y, sine * back.x - cosine * back.y
    return Pose(0.5 * (there.x + x), 0.5 * (there.y + y), 0.5 * (there.theta - back.theta)), min(fits, fits_back)

"""Compute a lower bound on the time of any policy for the square, for a robot that knows everything.

The path is a chain of straight lines from the origin through a point of each waypoint's disc; any other path through these
points is longer and turns at least as much. A robot at its wheels' limit, which bounds ``|v| + |omega| b / 2``, loses the
distance ``b / 2`` for each radian of turning, wherever it turns. The points are chosen by `scipy.optimize.minimize`, from
several starts.

Run `python benchmarks/fastest_square.py`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from turtlebot_gym import ROBOTS, SQUARE, SQUARE_WAYPOINTS

ROBOT = ROBOTS["burger"]
WAYPOINTS = np.array([waypoint[:2] for waypoint in SQUARE_WAYPOINTS])


def way(offsets: NDArray[np.float64]) -> tuple[float, float]:
    """Return the length of a path, m, and its total turn, rad; offsets (8,) from the waypoints are clipped to the radius."""
    offsets = offsets.reshape(4, 2)
    excess = np.maximum(np.hypot(*offsets.T) / SQUARE.radius, 1.0)
    legs = np.diff(np.vstack([np.zeros(2), WAYPOINTS + offsets / excess[:, None]]), axis=0)
    headings = np.concatenate([[0.0], np.arctan2(legs[:, 1], legs[:, 0])])
    turns = np.remainder(np.diff(headings) + np.pi, 2.0 * np.pi) - np.pi
    return float(np.hypot(*legs.T).sum()), float(np.abs(turns).sum())


def seconds(offsets: NDArray[np.float64]) -> float:
    """Return the least time for a path, s."""
    length, turned = way(offsets)
    return (length + turned * ROBOT.wheel_separation / 2.0) / min(ROBOT.max_linear, ROBOT.max_wheel)


def main() -> None:
    """Search, and print the bound."""
    starts = (np.random.default_rng(seed).normal(scale=0.2, size=8) for seed in range(20))
    tolerance = {"maxiter": 20_000, "maxfev": 20_000, "xatol": 1e-6, "fatol": 1e-8}
    best = min((minimize(seconds, start, method="Nelder-Mead", options=tolerance) for start in starts), key=lambda one: one.fun)
    length, turned = way(best.x)
    print(f"{best.fun:.2f} s: {length:.2f} m, and {turned:.2f} rad to turn on the way")


if __name__ == "__main__":
    main()

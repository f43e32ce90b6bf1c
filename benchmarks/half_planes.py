"""Velocities in half planes: the nearest one to a wanted one, or the least wrong one where no velocity is in all of them.

References:
    van den Berg, Guy, Lin, Manocha, "Reciprocal n-body collision avoidance" (2011), section 5.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Reals = NDArray[np.float64]
Plane = NDArray[np.complex128]
"""Points, velocities or directions: x + iy."""
NEVER = -1e3
"""Bound of a half plane that holds all velocities, m/s."""


def dot(a: Any, b: Any) -> Reals:
    """Return the scalar products of points of the plane."""
    return a.real * b.real + a.imag * b.imag


def nearest(normals: Plane, bounds: Reals, fastest: Reals, wanted: Plane) -> tuple[Plane, NDArray[np.int64]]:
    """Return the velocities nearest to the wanted ones in all half planes ``dot(normal, velocity) >= bound``.

    This is the incremental linear program in two dimensions, for all rows at once.

    Args:
        normals: Unit normals of the half planes, shape (n, lines).
        bounds: Their bounds, m/s, shape (n, lines).
        fastest: Greatest speeds, m/s, shape (n,).
        wanted: Wanted velocities, m/s, shape (n,).

    Returns:
        The velocities, m/s, and the first half plane without a velocity that the ones before allow, or ``lines``.
    """
    lines = normals.shape[1]
    found, failed = wanted * np.minimum(1.0, fastest / np.maximum(abs(wanted), 1e-9)), np.full(len(wanted), lines)
    for i in range(lines):
        rows = np.flatnonzero((dot(normals[:, i], found) < bounds[:, i] - 1e-9) & (failed == lines))
        if not rows.size:
            continue
        normal, bound = normals[rows, i], bounds[rows, i]
        along, square = 1j * normal, fastest[rows] ** 2 - bound**2
        high = np.sqrt(np.maximum(square, 0.0))
        slopes = dot(normals[rows, :i], along[:, None])
        needs = bounds[rows, :i] - bound[:, None] * dot(normals[rows, :i], normal[:, None])
        level = abs(slopes) < 1e-9
        at = needs / np.where(level, 1.0, slopes)
        low = np.where(~level & (slopes > 0.0), at, -high[:, None]).max(axis=1, initial=-np.inf)
        low, high = (
            np.maximum(low, -high),
            np.where(~level & (slopes < 0.0), at, np.inf).min(axis=1, initial=np.inf).clip(max=high),
        )
        allowed = (square >= 0.0) & (low <= high) & ~(level & (needs > 1e-9)).any(axis=1)
        best = normal * bound + along * np.clip(dot(along, wanted[rows]), low, np.maximum(low, high))
        found[rows[allowed]], failed[rows[~allowed]] = best[allowed], i
    return found, failed


def least_penetrating(
    normals: Plane, bounds: Reals, gives: Reals, fastest: Reals, start: Plane, failed: NDArray[np.int64]
) -> Plane:
    """Return the velocities whose greatest violation of a half plane, divided by how far it gives way, is least.

    This is the linear program in three dimensions: all half planes move outward at the same time until they share a velocity.

    Args:
        normals: Unit normals of the half planes, shape (n, lines).
        bounds: Their bounds, m/s, shape (n, lines).
        gives: How far each gives way, shape (lines,).
        fastest: Greatest speeds, m/s, shape (n,).
        start: Velocities within the half planes before the failed one, m/s, shape (n,).
        failed: The first half plane that `nearest` did not satisfy, shape (n,).
    """
    found, least = start.copy(), np.zeros(len(start))
    for i in range(normals.shape[1]):
        rows = np.flatnonzero(((bounds[:, i] - dot(normals[:, i], found)) / gives[i] > least + 1e-9) & (failed <= i))
        if not rows.size:
            continue
        normal, bound, share = normals[rows, i], bounds[rows, i], gives[:i] / gives[i]
        moved, need = normals[rows, :i] - share * normal[:, None], bounds[rows, :i] - share * bound[:, None]
        size = abs(moved)
        same = size < 1e-9  # gives way as far in the same direction
        size[same], need[same] = 1.0, NEVER
        best, failing = nearest(moved / size, need / size, fastest[rows], 1e3 * normal)
        found[rows] = np.where(failing == i, best, found[rows])
        least[rows] = (bound - dot(normal, found[rows])) / gives[i]
    return found

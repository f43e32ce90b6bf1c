"""The circle that stands for a robot's footprint."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def enclosing_circle(points: NDArray[np.float64]) -> tuple[float, float]:
    """Return the centre on the x axis and the radius of the least circle around points, shape (n, 2), m; both to the mm."""
    low, high = float(points[:, 0].min()), float(points[:, 0].max())
    centres = np.arange(np.floor(low * 1e3), np.ceil(high * 1e3) + 1.0)[:4001] / 1e3
    farthest = np.sqrt((points[:, 0] - centres[:, None]) ** 2 + points[:, 1] ** 2).max(axis=1)
    best = int(farthest.argmin())
    return round(float(centres[best]), 3), float(np.ceil(farthest[best] * 1e3 - 1e-6) / 1e3)

"""Tracks as the points of a ``sensor_msgs/PointCloud2``."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.observations import NEAREST, TRACKS

FIELDS = ("x", "y", "vx", "vy", "position_deviation", "velocity_deviation", "radius", "certainty", "z")
"""Fields of a track as a point: the numbers of the term "tracks", and a height of zero, without which viewers show nothing."""
FLOAT32 = 7
"""Type of each field, as in ``sensor_msgs/PointField``."""


def tracks_of(message: Any) -> NDArray[np.float64]:
    """Return the tracks in a ``sensor_msgs/PointCloud2``, shape (`NEAREST`, 8), see `observations.TRACKS`.

    Raises:
        ValueError: If there are not `NEAREST` points with the fields `FIELDS`, or a number is not finite.
    """
    fields = [(field.name, field.offset, field.datatype, field.count) for field in message.fields]
    expected = [(name, 4 * at, FLOAT32, 1) for at, name in enumerate(FIELDS)]
    size = NEAREST * 4 * len(FIELDS)
    if fields != expected or message.is_bigendian or len(message.data) != size:
        raise ValueError(f"tracks must be {NEAREST} points of the fields {', '.join(FIELDS)} in float32")
    rows = np.frombuffer(bytes(message.data), "<f4").reshape(NEAREST, -1)[:, :-1]
    return np.reshape(TRACKS.read(rows.ravel()), rows.shape)

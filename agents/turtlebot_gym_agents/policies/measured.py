"""Measurements that a deployment is given, checked; each refusal is one line."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from turtlebot_gym.config import FINITE, NON_NEGATIVE, POSITIVE_OR_INFINITE, PROBABILITY, Numbers, refusal
from turtlebot_gym.models.angles import wrap
from turtlebot_gym.rooms.scan import Scan
from turtlebot_gym.values import Covariance, Pose

TWIST, SHARES = Numbers(FINITE, 2), Numbers(PROBABILITY, 2)
_THREE, _VARIANCES = Numbers(FINITE, 3), Numbers(NON_NEGATIVE, 3)
_COVARIANCE = "3 variances, or a 3 x 3 matrix"


def pose_of(name: str, value: Any) -> Pose:
    """Return x, y and heading, m and rad."""
    x, y, theta = _THREE.check(name, value)
    return Pose(x, y, wrap(theta))


def covariance_of(covariance: Any) -> Covariance:
    """Return the covariance of a pose from its variances or its matrix."""
    rows = _floats("covariance", covariance, np.float64, _COVARIANCE)
    if rows.shape not in ((3,), (3, 3)):
        raise refusal("covariance", _COVARIANCE, covariance)
    rows = rows if rows.ndim == 2 else np.diag(rows)
    xx, yy, tt = _VARIANCES.check("covariance", rows.diagonal())
    xy, xt, yt = _THREE.check("covariance", rows[(0, 0, 1), (1, 2, 2)])
    return Covariance(xx, xy, xt, yy, yt, tt)


def scan_of(scan: Any) -> Scan:
    """Return a scan as its driver sends it."""
    if not isinstance(scan, Scan):
        raise refusal("scan", f"a turtlebot_gym.rooms.scan.Scan with {', '.join(Scan._fields[:5])}", scan)
    for name in ("first", "increment", "range_min"):
        FINITE.check(f"scan.{name}", getattr(scan, name))
    POSITIVE_OR_INFINITE.check("scan.range_max", scan.range_max)
    return scan._replace(ranges=_floats("scan.ranges", scan.ranges, np.float32, "numbers"))


def _floats(name: str, value: Any, dtype: Any, rule: str) -> NDArray[Any]:
    try:
        return np.asarray(value, dtype)
    except (TypeError, ValueError) as error:
        raise refusal(name, rule, value) from error

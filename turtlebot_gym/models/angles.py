"""Angles: wrapping, and a sine and cosine that give the same bits in plain Python and in compiled code.

Compiled ``math.sin`` is a call to the C library, which keeps LLVM from vectorizing the surrounding loop. A polynomial without
branches runs eight lanes wide, and its rounding does not depend on the platform.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from turtlebot_gym.kernel import floor, kernel

PI = math.pi
TWO_PI = 2.0 * math.pi
_PER_TURN = 1.0 / TWO_PI  # a division takes eight times as long as a product

# pi/2 in three parts of 33 bits, so that k times the first two is exact for the quadrants k that occur (Cody and Waite).
_TWO_OVER_PI = 0.6366197723675814
_HALF_PI_1 = 1.5707963267341256
_HALF_PI_2 = 6.077100506303966e-11
_HALF_PI_3 = 2.0222662487959506e-21


@kernel
def wrap(angle: float) -> float:
    """Wrap an angle to [-pi, pi)."""
    wrapped = angle - TWO_PI * floor((angle + PI) * _PER_TURN)
    wrapped = wrapped - TWO_PI if wrapped >= PI else wrapped  # rounding may leave exactly pi, or just less than -pi
    return -PI if wrapped < -PI else wrapped


def wrap_all(angles: ArrayLike) -> NDArray[np.float64]:
    """Wrap an array of angles to [-pi, pi); unlike `wrap`, it keeps NaN."""
    return np.asarray(np.remainder(np.asarray(angles, np.float64) + PI, TWO_PI) - PI)


@kernel
def sincos(angle: float) -> tuple[float, float]:
    """Return the sine and the cosine of an angle, to 3e-16, for ``|angle| < 1e5`` rad.

    References:
        Cody, Waite, *Software Manual for the Elementary Functions* (1980): the reduction. Sun Microsystems, *fdlibm*
        (1993), k_sin and k_cos: the coefficients.
    """
    quadrant = floor(angle * _TWO_OVER_PI + 0.5)
    r = ((angle - quadrant * _HALF_PI_1) - quadrant * _HALF_PI_2) - quadrant * _HALF_PI_3
    z = r * r
    high = 2.75573137070700676789e-06 + z * (-2.50507602534068634195e-08 + z * 1.58969099521155010221e-10)
    s = z * (8.33333333332248946124e-03 + z * (-1.98412698298579493134e-04 + z * high))
    sine = r + r * z * (-1.66666666666666324348e-01 + s)
    high = -2.75573143513906633035e-07 + z * (2.08757232129817482790e-09 + z * -1.13596475577881948265e-11)
    c = -1.38888888888741095749e-03 + z * (2.48015872894767294178e-05 + z * high)
    c = z * (4.16666666666666019037e-02 + z * c)
    cosine = 1.0 - (0.5 * z - z * c)
    part = quadrant - 4.0 * floor(quadrant * 0.25)
    odd = (part == 1.0) | (part == 3.0)
    a = cosine if odd else sine
    b = sine if odd else cosine
    return (-a if part >= 2.0 else a), (-b if (part == 1.0) | (part == 2.0) else b)

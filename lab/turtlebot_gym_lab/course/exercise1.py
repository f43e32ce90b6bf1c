"""Exercise 1: the innovation of a heading.

A filter compares a measured pose z with its estimate x. The difference, the innovation, corrects the estimate. For x and y it
is a subtraction. For the heading it is not quite: a robot that faces 3.1 rad and is then measured at -3.1 rad has turned by
0.08 rad, not by 6.2 rad.

Fill in both functions. Numbers are in m and rad, headings in [-pi, pi). Then: turtlebot-gym check exercise1.py
"""

import numpy as np

EXERCISE = 1


def innovation(z: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Return what a measured pose z (3,) says beyond the estimate x (3,), shape (3,)."""
    raise NotImplementedError


def update(x: np.ndarray, P: np.ndarray, z: np.ndarray, R: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the estimate (3,) and its covariance (3, 3) after a measured pose z (3,) with the covariance R (3, 3).

    All of the pose is measured, so H is the identity.
    """
    raise NotImplementedError

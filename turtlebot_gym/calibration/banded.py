"""Whitening by a banded covariance, in time proportional to the number of rows."""

from __future__ import annotations

import math
from typing import Any

from turtlebot_gym.compiled.cache import in_machine_code


@in_machine_code("regression of drives")
def whiten(bands: Any, white: Any) -> float:
    """Replace a covariance, in bands, by its Cholesky factor, whiten columns of numbers in place, and return the logarithm of
    the determinant; LAPACK's banded routines take ten times as long for so few bands."""
    rows, columns = white.shape
    width = bands.shape[1]
    determinant = 0.0
    for row in range(rows):
        if not bands[row, 0] > 0.0:
            return math.inf
        determinant += math.log(bands[row, 0])
        root = math.sqrt(bands[row, 0])
        for i in range(width):
            bands[row, i] /= root
        for column in range(columns):
            white[row, column] /= root
        for i in range(1, min(width, rows - row)):
            share = bands[row, i]
            if share != 0.0:
                for k in range(i, min(width, rows - row)):
                    bands[row + i, k - i] -= share * bands[row, k]
                for column in range(columns):
                    white[row + i, column] -= share * white[row, column]
    return determinant

"""Parameters that a log does not determine, with the reason and the motion that would determine them."""

from __future__ import annotations

from typing import NamedTuple

from turtlebot_gym.calibration.coordinates import PARAMETERS, PLAIN

CLEAR = 0.3
"""Relative standard deviation of a coordinate up to which a variance, a probability or a size counts as determined."""
FINE = {"scale": 0.05, "bias_x": 0.1, "bias_y": 0.1, "bias_theta": 0.1}
"""Standard deviation up to which the other parameters count as determined."""

MOTIONS = {
    "alpha1": "drive straight ahead, fast, without turning, for 10 m or more",
    "alpha2": "turn on the spot, both ways, for ten turns or more",
    "alpha3": "drive straight ahead, fast, without turning, for 10 m or more",
    "alpha4": "turn on the spot, both ways, for ten turns or more",
    "scale": "drive 10 m or more",
    "bias_theta": "drive 10 m or more, so that the path shows the heading",
    "spike_probability": "record for longer",
    "spike": "record for longer",
}
"""The motion that determines a parameter."""
ONLY_TRUTH = {
    "bias_x": "a shift of all poses looks like another origin: record the truth",
    "bias_y": "a shift of all poses looks like another origin: record the truth",
}
"""Parameters that no motion determines without truth."""
HIDDEN = ("alpha1", "alpha3")
"""Parameters that the larger noise of measured poses hides; if one of them seems determined, that is usually by chance."""


class Verdict(NamedTuple):
    """Whether a parameter is determined, and what would determine it."""

    is_determined: bool
    remedy: str


def verdict(name: str, x: float, deviation: float, low: float, high: float, *, has_truth: bool) -> Verdict:
    """Return whether a log determines a parameter.

    Args:
        name: The parameter.
        x: Its coordinate.
        deviation: Its standard deviation by the Fisher information.
        low: End of its interval, in its own unit.
        high: The other end.
        has_truth: Whether the truth was recorded.
    """
    if PARAMETERS[name].kind == PLAIN:
        clear = deviation <= FINE[name]
    else:
        clear = deviation <= CLEAR * abs(x) and low > 0.0 and high < float("inf")
    is_hidden = name in HIDDEN and not has_truth
    if clear and not is_hidden:
        return Verdict(True, "")
    remedy = MOTIONS.get(name, "record for longer")
    return Verdict(False, f"record the truth, and {remedy}" if is_hidden else remedy)

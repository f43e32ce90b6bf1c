"""Calibration: fit the noise model to a recorded drive by maximum likelihood, with intervals, and say what stays unknown."""

from turtlebot_gym_lab.calibration.calibrate import KINDS, Calibration, calibrate, detect_kind
from turtlebot_gym_lab.calibration.estimates import CalibrationEstimate

__all__ = ["KINDS", "Calibration", "CalibrationEstimate", "calibrate", "detect_kind"]

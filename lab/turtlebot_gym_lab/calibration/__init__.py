"""Calibration: fit the noise model to a recorded drive by maximum likelihood, with intervals, and say what stays unknown."""

from turtlebot_gym_lab.calibration.calibrate import KINDS, Calibration, calibrate, detect_kind
from turtlebot_gym_lab.calibration.estimates import CalibrationEstimate
from turtlebot_gym_lab.calibration.tape import Leg, calibrate_by_tape

__all__ = ["KINDS", "Calibration", "CalibrationEstimate", "Leg", "calibrate", "calibrate_by_tape", "detect_kind"]

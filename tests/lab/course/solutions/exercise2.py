"""A solution of exercise 2: the variances of what the robot did beyond what the wheels said."""

import numpy as np

from turtlebot_gym_lab.course.recordings import recording

EXERCISE = 2

drive = recording()
slip = drive.true_state[:, 3:] - drive.twist
Q = (0.0, 0.0, 0.0, *np.var(slip, axis=0).tolist())

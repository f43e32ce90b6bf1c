"""Exercise 2: how much to trust the wheels.

The wheels say how fast the robot drives, and slip a little. Q says how much: the variances that a step of 0.1 s adds to x, y,
heading, speed and turning rate (m^2, m^2, rad^2, (m/s)^2, (rad/s)^2). With a Q that is too small the filter ignores what it
measures, and its errors are larger than it says; with a Q that is too large it jumps after every measurement.

`turtlebot_gym_lab.course.recordings.recording()` returns a recorded drive with its true poses. Look at what the wheels
said (`drive.twist`) and at what the robot did (`drive.true_state`), or try values: `recordings.filtered(drive, Q)` returns the
drive with the filter's estimate and covariance. Then: turtlebot-gym check exercise2.py
"""

EXERCISE = 2

Q = (0.0, 0.0, 0.0, 0.0, 0.0)

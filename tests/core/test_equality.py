"""What is trained is what is deployed: plain Python and every row of a compiled batch agree to the last bit.

The reference is the transition as plain Python on floats, driven by the actions that the batch was given. Vector environments
are compared with scalar ones in `test_vector`, and both with plain Python in `tests/golden`.
"""

from dataclasses import replace

import pytest
from steering import SHAKY, drive

from turtlebot_gym import FilterTuning, FixNoise, Robot
from turtlebot_gym.compiled.batch import Batch
from turtlebot_gym.heart import Episode
from turtlebot_gym.parameters import Kalman
from turtlebot_gym.systems import Options

GATED = FilterTuning(
    Q=(1e-4, 1e-4, 1e-4, 1e-3, 1e-3), R=(0.01, 0.02, 0.03), process=SHAKY.process, kind=Kalman(gate=9.0, max_rejections=2)
)
"""A gate that is often shut, and often enough for a restart."""
HEAVY = Robot(
    max_linear=0.3, max_angular=1.9, max_wheel=0.306, max_linear_acceleration=0.9, max_angular_acceleration=7.0, reverse=False
)
COURSE = [(0.3, 0.0, 0.0), (0.4, 0.1, 1.0), (0.0, 0.3, -2.0)]
LATE = FixNoise(R=(0.01, 0.02, 0.03), period=0.4, delay=0.3, dropout_probability=0.3)
NOISY = "pose, everything noisy"
CASES = {
    "nav": {},
    NOISY: {"task": "pose", "noise": SHAKY, "filter": GATED, "integrator": "midpoint", "arrival": "belief"},
    "square by time": {"task": "square", "noise": "documented", "filter": "tutorial", "switch": "time", "robot": "tutorial"},
    "square twice, on wheels": {"task": "square", "noise": "wheel", "laps": 2, "dt": 0.2, "robot": "turtlebot4"},
    "square of one's own": {"task": "square", "waypoints": COURSE, "laps": 2, "noise": "rough", "arrival": "belief"},
    "recorded noise": {"noise": "recorded"},
    "history": {"observation": "goal*3@2,twist"},
    "heavy and late": {"noise": "rough", "robot": HEAVY, "delay": 2, "integrator": "midpoint"},
    "odometry shown": {"noise": "rough", "observation": "odometry"},
    "truth shown": {"noise": "clean", "observation": "truth", "integrator": "midpoint"},
    "gated": {"noise": SHAKY, "filter": "gated"},
    **{fix: {"fix": fix} for fix in ("localization", "markers", "motion-capture")},
    "wheels and late fixes": {"noise": "wheel", "fix": LATE},
    "spikes and fixes in time": {"noise": SHAKY, "filter": "gated", "fix": "beacons"},
    "gyro": {"noise": "rough", "filter": "gyro", "imu": "calibrated"},
    "gyro under late fixes": {"noise": "rough", "filter": "gyro", "imu": "mpu9250", "fix": "late"},
    "gyro that the filter does not read": {"noise": "rough", "imu": "mpu9250", "fix": "beacons"},
    "a class as filter": {"noise": "rough", "filter": "own_parts:Extended", "fix": "late"},
}


def ends_of(case, number, rows, steps, in_step):
    """Return how many episodes terminated and were truncated while some rows of a batch were compared."""
    options = {"task": "nav"} | CASES[case]
    parameters, waypoints, _, system = Options(**options).setup()
    limit = 400.0 if options["task"] == "square" and "switch" not in options else 150.0
    p = parameters._replace(task=replace(parameters.task, max_steps=limit))
    plain = {row: Episode(p, waypoints, seed=row, system=system) for row in rows}
    batch = Batch(number, p, waypoints, system=system)
    return sum(outcomes[3:5].sum(axis=1) for outcomes in in_step(batch, plain, steps=steps, policy=drive))


SLOW = "a class as filter"
ALWAYS = ("nav", NOISY, "square by time", "history", "gyro under late fixes")


@pytest.mark.parametrize(("case", "number"), [*((case, 35) for case in ALWAYS), ("nav", 1), (SLOW, 2)])
def test_rows_equal_plain_python(case, number, in_step):
    terminated, truncated = ends_of(case, number, (0, 1, 31, 34)[:number], 500, in_step)
    assert terminated > 0 or number <= 2 or case == "square by time", "no episode terminated: the test saw too little"
    assert truncated > 0 or case == "square by time", "no episode was truncated: the test saw too little"


@pytest.mark.slow
@pytest.mark.parametrize("case", [case for case in CASES if case != SLOW])
def test_each_third_row_equals_plain_python_in_a_million_steps(case, in_step):
    assert ends_of(case, 100, range(0, 100, 3), 10_000, in_step).any()  # of all lanes of a tile

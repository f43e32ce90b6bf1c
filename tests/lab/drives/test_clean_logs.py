"""A bag of a drive without a fault is read without a remark, whatever the noise, the rate and the kind of its truth."""

import numpy as np
import pytest
from rosbag_messages import ODOMETRY, POSE, TF, header, make, odometry, pose, transform, write_bag
from simulated import simulated_log

from turtlebot_gym import make_noise
from turtlebot_gym.drive import known
from turtlebot_gym.presets import NOISES
from turtlebot_gym_lab.drives import read
from turtlebot_gym_lab.drives.streams import between

START, CAPTURE = 1e9, 30.0
"""Time of the first row, s, and rate of the motion capture, Hz."""
TRUTHS = {"topic": None, "chain": "/tf:map.base", "capture": "/mocap:hall.robot"}
RATES = (50.0, 20.0, 5.0)


def bag(folder, drive, kind, random):
    """Write a drive with its truth as a topic of poses, as map -> odom -> base, or as transforms by motion capture."""
    truth, said, messages = drive.truth, drive.odometry, []
    for k, time in enumerate(START + drive.time):
        received = time + 0.002 + random.exponential(0.002)
        measured = bool(np.isfinite(said[k]).all())
        place = said[k] if measured else truth[k]
        messages.append(("/odom", ODOMETRY, received, odometry(time, place, drive.twist[k], measured=measured)))
        if kind == "topic":
            messages.append(("/ground_truth", POSE, received + 1e-4, make(POSE, header(time, "map"), pose(*truth[k]))))
        if kind == "chain":
            turn = truth[k, 2] - place[2]
            x = truth[k, 0] - np.cos(turn) * place[0] + np.sin(turn) * place[1]
            y = truth[k, 1] - np.sin(turn) * place[0] - np.cos(turn) * place[1]
            parts = [transform(time, place, "base", "odom"), transform(time, (x, y, turn), "odom", "map")]
            messages += [("/tf", TF, received + 1e-4, make(TF, [part])) for part in parts]
    if kind == "capture":
        times = np.arange(drive.time[0], drive.time[-1], 1.0 / CAPTURE)
        for time, place in zip(START + times, between(drive.time, truth, times), strict=True):
            seen = place + random.normal(0.0, (3e-4, 3e-4, 1e-3))
            messages.append(("/mocap", TF, time + 0.003, make(TF, [transform(time, seen, "robot", "hall")])))
    return write_bag(folder, sorted(messages, key=lambda message: message[2]))


def require_clean(folder, noise, rate, kind, seed):
    drive = simulated_log(make_noise(noise), seed=seed, steps=round(40.0 * rate), dt=1.0 / rate)
    again = read(bag(folder, drive, kind, np.random.default_rng(seed)), truth=TRUTHS[kind])
    assert again.remarks == ()
    assert known(again.truth).mean() > 0.95


@pytest.mark.sample(1)
@pytest.mark.parametrize(
    ("noise", "rate", "kind"), [("wheel", 50.0, "capture"), ("rough", 5.0, "chain"), ("documented", 20.0, "topic")]
)
def test_a_clean_log_has_no_remark(tmp_path, noise, rate, kind):
    require_clean(tmp_path / "bag", noise, rate, kind, 0)


@pytest.mark.slow
@pytest.mark.parametrize("kind", TRUTHS)
@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("noise", NOISES)
def test_a_hundred_clean_logs_have_no_remark(tmp_path, noise, rate, kind):
    for seed in range(1, 4):
        require_clean(tmp_path / f"bag{seed}", noise, rate, kind, seed)

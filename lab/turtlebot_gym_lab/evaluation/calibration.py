"""Tests of a calibration: simulated drives with known noise, and filters on recorded drives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from turtlebot_gym import Noise, make_filter, make_noise
from turtlebot_gym.drive import Drive, heading_error, position_error
from turtlebot_gym.estimation.consistency import nees
from turtlebot_gym.parameters import ProcessNoise
from turtlebot_gym.presets import WHEEL
from turtlebot_gym_lab.evaluation.estimation import SQUARE
from turtlebot_gym_lab.evaluation.replay import replay

HOLD = 15
"""Steps for which a command is held."""


def simulated_log(
    noise: Noise, *, seed: int, steps: int = 3000, robot: str = "burger", dt: float = 0.1, integrator: str = "euler"
) -> Drive:
    """Return a drive of the environment that excites all parameters: straight ahead, on the spot and in arcs, in random order.

    Args:
        noise: True noise.
        seed: Seed of the noise and of the commands.
        steps: Number of steps.
        robot: Name of the robot.
        dt: Control interval, s.
        integrator: "euler" or "midpoint".
    """
    random = np.random.default_rng(seed)
    options = {"robot": robot, "dt": dt, "integrator": integrator, "switch": "time", "max_episode_steps": steps + 1}
    env = gym.make(SQUARE, noise=noise, **options).unwrapped
    infos = [env.reset(seed=seed)[1]]
    action = np.zeros(2, np.float32)
    for step in range(steps):
        if step % HOLD == 0:
            straight = (random.uniform(0.6, 1.0), 0.0)
            turning = (0.0, random.uniform(0.1, 0.35) * random.choice((-1.0, 1.0)))
            arc = (random.uniform(0.3, 0.8), random.uniform(-0.2, 0.2))
            action = np.array((straight, turning, arc)[random.integers(3)], np.float32)
        infos.append(env.step(action)[4])
    env.close()
    columns = {name: np.array([info[name] for info in infos], np.float64) for name in ("command", "odometry", "true_state")}
    twist = np.concatenate([np.zeros((1, 2)), columns["command"][:-1]])  # a command moves the robot in the interval after it
    poses = columns["odometry"]
    if not noise.odometry.wheel:
        poses[1:][(poses[1:] == poses[:-1]).all(axis=1)] = np.nan  # a lost measurement repeats the last one
    return Drive(
        time=np.asarray(dt * np.arange(steps + 1), np.float64), twist=twist, odometry=poses, true_state=columns["true_state"]
    )


class _Judged(NamedTuple):
    """Accuracy and consistency of a filter on a drive, per seed."""

    nees: NDArray[np.float64]
    """Mean normalized estimation error squared of the pose: 3 for a consistent filter."""
    position: NDArray[np.float64]
    """Mean error of the position, m."""
    heading: NDArray[np.float64]
    """Mean error of the heading, rad."""


def judge(
    drive: Drive, calibrated: Noise | None, seeds: Sequence[int], *, noise: str | Noise = "documented", rate: float = 10.0
) -> _Judged:
    """Return how well the matched filter does on a recorded drive with corrections by measured poses.

    Args:
        drive: The drive.
        calibrated: Noise that the filter assumes, R and process; its bias is removed from the measured poses. None for the
            uncalibrated filter: matched to the true noise, with the process of the preset "wheel".
        seeds: Seeds of the measured poses' noise.
        noise: Noise of the measured poses.
        rate: Measured poses per second.
    """
    model, process = make_noise(noise), WHEEL.process
    tuning = make_filter("matched", replace(model, process=process))
    if calibrated is not None:
        remaining = tuple(true - fitted for true, fitted in zip(model.odometry.bias, calibrated.odometry.bias, strict=True))
        model = replace(model, odometry=replace(model.odometry, bias=remaining))
        tuning = make_filter("calibrated", calibrated)
    judged = []
    for seed in seeds:
        replayed = replay(drive, noise=model, filter=tuning, process=ProcessNoise(), seed=seed, rate=rate)
        errors = nees(replayed.estimate, replayed.true_state, replayed.covariance, components=3)[1:]
        position, heading = (error(replayed.estimate, replayed.true_state) for error in (position_error, heading_error))
        judged.append((errors.mean(), position.mean(), heading.mean()))
    return _Judged(*np.array(judged).T)
